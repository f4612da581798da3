"""Catalogue `LANGUAGES` of forms of generated code: a new language needs a module and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from armid.lazy_catalogue import Catalogue

if TYPE_CHECKING:
    from armid.codegen.language_input import FunctionSource


class Language(Protocol):
    """Interface that the module of a programming language has."""

    @staticmethod
    def write(source: FunctionSource) -> dict[str, str]:
        """Generated text of each file; the keys are the paths of the files."""
        ...


LANGUAGES: Catalogue[Language] = Catalogue(
    {
        "c": "armid.codegen.languages.c",
        "cpp": "armid.codegen.languages.cpp",
        "matlab": "armid.codegen.languages.matlab",
        "python": "armid.codegen.languages.python",
        "julia": "armid.codegen.languages.julia",
        "ros2": "armid.codegen.languages.ros2",
    }
)
"""Modules of the languages; the keys are the names that `armid export --to` accepts."""
