"""Display of values in notebooks and at prompts: a summary table as HTML or a few lines of text.

A value derives from `Displayed` and implements `summary`. Text is escaped; nothing is fetched or executed.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from math import ceil, floor, isfinite, log10
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

MOST_ROWS = 200
"""Largest number of rows of an HTML table; with more a notebook becomes slow."""

FEW_ROWS = 6
"""Largest number of table rows in the text at a prompt. With the titles and the note, the text has at most ten
lines."""

MOST_DIGITS = 15
"""Largest number of decimals or significant digits of an end of an interval; a float has no more."""

WIDEST = 28
"""Largest number of characters of a cell in the text at a prompt."""


@dataclass(frozen=True, slots=True)
class Summary:
    """Summary of a value: a table with a title and a note.

    Attributes:
        title: Title, one line.
        columns: Titles of the columns.
        rows: Rows of the table, with one text for each column.
        note: Remark below the table; may be empty.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


class Displayed:
    """Value that a notebook shows as a table, and that a prompt shows as the first rows of this table.

    A dataclass of this kind is declared with `repr=False`, so that it inherits `__repr__`.
    """

    __slots__ = ()

    @abstractmethod
    def summary(self) -> Summary:
        """Title, columns, rows and note of the table."""

    def _repr_html_(self) -> str:
        return html_of(self.summary())

    def __repr__(self) -> str:
        return text_of(type(self).__name__, self.summary())


def names_apart(paths: Iterable[str]) -> dict[str, str]:
    """Distinct short name of each path: the shortest end of the path that no other path has."""
    parts = {path: PurePath(path).parts for path in paths}

    def name(path: str) -> str:
        ends = (PurePath(*parts[path][-k:]).as_posix() for k in range(1, len(parts[path]) + 1))
        others = [each for other, each in parts.items() if other != path]
        alone = (end for k, end in enumerate(ends, 1) if not any(other[-k:] == parts[path][-k:] for other in others))
        return next(alone, path)

    return {path: name(path) for path in parts}


def spans(*channels: NDArray[np.float64]) -> tuple[tuple[str, ...], ...]:
    """Smallest and largest value of each quantity as text, with one row for each joint.

    Args:
        channels: Quantities, each of shape (N, n); values that are not finite are ignored.
    """

    def span(values: NDArray[np.float64]) -> str:
        known = values[np.isfinite(values)]
        return f"{known.min():.4g} … {known.max():.4g}" if len(known) else "–"

    return tuple(zip(*([span(column) for column in values.T] for values in channels), strict=True))


def html_of(summary: Summary) -> str:
    """Summary as an HTML table, with right-aligned numbers and no other style."""

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
    """Summary in at most ten lines of text.

    Args:
        kind: Name of the value's type.
        summary: Summary of the value.
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
    """Percentage with two significant digits: `0.034 %`, `5.1 %`, `510 %`."""
    return f"{value:.2g} %" if not 99.5 <= value < float("inf") else f"{value:.0f} %"


def interval_text(low: float, high: float, *, decimals: int | None = None, digits: int = 5) -> str:
    """Ends of an interval, with enough digits to be different: `0.00798 … 0.00803`; a dash if there are no ends.

    Args:
        low: Lower end.
        high: Upper end.
        decimals: Smallest number of decimals; if not given, `digits` is used.
        digits: Smallest number of significant digits.
    """
    if not low <= high:
        return "–"
    finite = isfinite(low) and isfinite(high)
    needed = ceil(-log10(high - low)) if finite and low < high else -MOST_DIGITS
    if decimals is not None:
        form = f".{min(max(decimals, needed), max(decimals, MOST_DIGITS))}f"
    else:
        before = floor(log10(max(abs(low), abs(high)))) + 1 if finite and (low or high) else 0
        form = f".{min(max(digits, before + needed), MOST_DIGITS)}g"
    return f"{low:{form}} … {high:{form}}"


def plural(count: int, noun: str) -> str:
    """Text of a number with its noun in singular or plural, for instance `1 joint` and `2 joints`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
