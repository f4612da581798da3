"""Text tables: detection of encoding, header, units and delimiter, and conversion of the fields to numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, RecordingError
from armid.measurement.columns.column_name_parsing import unit_kind
from armid.notebook_display import plural

DELIMITERS = (",", ";", "\t")
"""Delimiters that are searched in a header; if it contains none of them, the columns are delimited by spaces."""

COMMENTS = ("#", "%", "//")
"""Beginnings of comment lines; the last comment line before the rows may be the header."""

PREAMBLE = 50
"""Largest number of lines with notes that may precede a header."""

LONGEST_NAME = 1000
"""Largest number of characters of the name of a column; the search for patterns in longer ones needs much memory."""

DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
MOMENT = re.compile(r"(\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d)?)(?:[.,](\d+))?\s*(Z|[+-]\d\d:?\d\d)?")
OF_DAY = re.compile(r"(\d\d?):(\d\d):(\d\d)(?:[.,](\d+))?")


@dataclass(frozen=True, eq=False, slots=True)
class TextTable:
    """Table in a text file, whose rows are not yet split into fields.

    Attributes:
        names: Names of the columns.
        rows: Text of each row, without the header.
        numbers: Line number of each row in the file, counted from 0.
        delimiter: Delimiter of fields.
        findings: Finding about the last row if it was left out because it is incomplete.
    """

    names: tuple[str, ...]
    rows: Sequence[str]
    numbers: Sequence[int]
    delimiter: str
    findings: tuple[Finding, ...] = ()

    def fields(self, k: int) -> list[str]:
        """Fields of row `k`, as texts."""
        return split(self.rows[k], self.delimiter)


def decoded(data: bytes, path: Path) -> str:
    """Decodes the content of a file as UTF-8, UTF-16 or, if neither fits, with the Windows code page 1252.

    Raises:
        RecordingError: The data are not text.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if not re.search(rb"[\x00-\x08\x0e-\x1f\x7f\x81\x8d\x8f\x90\x9d]", data):
            return data.decode("cp1252")
        line = data.count(b"\n", 0, error.start) + 1
        raise RecordingError(
            f"{path} is not a text file ({error.reason} in line {line}, byte {error.start}).",
            remedy="export the table as UTF-8 text, or give the file the suffix of its format; if only this line is "
            "damaged, correct or remove it.",
        ) from error


def table_of(text: str, path: Path) -> TextTable:
    """Splits a text into header and rows; an incomplete last row is left out, with a finding.

    Raises:
        RecordingError: There is no header or no row, or a row has too few or too many fields. The message names the
            line.
    """
    lines = text.splitlines()
    head = _header_index(lines, path)
    header = lines[head].lstrip("#%/").strip("\r\n ") if lines[head].startswith(COMMENTS) else lines[head].strip(" ")
    numbers = [i for i in range(head + 1, len(lines)) if lines[i].strip() and not lines[i].startswith(COMMENTS)]
    row = lines[numbers[0]] if numbers else ""
    # A delimiter stands in the rows as often; commas within names do not.
    delimiter = max(DELIMITERS, key=lambda each: (0 < header.count(each) == row.count(each), header.count(each)))
    delimiter = delimiter if delimiter in header else " "
    header = header if delimiter == "\t" else header.strip()
    names = [name.strip() for name in split(header, delimiter)]
    if len(max(names, key=len)) > LONGEST_NAME:
        raise RecordingError(
            f"{path}, line {head + 1} has a column name of {len(max(names, key=len))} characters: "
            f"{max(names, key=len)[:40]}….",
            possible=f"up to {LONGEST_NAME} characters",
            remedy="correct the line with the names of the columns.",
        )
    if numbers and (units := _units(split(lines[numbers[0]], delimiter), len(names))):
        names = [f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)]
        numbers = numbers[1:]
    rows = [lines[i] for i in numbers]
    if not rows:
        raise RecordingError(
            f"{path} has a header, but no rows.", remedy="record again, because no data were written."
        )
    names, rows = _without_ends(names, rows, delimiter)
    findings = _cut_end(rows, numbers[-1], len(names), delimiter, ended=text.endswith("\n"))
    rows, numbers = rows[: len(rows) - len(findings)], numbers[: len(numbers) - len(findings)]
    _check_widths(rows, numbers, len(names), delimiter, path)
    return TextTable(tuple(names), rows, numbers, delimiter, findings)


