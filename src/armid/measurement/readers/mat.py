"""Reader of MATLAB files: version 5 with SciPy, version 7.3 (which is HDF5) with h5py."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import MissingExtraError, RecordingError
from armid.input_boundary import within_unpacked
from armid.measurement.columns.column_selection import Selection, assemble, numeric, select
from armid.measurement.log_format import LogFormat
from armid.measurement.readers.hdf5 import refuse_other_files
from armid.measurement.recording import Recording
from armid.robot.robot import Robot

EXTRA = "io"

NAMES = ("joint_names", "names")
"""Names of cell arrays in which the names of the channels are expected."""

NUMERIC = frozenset("double single int8 int16 int32 int64 uint8 uint16 uint32 uint64 logical".split())
"""Names of the MATLAB classes of plain numbers."""

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"


def read(path: Path, log_format: LogFormat, robot: Robot | None = None) -> Recording:
    """Reads matrices from a MATLAB file, with one row per sample.

    Raises:
        RecordingError: The file is not a MATLAB file, a variable is missing, or it is an object, a struct or a cell
            array.
        MissingExtraError: The file has version 7.3, and h5py is not installed.
    """
    with path.open("rb") as stream:
        head = stream.read(520)
    if HDF5_SIGNATURE in (head[:8], head[512:520]):
        return _read_v73(path, log_format, robot)
    return _read_v5(path, log_format, robot)


def _read_v5(path: Path, log_format: LogFormat, robot: Robot | None) -> Recording:
    """Reads a MATLAB file of version 5 or older."""
    # Imported here, since it takes 0.3 s, which only MATLAB files need.
    from scipy.io import loadmat, whosmat

    listed = whosmat(path, appendmat=False)
    classes = {name: kind for name, _, kind in listed}
    for _, shape, kind in listed:
        if kind in NUMERIC:
            within_unpacked(8 * math.prod(map(float, shape)), path, RecordingError)

    def values(name: str) -> Array:
        _refuse_objects({name: classes[name]}, path)
        return numeric(loadmat(path, appendmat=False, variable_names=[name])[name], name, path)

    selection = select(list(classes), log_format, path, robot, matrices=True, values=values)
    _refuse_objects({name: classes[name] for name in selection.names}, path)
    labels = [name for name in NAMES if classes.get(name) in ("cell", "char")][:1]
    data = loadmat(path, appendmat=False, variable_names=[*selection.names, *labels])
    names = [str(cell).strip() for cell in _flat(data[labels[0]])] if labels else []
    return _assembled(selection, data, log_format, path, names)


def _read_v73(path: Path, log_format: LogFormat, robot: Robot | None) -> Recording:
    """Reads a MATLAB file of version 7.3, which is an HDF5 file that contains every matrix transposed."""
    try:
        import h5py
    except ImportError as error:
        raise MissingExtraError("h5py", "Reading MATLAB files of version 7.3", EXTRA) from error
    with h5py.File(path, "r") as file:
        for name in file:
            if isinstance(file.get(name, getlink=True), h5py.ExternalLink):
                raise RecordingError(
                    f"{path}: {name} is a link to another file, which armid does not open.",
                    remedy="copy the data into one file, for instance by saving it in MATLAB again.",
                )
        classes = {name: _class_v73(item) for name, item in file.items() if not name.startswith("#")}

        def matrix(name: str) -> NDArray[Any]:
            _refuse_objects({name: classes[name]}, path)
            item: Any = file[name]
            refuse_other_files(item, file, path)
            within_unpacked(float(item.size) * item.dtype.itemsize, path, RecordingError)
            return np.asarray(item)

        def values(name: str) -> Array:
            return numeric(matrix(name), name, path)

        selection = select(list(classes), log_format, path, robot, matrices=True, values=values)
        data = {name: np.atleast_2d(matrix(name)).T for name in selection.names}
        label = next((name for name in NAMES if classes.get(name) == "cell"), None)
        references = np.asarray(file[label]).reshape(-1) if label else []
        names = ["".join(map(chr, np.asarray(file[r]).reshape(-1))) for r in references]
    return _assembled(selection, data, log_format, path, names)


def _assembled(
    selection: Selection, data: dict[str, NDArray[Any]], log_format: LogFormat, path: Path, names: list[str]
) -> Recording:
    """Builds the recording from the variables of a file, whose matrices have one row for each sample."""
    # A vector may be a row or a column in MATLAB. It is one channel where each channel has a variable or there is one
    # joint; otherwise it is a matrix of one row.
    shapes = {data[name].shape for name in selection.names}
    one_joint = len({max(shape) for shape in shapes}) == 1 and all(min(shape) == 1 for shape in shapes)
    vectors = one_joint or len(selection.q) > 1

    def column(name: str) -> Array:
        values = numeric(data[name], name, path)
        return values.reshape(-1) if (vectors or name in selection.time) and 1 in values.shape else values

    return assemble(selection, column, log_format, path, names)


def _class_v73(item: Any) -> str:
    """Name of the MATLAB class of an HDF5 item."""
    kind = item.attrs.get("MATLAB_class")
    if kind is not None:
        return bytes(kind).decode()
    dtype = getattr(item, "dtype", None)
    if dtype is None:
        return "struct"
    return "double" if dtype.kind in "fiub" else "object"


def _refuse_objects(classes: dict[str, str], path: Path) -> None:
    for name, kind in classes.items():
        if kind not in NUMERIC:
            raise RecordingError(
                f"{path}: {name} has the class {kind!r}, but it must be a matrix of numbers.",
                remedy="save plain matrices: save('run.mat', 't', 'q', 'dq', 'tau').",
            )


def _flat(cells: NDArray[Any]) -> list[Any]:
    """Strings in a cell or char array, as a list."""
    return [cell.item() if isinstance(cell, np.ndarray) else cell for cell in np.asarray(cells).reshape(-1)]
