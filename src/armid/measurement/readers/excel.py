"""Reader of Excel workbooks: the first sheet with a row of column names above numbers."""

from __future__ import annotations

import importlib
import zipfile
from collections.abc import Sequence
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import MissingExtraError, RecordingError
from armid.input_boundary import within, within_unpacked
from armid.measurement.columns.column_selection import assemble, select
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot.robot import Robot

EXTRA = "io"

PACKAGE = "python_calamine"


def read(path: Path, log_format: LogFormat, robot: Robot | None = None) -> Recording:
    """Reads the first sheet of a workbook that has a row of column names above rows of numbers.

    Raises:
        RecordingError: The file is not a workbook, has no table, or a cell is not a number.
        MissingExtraError: python-calamine is not installed.
    """
    try:
        # Imported by name: it comes with an extra, and has no stubs.
        calamine = importlib.import_module(PACKAGE)
    except ImportError as error:
        raise MissingExtraError("python-calamine", "Reading workbooks", EXTRA) from error
    with zipfile.ZipFile(path) as archive:
        within_unpacked(sum(member.file_size for member in archive.infolist()), path, RecordingError)
    with calamine.CalamineWorkbook.from_path(str(path)) as book:
        opened = [book.get_sheet_by_name(name) for name in book.sheet_names]
        for sheet in opened:  # a cell far away makes a sheet of many empty cells
            within("samples", sheet.height * sheet.width, str(path), RecordingError)
        sheets = [((sheet.start or (0, 0))[0], sheet.to_python(skip_empty_area=True)) for sheet in opened]
    for first, rows in sheets:
        head = next((k for k, row in enumerate(rows) if _is_header(row)), None)
        if head is not None and len(rows) > head + 1:
            return _recording(rows, head, first, log_format, robot, path)
    raise RecordingError(
        f"{path} has no sheet with a table.",
        remedy="add a row with the names of the columns above the rows of numbers.",
    )


def _is_header(row: Sequence[Any]) -> bool:
    """Checks whether a row contains column names: at least two texts, and no number."""
    texts = [cell for cell in row if isinstance(cell, str) and cell.strip()]
    return len(texts) > 1 and all(isinstance(cell, str) for cell in row)


def _recording(
    rows: Sequence[Sequence[Any]], head: int, first: int, log_format: LogFormat, robot: Robot | None, path: Path
) -> Recording:
    """Reads the recording from the rows of a sheet.

    Args:
        rows: Rows of the sheet from its first row that is not empty.
        head: Index of the row with the column names.
        first: Number of empty rows of the sheet before `rows`.
        log_format: Names and units of the columns.
        robot: The arm, if known.
        path: Path of the workbook, for messages.
    """
    names = [str(cell).strip() for cell in rows[head]]
    body = [(k, row) for k, row in enumerate(rows[head + 1 :], first + head + 1) if any(cell != "" for cell in row)]

    def column(name: str) -> Array:
        k = names.index(name)
        return np.array([_number(row[k], f"{path}, row {i + 1}: {name}") for i, row in body])

    selection = select([name for name in names if name], log_format, path, robot, values=column)
    return assemble(selection, column, log_format, path)


def _number(cell: Any, where: str) -> float:
    """Converts a cell to a number: a date becomes seconds since 1970, an empty cell NaN."""
    if isinstance(cell, bool | int | float):
        return float(cell)
    if isinstance(cell, timedelta):
        return cell.total_seconds()
    if isinstance(cell, datetime):
        return (cell.replace(tzinfo=None) - datetime(1970, 1, 1)).total_seconds()
    if isinstance(cell, time):
        return 3600.0 * cell.hour + 60.0 * cell.minute + cell.second + 1e-6 * cell.microsecond
    if cell == "":
        return float("nan")
    if isinstance(cell, date):
        raise RecordingError(
            f"{where} is a date without a time of day.", remedy="name another time column under `columns`."
        )
    try:
        return float(str(cell).replace(",", "."))
    except ValueError:
        raise RecordingError(
            f"{where} is {cell!r}, not a number.", remedy="correct this cell, or remove its row."
        ) from None