def rows_of(text: str, head: TextTable, lines: int, path: Path) -> TextTable:
    """Splits a part of a text into the rows of a table whose header is known.

    Args:
        text: Whole lines; the header and lines before it may be among them.
        head: Table with the first rows of the text.
        lines: Number of lines of the text before this part.
        path: Path of the text, for messages.

    Raises:
        RecordingError: A row has too few or too many fields.
    """
    width, found = len(head.names), text.splitlines()
    kept = [i for i, line in enumerate(found) if line.strip() and not line.startswith(COMMENTS)]
    kept = [i for i in kept if i + lines >= head.numbers[0]]
    if not kept:
        return TextTable(head.names, (), (), head.delimiter)
    _, rows = _without_ends(list(head.names), [found[i] for i in kept], head.delimiter)
    numbers = [i + lines for i in kept]
    findings = _cut_end(rows, numbers[-1], width, head.delimiter, ended=text.endswith("\n"))
    rows, numbers = rows[: len(rows) - len(findings)], numbers[: len(numbers) - len(findings)]
    _check_widths(rows, numbers, width, head.delimiter, path)
    return TextTable(head.names, rows, numbers, head.delimiter, findings)


def lists_of(table: TextTable) -> tuple[str, ...]:
    """Names of the columns with lists in their fields, such as `[0.1, 0.2]`, according to the first row."""
    first = table.fields(0)
    return tuple(name for name, cell in zip(table.names, first, strict=True) if cell.strip(' "').startswith("["))


def numbers_of(table: TextTable, wanted: Sequence[str], path: Path) -> dict[str, Array]:
    """Converts the wanted columns of a text table to numbers, by name; an empty field becomes NaN.

    A column has the shape (N,), a column of lists with n numbers each the shape (N, n).

    Raises:
        RecordingError: A field is not a number, two columns have the same name, or lists differ in length.
    """
    lists = [name for name in wanted if name in lists_of(table)]
    return _plain_numbers(table, [name for name in wanted if name not in lists], path) | _lists(table, lists, path)


def _lists(table: TextTable, wanted: Sequence[str], path: Path) -> dict[str, Array]:
    """Converts columns of lists to matrices of shape (N, n)."""
    if not wanted:
        return {}
    at = {name: table.names.index(name) for name in wanted}
    rows: dict[str, list[list[str]]] = {name: [] for name in wanted}
    for k in range(len(table.rows)):
        fields = table.fields(k)
        for name, index in at.items():
            cells = fields[index].strip(' "[]').replace(",", " ").split()
            if len(cells) != len(rows[name][0] if rows[name] else cells):
                raise RecordingError(
                    f"{path}, line {table.numbers[k] + 1}: {name} has {plural(len(cells), 'number')}, but "
                    f"{len(rows[name][0])} in the first row.",
                    remedy="correct or remove this line; each list must have one number for each joint.",
                )
            rows[name].append(cells)
    result: dict[str, Array] = {}
    for name, cells in rows.items():
        try:
            result[name] = np.array(cells, dtype=np.float64)
        except ValueError:
            k = next(k for k, row in enumerate(cells) if not all(map(is_number, row)))
            raise RecordingError(
                f"{path}, line {table.numbers[k] + 1}: {name} is {', '.join(cells[k])!r:.80}, which is not a list of "
                "numbers.",
                remedy="correct or remove this line.",
            ) from None
    return result


def _plain_numbers(table: TextTable, wanted: Sequence[str], path: Path) -> dict[str, Array]:
    """Converts columns of single numbers, shape (N,) each, by name; an empty field becomes NaN."""
    for name in wanted:
        if table.names.count(name) > 1:
            raise RecordingError(
                f"{path}: {table.names.count(name)} columns have the same name {name!r}.",
                remedy="rename these columns, or name other columns under `columns`.",
            )
    if not wanted:
        return {}
    at = [table.names.index(name) for name in wanted]
    rows, first = table.rows, table.fields(0)
    if table.delimiter != "," and any(DECIMAL_COMMA.fullmatch(first[k]) for k in at):
        rows = [row.replace(",", ".") for row in rows]
    try:
        plain = None if table.delimiter == " " else table.delimiter
        values = np.loadtxt(rows, delimiter=plain, usecols=at, comments=None, quotechar='"', ndmin=2)
    except ValueError:
        values = _field_by_field(table, dict(zip(at, wanted, strict=True)), path)
    return dict(zip(wanted, values.T, strict=True))


