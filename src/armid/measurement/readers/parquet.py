"""Reader of Parquet tables."""

from __future__ import annotations

from pathlib import Path

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
    """Reads the needed columns from a Parquet file.

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

        def values(name: str) -> Array:
            return numeric(np.asarray(file.read(columns=[name])[name].to_numpy()), name, path)

        selection = select(file.schema_arrow.names, log_format, path, robot, values=values)
        within_unpacked(8 * file.metadata.num_rows * len(selection.names), path, RecordingError)
        table = file.read(columns=list(selection.names))

    def column(name: str) -> Array:
        return numeric(np.asarray(table[name].to_numpy()), name, path)

    return assemble(selection, column, log_format, path)
