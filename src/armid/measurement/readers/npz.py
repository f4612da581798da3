"""Reader of NumPy archives, including those that armid saves: a matrix per quantity, or a vector per channel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.dataclass_files import load, refuse_large_archive
from armid.errors import RecordingError
from armid.input_boundary import boundary, naming
from armid.measurement.columns.column_selection import assemble, numeric, select
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot.robot import Robot

NAMES = ("joint_names", "names")
"""Names of variables in which the names of the channels are expected."""


def read(path: Path, log_format: LogFormat, robot: Robot | None = None) -> Recording:
    """Reads a NumPy archive; its content is never unpickled.

    Raises:
        RecordingError: The file is not an archive or needs pickle, or a variable is missing or not numeric.
    """
    try:
        # Opened here, because numpy leaves a damaged file open.
        with path.open("rb") as stream:
            archive = np.load(stream, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise RecordingError(
                    f"{path} is a single array, not an archive of named arrays.",
                    remedy="save an archive with numpy.savez(path, t=t, q=q, tau=tau).",
                )
            with archive:
                refuse_large_archive(archive, path, RecordingError)
                return _recording(archive, log_format, robot, path)
    except ValueError as error:
        if "pickle" in str(error):
            raise RecordingError(
                f"{path} contains Python objects, not only plain arrays. To read them, pickle would be needed; "
                "armid does not use it, because it can run any code.",
                remedy="save arrays of numbers with numpy.savez.",
            ) from error
        raise


def _recording(archive: np.lib.npyio.NpzFile, log_format: LogFormat, robot: Robot | None, path: Path) -> Recording:
    """Reads the recording from an open archive."""
    if "value.json" in archive.files:
        saved = load(Recording, path)
        with boundary("a saved recording", path, RecordingError, remedy="save it again."), naming(path):
            replace(log_format, **saved.guessed)
        consecutive = saved.consecutive if log_format.consecutive is None else log_format.consecutive
        return replace(saved, rate=log_format.rate or saved.rate, consecutive=consecutive)

    def values(name: str) -> Array:
        return numeric(archive[name], name, path)

    selection = select(archive.files, log_format, path, robot, matrices=True, values=values)
    arrays = {name: archive[name] for name in selection.names}

    def column(name: str) -> Array:
        return numeric(arrays[name], name, path)

    label = next((name for name in NAMES if name in archive.files), None)
    names = [] if label is None else [str(name) for name in archive[label].reshape(-1)]
    return assemble(selection, column, log_format, path, names)