def seconds_of(table: TextTable, name: str, path: Path) -> Array | None:
    """Converts a column of dates or times of day to seconds, shape (N,); `None` if the column contains numbers.

    The seconds count from the last whole second before the first row.

    Raises:
        RecordingError: A field is neither a date nor a time of day.
    """
    at = table.names.index(name)
    if is_number(table.fields(0)[at]) or not table.fields(0)[at].strip(' "'):
        return None
    whole = np.empty(len(table.rows))
    part = np.empty(len(table.rows))
    for k in range(len(table.rows)):
        cell = table.fields(k)[at].strip().strip('"')
        try:
            whole[k], part[k] = _moment(cell)
        except ValueError:
            raise RecordingError(
                f"{path}, line {table.numbers[k] + 1}: {name} is {cell!r}, which is neither a number nor a time.",
                possible="2026-05-01T12:00:00.125Z, 2026-05-01 12:00:00.125+02:00, 12:00:00.125",
                remedy="correct this line, or name another time column.",
            ) from None
    return (whole - whole[0]) + part


def _moment(cell: str) -> tuple[float, float]:
    """Converts a date or a time of day to whole seconds and a fraction; a date without a time zone is UTC."""
    hit = MOMENT.fullmatch(cell)
    if hit:
        moment = datetime.fromisoformat(f"{hit[1].replace(' ', 'T')}{hit[3] or ''}")
        moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
        return moment.timestamp(), float(f"0.{hit[2] or 0}")
    hit = OF_DAY.fullmatch(cell)
    if not hit:
        raise ValueError(cell)
    return 3600.0 * int(hit[1]) + 60.0 * int(hit[2]) + int(hit[3]), float(f"0.{hit[4] or 0}")


def split(line: str, delimiter: str) -> list[str]:
    """Splits a line into its fields; delimiters inside quotes do not separate fields."""
    if '"' in line:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    return line.split() if delimiter == " " else line.split(delimiter)


def is_number(text: str) -> bool:
    """Checks whether a field is a number, with a decimal point or a decimal comma."""
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _header_index(lines: Sequence[str], path: Path) -> int:
    """Index of the line with the column names: the first line that is no comment, or the comment above the rows."""
    plain = [
        i for i, line in enumerate(lines) if line.strip() and not line.startswith(COMMENTS) and line[:4] != "sep="
    ]
    if not plain:
        raise RecordingError(f"{path} is empty.", remedy="record again, because no data were written.")
    first = plain[0]
    if not _begins_with_number(lines[first]):
        return _after_notes(lines, plain[: PREAMBLE + 1])
    above = next((i for i in range(first - 1, -1, -1) if lines[i].strip()), -1)
    if above >= 0 and lines[above].startswith(COMMENTS):
        return above
    raise RecordingError(
        f"{path} has no header: line {first + 1} begins with the number {lines[first].strip()[:20]!r}….",
        remedy="add a first line with the names of the columns, for instance t,q1,q2,tau1,tau2.",
    )


def _after_notes(lines: Sequence[str], plain: Sequence[int]) -> int:
    """Index of the header if lines of notes precede it: the first line with as many fields as the rows."""
    below = next((k for k, i in enumerate(plain) if k and _begins_with_number(lines[i])), 0)
    row = lines[plain[below]]
    for k in range(below):
        line = lines[plain[k]]
        delimiter = max(DELIMITERS, key=line.count)
        if delimiter in line and abs(line.count(delimiter) - row.count(delimiter)) <= 1:
            return plain[k]
    return plain[0]


def _begins_with_number(line: str) -> bool:
    field = re.split(r"[,;\t ]", line.strip())[0].strip('"')
    return is_number(field) or bool(re.match(r"\d{4}-\d\d-\d\d|\d\d?:\d\d:\d\d", field))


