"""Text tables: one header line, then one line a sample."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from armid.errors import RecordingError
from armid.measurement.columns import assemble, select
from armid.measurement.reading import Reading
from armid.measurement.recording import Recording
from armid.robot.robot import Robot
from armid.values import Array

__all__ = ["SUFFIXES", "read"]

SUFFIXES: tuple[str, ...] = (".csv", ".tsv", ".txt")

DELIMITERS = (",", ";", "\t")
"""Delimiters looked for in the header; a header with none of them is delimited by spaces."""


def read(path: Path, reading: Reading, robot: Robot | None = None) -> Recording:
    """Read a text table; its delimiter is found in the header.

    Lines that begin with `#` may precede the table; the last of them may be the header.

    Raises:
        RecordingError: No header, a row with too few or too many fields, or a field that is no number; the message
            names the line.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise RecordingError(
            f"{path} is not a text file ({error.reason} at byte {error.start}).",
            remedy="export the table as UTF-8 text, or give the file the ending of its format.",
        ) from error
    lines = text.splitlines()
    head = _header_index(lines, path)
    header = lines[head].lstrip("#").strip()
    delimiter = max(DELIMITERS, key=header.count)
    delimiter = delimiter if delimiter in header else " "
    names = [name.strip() for name in _fields(header, delimiter)]
    selection = select(names, reading, path, robot)
    numbers = [i for i in range(head + 1, len(lines)) if lines[i].strip()]
    rows = [lines[i] for i in numbers]
    if not rows:
        raise RecordingError(f"{path} has a header and no rows.", remedy="record again; nothing was written.")
    _check_widths(rows, numbers, len(names), delimiter, path)
    wanted = [names.index(name) for name in selection.names]
    try:
        plain = None if delimiter == " " else delimiter
        table = np.loadtxt(rows, delimiter=plain, usecols=wanted, comments=None, quotechar='"', ndmin=2)
    except ValueError:
        table = _field_by_field(rows, numbers, dict(zip(wanted, selection.names, strict=True)), delimiter, path)
    columns = dict(zip(selection.names, table.T, strict=True))
    return assemble(selection, columns.__getitem__, reading, path)


def _header_index(lines: Sequence[str], path: Path) -> int:
    """Which line names the columns."""
    first = next((i for i, line in enumerate(lines) if line.strip() and not line.startswith("#")), None)
    if first is None:
        raise RecordingError(f"{path} is empty.", remedy="record again; nothing was written.")
    if not _is_number(re.split(r"[,;\t ]", lines[first].strip())[0].strip('"')):
        return first
    if first and lines[first - 1].startswith("#"):
        return first - 1
    raise RecordingError(
        f"{path} has no header: line {first + 1} begins with the number {lines[first].strip()[:20]!r}….",
        remedy="put a line with column names on top, for instance t,q1,q2,tau1,tau2.",
    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _fields(line: str, delimiter: str) -> list[str]:
    """Fields of one line; a delimiter may stand inside quotes."""
    if '"' in line:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    return line.split() if delimiter == " " else line.split(delimiter)


def _check_widths(rows: Sequence[str], numbers: Sequence[int], width: int, delimiter: str, path: Path) -> None:
    """Refuse a row that has another number of fields than the header."""
    for row, number in zip(rows, numbers, strict=True):
        plain = delimiter != " " and '"' not in row
        found = row.count(delimiter) + 1 if plain else len(_fields(row, delimiter))
        if found != width:
            raise RecordingError(
                f"{path}, line {number + 1}: {found} fields where the header has {width}: {row:.60}",
                remedy="correct that line, or cut it; a last line is broken where the recorder was stopped.",
            )


def _field_by_field(
    rows: Sequence[str], numbers: Sequence[int], wanted: dict[int, str], delimiter: str, path: Path
) -> Array:
    """The wanted columns, slowly: an empty field is NaN, and what is no number is named."""
    table = np.empty((len(rows), len(wanted)))
    for i, row in enumerate(rows):
        fields = _fields(row, delimiter)
        for k, (index, name) in enumerate(wanted.items()):
            cell = fields[index].strip()
            if cell and not _is_number(cell):
                hint = "write decimal points, not commas" if "," in cell else "correct that line, or cut it"
                raise RecordingError(
                    f"{path}, line {numbers[i] + 1}: {name} is {cell!r}, not a number.", remedy=f"{hint}."
                )
            table[i, k] = float(cell) if cell else np.nan
    return table
