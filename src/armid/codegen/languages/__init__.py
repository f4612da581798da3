"""Catalogue `LANGUAGES` of code languages: one file and one line here for each.

A language is a module with `write(source)`, which gives the text of each file by its path.
"""

from __future__ import annotations

from types import ModuleType

from armid.codegen.languages import c, cpp, julia, matlab, python

__all__ = ["LANGUAGES"]

LANGUAGES: dict[str, ModuleType] = {"c": c, "cpp": cpp, "matlab": matlab, "python": python, "julia": julia}
"""Languages by their name in the option `--to`."""