def _units(fields: Sequence[str], count: int) -> list[str]:
    """Units in the line below the column names, one for each column; units of armid are replaced by empty texts.

    The result is empty if the line is not a line of units.
    """
    units = [field.strip().strip("[]()") for field in fields]
    if (
        len(units) != count
        or not any(units)
        or any(unit and unit != "-" and unit_kind(unit) is None for unit in units)
    ):
        return []
    return [
        unit if unit_kind(unit) not in (None, ("rad", 1.0), ("m", 1.0), ("torque", 1.0), ("time", 1.0)) else ""
        for unit in units
    ]


def _without_ends(names: list[str], rows: list[str], delimiter: str) -> tuple[list[str], list[str]]:
    """Removes delimiters at the ends of the header and of the rows."""
    if delimiter == " ":
        return names, rows
    more = len(split(rows[0], delimiter)) - len(names)
    if more == 1 and rows[0].rstrip().endswith(delimiter.strip() or delimiter):
        end = len(delimiter)
        return names, [row[:-end] if row.endswith(delimiter) else row for row in (each.rstrip(" ") for each in rows)]
    return (names[:-1], rows) if more == -1 and not names[-1] else (names, rows)


def _cut_end(rows: Sequence[str], number: int, width: int, delimiter: str, *, ended: bool) -> tuple[Finding, ...]:
    """Finding that the last row was not written completely; empty if it is complete, or if it is the only row.

    Args:
        rows: Lines of the table.
        number: Line number of the last row, counted from 0.
        width: Number of columns.
        delimiter: Delimiter of fields.
        ended: True if the text ends with an end of line.
    """
    if len(rows) < 2:
        return ()
    before, last = (split(row, delimiter) for row in rows[-2:])
    cut_number = not ended and is_number(before[-1]) and not is_number(last[-1])
    if len(last) < width:
        what = f"has {len(last)} of {width} fields"
    elif len(last) == width and cut_number:
        what = f"ends with {last[-1]!r} in place of a number"
    else:
        return ()
    evidence = (
        f"The last row, line {number + 1}, {what}: the recorder was probably stopped while it wrote. This row is "
        f"left out; the {len(rows) - 1} rows before it are used."
    )
    remedy = "check that the recording was not stopped too early; to avoid this warning, remove the line."
    return (Finding("row-incomplete", "warning", "", evidence, remedy),)


def _check_widths(rows: Sequence[str], numbers: Sequence[int], width: int, delimiter: str, path: Path) -> None:
    """Raises an error if a row has more or fewer fields than the header."""
    for k, (row, number) in enumerate(zip(rows, numbers, strict=True)):
        plain = delimiter != " " and '"' not in row
        found = row.count(delimiter) + 1 if plain else len(split(row, delimiter))
        if found != width:
            raise RecordingError(
                f"{path}, line {number + 1} has {plural(found, 'field')}, but the header has {width}"
                f"{_rows_behind(len(rows) - 1 - k)}: {row:.60}",
                remedy="correct or remove this line.",
            )


def _rows_behind(count: int) -> str:
    """Text with the number of rows after a faulty line, which indicates whether the end of the file is missing."""
    if not count:
        return ", and it is the last row"
    return f", and {plural(count, 'row')} follow{'s' if count == 1 else ''} it"


def _field_by_field(table: TextTable, wanted: dict[int, str], path: Path) -> Array:
    """Converts columns field by field, which is slow; an empty field becomes NaN, other text is an error.

    `wanted` maps the index of each column to its name. The result has shape (N, columns).
    """
    values = np.empty((len(table.rows), len(wanted)))
    for i in range(len(table.rows)):
        fields = table.fields(i)
        for k, (index, name) in enumerate(wanted.items()):
            cell = fields[index].strip()
            if cell and not is_number(cell):
                raise RecordingError(
                    f"{path}, line {table.numbers[i] + 1}: {name} is {cell!r}, not a number.",
                    remedy="correct or remove this line; numbers must not contain thousands separators.",
                )
            values[i, k] = float(cell.replace(",", ".")) if cell else np.nan
    return values
