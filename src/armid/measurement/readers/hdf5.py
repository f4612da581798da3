"""Reader of HDF5 files: matrices with one row for each sample, among them the episodes of ALOHA."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import MissingExtraError, RecordingError
from armid.input_boundary import within_unpacked
from armid.measurement.catalogue import RecordingPieces
from armid.measurement.columns.column_selection import Selection, assemble, numeric, select
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot.robot import Robot

EXTRA = "io"

ALOHA = {"q": "observations/qpos", "dq": "observations/qvel", "command": "action"}
"""Data sets of an episode of ALOHA. It has no clock; its robots are recorded at 50 Hz."""

LARGEST_DIMENSION = 2
"""Largest number of dimensions of a data set that is read; images have more."""


def read(path: Path, log_format: LogFormat, robot: Robot | None = None) -> Recording:
    """Reads vectors and matrices of numbers; the names of columns are the paths of the data sets.

    In an episode of ALOHA, `observations/qpos` and `observations/qvel` are measured, and `action` is the command,
    unless the log format names other columns. The measured effort of ALOHA is a current in a unit of the servo and is
    only read if the log format names it.

    Raises:
        RecordingError: The file is not an HDF5 file, or a data set is missing or not numeric.
        MissingExtraError: h5py is not installed.
    """
    with _opened(path) as file:
        sizes = _sizes(file)

        def column(name: str) -> Array:
            refuse_other_files(file[name], file, path)
            within_unpacked(sizes[name], path, RecordingError)
            return numeric(np.asarray(file[name]), name, path)

        log_format = _as_aloha(sizes, log_format)
        selection = select(list(sizes), log_format, path, robot, matrices=True, values=column)
        return assemble(selection, column, log_format, path)


def pieces(path: Path, log_format: LogFormat, robot: Robot | None, length: int) -> RecordingPieces | None:
    """Pieces of a recording; `None` if the clock has two columns, or if data sets differ in length.

    Raises:
        RecordingError: As for `read`.
        MissingExtraError: h5py is not installed.
    """
    with _opened(path) as file:
        sizes = _sizes(file)
        log_format = _as_aloha(sizes, log_format)
        selection = select(
            list(sizes),
            log_format,
            path,
            robot,
            matrices=True,
            values=lambda name: _rows(file, name, 0, length, path),
        )
        for name in selection.names:
            within_unpacked(sizes[name], path, RecordingError)
        counts = {len(file[name]) for name in selection.names}
    if len(counts) > 1 or len(selection.time) > 1:
        return None
    (samples,) = counts
    return RecordingPieces(samples, _slices(path, selection, log_format, samples, length))


def _slices(
    path: Path, selection: Selection, log_format: LogFormat, samples: int, length: int
) -> Iterator[Recording]:
    """Yields the recording in slices of at most `length` rows."""
    with _opened(path) as file:
        for begin in range(0, samples, length):

            def column(name: str, begin: int = begin) -> Array:
                return _rows(file, name, begin, begin + length, path)

            yield assemble(selection, column, log_format, path)


def _rows(file: Any, name: str, begin: int, end: int, path: Path) -> Array:
    """Rows of a data set as numbers."""
    refuse_other_files(file[name], file, path)
    return numeric(np.asarray(file[name][begin:end]), name, path)


def _opened(path: Path) -> Any:
    """The open file."""
    try:
        import h5py
    except ImportError as error:
        raise MissingExtraError("h5py", "Reading HDF5", EXTRA) from error
    return h5py.File(path, "r")


def _sizes(file: Any) -> dict[str, float]:
    """Sizes of the vectors and matrices of numbers in a file, by path [bytes]."""
    sizes: dict[str, float] = {}

    def collect(name: str, item: Any) -> None:
        kind = getattr(item, "dtype", None)
        if kind is not None and kind.kind in "fiub" and 1 <= len(item.shape) <= LARGEST_DIMENSION:
            sizes[name] = float(item.size) * item.dtype.itemsize

    file.visititems(collect)
    return sizes


def _as_aloha(sizes: Mapping[str, float], log_format: LogFormat) -> LogFormat:
    """Log format with the data sets of ALOHA, if the file has them and the log format names no others."""
    if ALOHA["q"] not in sizes or "q" in log_format.columns:
        return log_format
    known = {key: name for key, name in ALOHA.items() if name in sizes}
    return replace(log_format, columns={"effort": "", **known, **log_format.columns})


def refuse_other_files(item: Any, file: Any, path: Path) -> None:
    """Raises an error if the content of a data set or group is not in its own file.

    HDF5 can link to other files, and declare any part of any file to be the numbers of a data set.

    Args:
        item: Data set or group of h5py.
        file: The open file.
        path: Path of the file, for the message.

    Raises:
        RecordingError: The content is in another file.
    """
    if item.file.filename != file.filename or getattr(item, "external", None) or getattr(item, "is_virtual", False):
        raise RecordingError(
            f"{path}: the content of {item.name} is in another file, which armid does not open.",
            remedy="copy the data into one file, for instance with h5repack.",
        )
