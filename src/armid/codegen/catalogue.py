"""Catalogue `LANGUAGES` of code languages: a new language is a new file and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from armid.catalogue import Catalogue

if TYPE_CHECKING:
    from armid.codegen.language_input import FunctionSource


class Language(Protocol):
    """Interface of the module of a language."""

    @staticmethod
    def write(source: FunctionSource) -> dict[str, str]:
        """Text of each file by its path."""
        ...


LANGUAGES: Catalogue[Language] = Catalogue(
    {
        "c": "armid.codegen.languages.c",
        "cpp": "armid.codegen.languages.cpp",
        "matlab": "armid.codegen.languages.matlab",
        "python": "armid.codegen.languages.python",
        "julia": "armid.codegen.languages.julia",
    }
)
"""Languages by their name in `armid export --to`."""
