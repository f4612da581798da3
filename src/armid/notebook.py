"""Display of values: they say what their table holds, and here it becomes HTML or a few lines of text.

Any value takes part by deriving from `Displayed` and giving a `summary`. Text is escaped; nothing is fetched or
executed.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

__all__ = ["Displayed", "Summary", "html_of", "names_apart", "percent", "plural", "spans", "text_of"]

MOST_ROWS = 200
"""Rows that are shown; a notebook becomes slow with more, and nobody reads them."""

FEW_ROWS = 6
"""Rows of the text that a prompt shows: with title, titles of columns and notes ten lines at most."""

WIDEST = 28
"""Characters of a cell of that text; longer ones are cut."""


@dataclass(frozen=True, slots=True)
class Summary:
    """Summary of a value.

    Attributes:
        title: What it is, one line.
        columns: Titles of the columns.
        rows: Cells, one text a column.
        note: What is to be known beside; empty where nothing is.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


class Displayed:
    """A value that a notebook shows as a table, and a prompt as the first lines of it.

    A dataclass of this kind is declared with `repr=False`, so that it keeps the text from here.
    """

    __slots__ = ()

    @abstractmethod
    def summary(self) -> Summary:
        """Title, rows and note of the table."""

    def _repr_html_(self) -> str:
        return html_of(self.summary())

    def __repr__(self) -> str:
        return text_of(type(self).__name__, self.summary())


def names_apart(paths: Iterable[str]) -> dict[str, str]:
    """Names of files by their paths, with as many of their folders as it takes to tell them apart."""
    parts = {path: PurePath(path).parts for path in paths}

    def name(path: str) -> str:
        ends = (PurePath(*parts[path][-k:]).as_posix() for k in range(1, len(parts[path]) + 1))
        others = [each for other, each in parts.items() if other != path]
        alone = (end for k, end in enumerate(ends, 1) if not any(other[-k:] == parts[path][-k:] for other in others))
        return next(alone, path)

    return {path: name(path) for path in parts}


def spans(*channels: NDArray[np.float64]) -> tuple[tuple[str, ...], ...]:
    """From where to where each joint goes, a row a joint and a cell a quantity.

    Args:
        channels: Quantities, each of shape (N, n); what is not finite is passed over.
    """

    def span(values: NDArray[np.float64]) -> str:
        known = values[np.isfinite(values)]
        return f"{known.min():.4g} … {known.max():.4g}" if len(known) else "–"

    return tuple(zip(*([span(column) for column in values.T] for values in channels), strict=True))


def html_of(summary: Summary) -> str:
    """A summary as a table in HTML, without style but that numbers stand to the right."""

    def line(tag: str, cells: tuple[str, ...]) -> str:
        inside = "".join(
            f'<{tag} style="text-align:{"left" if k == 0 else "right"}">{escape(cell)}</{tag}>'
            for k, cell in enumerate(cells)
        )
        return f"<tr>{inside}</tr>"

    rows = "".join(line("td", row) for row in summary.rows[:MOST_ROWS])
    left = len(summary.rows) - MOST_ROWS
    more = f"<p>and {plural(left, 'row')} more</p>" if left > 0 else ""
    note = f"<p>{escape(summary.note)}</p>" if summary.note else ""
    table = f"<thead>{line('th', summary.columns)}</thead><tbody>{rows}</tbody>"
    return f"<table><caption>{escape(summary.title)}</caption>{table}</table>{more}{note}"


def text_of(kind: str, summary: Summary) -> str:
    """A summary in at most ten lines of text.

    Args:
        kind: Name of the value's type.
        summary: Its table.
    """

    def cut(text: str) -> str:
        line = " ".join(text.split())
        return line if len(line) <= WIDEST else f"{line[: WIDEST - 1]}…"

    shown = [summary.columns, *summary.rows[:FEW_ROWS]] if any(summary.columns) else [*summary.rows[:FEW_ROWS]]
    cells = [[cut(cell) for cell in row] for row in shown]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in cells]
    left = len(summary.rows) - FEW_ROWS
    more = [f"… and {left} more"] if left > 0 else []
    note = [" ".join(summary.note.split())] if summary.note else []
    return "\n  ".join([f"<{kind} {summary.title}", *lines, *more, *note]) + ">"


def percent(value: float) -> str:
    """A share in percent with two digits that say something: `0.034 %`, `5.1 %`, `510 %`."""
    return f"{value:.2g} %" if not 99.5 <= value < float("inf") else f"{value:.0f} %"


def plural(count: int, noun: str) -> str:
    """A number with its noun, `1 joint` and `2 joints`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
