"""Reader of Parquet tables."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import MissingExtraError, RecordingError
from armid.input_boundary import within, within_unpacked
from armid.measurement.catalogue import RecordingPieces
from armid.measurement.columns.column_selection import Selection, assemble, numeric, select
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot.robot import Robot

EXTRA = "io"

BUFFER = 1 << 20
"""Size of the parts of a column that are read at a time [bytes], where a file is read in pieces."""


def read(path: Path, log_format: LogFormat, robot: Robot | None = None) -> Recording:
    """Reads the needed columns from a Parquet file; the values of a column may be lists, one number for each joint.

    Raises:
        RecordingError: The file is truncated or not a Parquet file, or a column is missing or not numeric.
        MissingExtraError: pyarrow is not installed.
    """
    with _pyarrow().ParquetFile(path) as file:
        within("samples", file.metadata.num_rows, str(path), RecordingError)
        selection = _selection(file, log_format, path, robot)
        within_unpacked(8 * file.metadata.num_rows * len(selection.names), path, RecordingError)
        table = file.read(columns=list(selection.names))

    def column(name: str) -> Array:
        return numbers(table[name], name, path)

    return assemble(selection, column, log_format, path)


def pieces(path: Path, log_format: LogFormat, robot: Robot | None, length: int) -> RecordingPieces | None:
    """Pieces of a recording, read one after the other; `None` if the clock has two columns, which are read together.

    Raises:
        RecordingError: As for `read`.
        MissingExtraError: pyarrow is not installed.
    """
    file = _pyarrow().ParquetFile(path, pre_buffer=False, buffer_size=BUFFER)  # else the whole file is kept in memory
    try:
        selection = _selection(file, log_format, path, robot, length) if file.metadata.num_rows else None
        if selection is None or len(selection.time) > 1:
            file.close()
            return None
        within_unpacked(8 * file.metadata.num_rows * len(selection.names), path, RecordingError)
    except BaseException:
        file.close()
        raise
    return RecordingPieces(file.metadata.num_rows, _batches(file, selection, log_format, path, length))


def _batches(file: Any, selection: Selection, log_format: LogFormat, path: Path, length: int) -> Iterator[Recording]:
    """Yields the recording in batches of at most `length` rows, and closes the file at the end."""
    with file:
        for batch in file.iter_batches(length, columns=list(selection.names)):
            table = _table(batch)
            yield assemble(selection, lambda name, rows=table: numbers(rows[name], name, path), log_format, path)


def _table(batch: Any) -> Any:
    """Table of Arrow with the rows of a batch."""
    return importlib.import_module("pyarrow").Table.from_batches([batch])


def _selection(
    file: Any, log_format: LogFormat, path: Path, robot: Robot | None, head: int | None = None
) -> Selection:
    """Columns of an open file that are read, chosen with the first `head` rows, or with all rows."""
    lists = [each.name for each in file.schema_arrow if is_list(each.type)]

    def values(name: str) -> Array:
        rows = file.read(columns=[name]) if head is None else _table(next(file.iter_batches(head, columns=[name])))
        return numbers(rows[name], name, path)

    return select(file.schema_arrow.names, log_format, path, robot, matrices=bool(lists), values=values)


def _pyarrow() -> Any:
    """Module of pyarrow that reads Parquet."""
    try:
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingExtraError("pyarrow", "Reading Parquet", EXTRA) from error
    return pq


def is_list(kind: Any) -> bool:
    """Checks whether the values of a column of this Arrow type are lists."""
    import pyarrow as pa

    return pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)


def numbers(column: Any, name: str, path: Path) -> Array:
    """Numbers of a column, shape (N,), or (N, n) if each value is a list of n numbers.

    Args:
        column: Chunked array of Arrow.
        name: Name of the column.
        path: The file, for messages.

    Raises:
        RecordingError: The column is not numeric, or its lists differ in length.
    """
    if not is_list(column.type):
        return numeric(np.asarray(column.to_numpy()), name, path)
    pc: Any = importlib.import_module("pyarrow.compute")  # its functions are made at import

    lengths = pc.unique(pc.list_value_length(column)).to_pylist()
    if len(lengths) > 1 or None in lengths:
        raise RecordingError(
            f"{path}: the lists in {name!r} have different lengths: "
            f"{', '.join('none' if each is None else str(each) for each in lengths[:5])}.",
            remedy="save one number for each joint in every row.",
        )
    flat = numeric(np.asarray(pc.list_flatten(column).to_numpy()), name, path)
    return flat.reshape(len(column), -1)
