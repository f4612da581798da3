"""Catalogue of one kind of thing: the single list of its members, each imported when it is first used.

A row is text, `package.module:Object` or, where the module itself is the member, `package.module`. So the command
line can list and complete names without importing a member.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from typing import Any, Generic, TypeVar, cast

T = TypeVar("T")


class Catalogue(Mapping[str, T], Generic[T]):
    """Members of a kind by name, in the order of its rows.

    Args:
        rows: By name: where the member is, or the member itself.
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
        """Context in which further rows are in the catalogue, after its own; one with a known name replaces it.

        Args:
            rows: As in the catalogue.
        """
        before = self._rows
        self._rows = {**before, **rows}
        try:
            yield
        finally:
            self._rows = before


def _load(row: str) -> Any:
    """Module or object that a row names."""
    module, _, name = row.partition(":")
    return getattr(import_module(module), name) if name else import_module(module)
