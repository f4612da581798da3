"""Languages that code is written in, one a file. `LANGUAGES` is the catalogue: a new one is a file and a line here.

A language is a module with `write(source)`, which gives the text of each file by its path.
"""

from __future__ import annotations

from types import ModuleType

from armid.codegen.languages import c, cpp, julia, matlab, python

__all__ = ["LANGUAGES"]

LANGUAGES: dict[str, ModuleType] = {"c": c, "cpp": cpp, "matlab": matlab, "python": python, "julia": julia}
"""Languages by the name that `--to` gives them."""
