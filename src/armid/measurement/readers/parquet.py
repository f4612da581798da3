"""Reader of Parquet tables."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import MissingExtraError, RecordingError
from armid.input_boundary import within, within_unpacked
from armid.measurement.columns.column_selection import assemble, numeric, select
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot.robot import Robot

EXTRA = "io"


def read(path: Path, log_format: LogFormat, robot: Robot | None = None) -> Recording:
    """Reads the needed columns from a Parquet file; the values of a column may be lists, one number for each joint.

    Raises:
        RecordingError: The file is truncated or not a Parquet file, or a column is missing or not numeric.
        MissingExtraError: pyarrow is not installed.
    """
    try:
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingExtraError("pyarrow", "Reading Parquet", EXTRA) from error
    with pq.ParquetFile(path) as file:
        within("samples", file.metadata.num_rows, str(path), RecordingError)

        lists = [each.name for each in file.schema_arrow if is_list(each.type)]

        def values(name: str) -> Array:
            return numbers(file.read(columns=[name])[name], name, path)

        selection = select(file.schema_arrow.names, log_format, path, robot, matrices=bool(lists), values=values)
        within_unpacked(8 * file.metadata.num_rows * len(selection.names), path, RecordingError)
        table = file.read(columns=list(selection.names))

    def column(name: str) -> Array:
        return numbers(table[name], name, path)

    return assemble(selection, column, log_format, path)


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
