"""Catalogue: mapping from names to objects of one type, each of which is imported when it is first used.

For instance, all estimators of armid are listed in one catalogue. Each row of a catalogue gives the object of one
name as a text: `package.module:Object`, or `package.module` if the module itself is the object. So the command line
can list and complete names without importing the objects.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from typing import Any, Generic, TypeVar, cast

T = TypeVar("T")


class Catalogue(Mapping[str, T], Generic[T]):
    """Mapping from names to objects of one type, in the order of `rows`.

    Args:
        rows: For each name, the text `package.module:Object`, or the object itself.
    """

    def __init__(self, rows: Mapping[str, str | T]) -> None:
        self._rows: dict[str, str | T] = dict(rows)

    def __getitem__(self, name: str) -> T:
        row = self._rows[name]
        return cast("T", _load(row)) if isinstance(row, str) else row

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __contains__(self, name: object) -> bool:
        return name in self._rows

    @contextmanager
    def extended(self, rows: Mapping[str, str | T]) -> Generator[None]:
        """Context in which the catalogue has further rows at its end; a row with a known name replaces the old row.

        Args:
            rows: Further rows, in the form of those of the catalogue.
        """
        before = self._rows
        self._rows = {**before, **rows}
        try:
            yield
        finally:
            self._rows = before


def _load(row: str) -> Any:
    """Imports the module or the object that the text of a row names."""
    module, _, name = row.partition(":")
    return getattr(import_module(module), name) if name else import_module(module)
