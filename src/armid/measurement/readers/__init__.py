"""Readers of recordings, one module for each format."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Protocol

from armid.errors import RecordingError
from armid.measurement.bag_files import COMPRESSED, STORAGE, is_packed, sha256_of_recording
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import bag, csv, excel, mat, npz, parquet
from armid.measurement.recording import Recording
from armid.robot.robot import Robot

__all__ = ["ENDINGS", "READERS", "RecordingReader", "load_recording"]


class RecordingReader(Protocol):
    """Interface of a reader module."""

    SUFFIXES: tuple[str, ...]
    """Suffixes of its files, in lower case, with the dot."""

    @staticmethod
    def read(path: Path, log_format: LogFormat, robot: Robot | None = None) -> Recording:
        """Reads one file, with the robot's joint names where given; `load_recording` adds the source."""
        ...


READERS: tuple[RecordingReader, ...] = (csv, parquet, npz, mat, bag, excel)
"""Catalogue of readers: a new format is a module here and a word in this line."""


ENDINGS: tuple[str, ...] = (
    *(suffix for reader in READERS for suffix in reader.SUFFIXES),
    *(f"{suffix}{packed}" for suffix in csv.SUFFIXES for packed in csv.PACKED),
    *(f"{suffix}{COMPRESSED}" for suffix in STORAGE),
)
"""Suffixes of readable files; the folder of a ROS bag is readable, too."""


def load_recording(path: Path | str, log_format: LogFormat | None = None, robot: Robot | None = None) -> Recording:
    """Reads a recording as in the file; `to_robot_convention` converts it to the robot's convention.

    Args:
        path: File in the format of its suffix, or the folder of a ROS bag.
        log_format: Log format of the file.
        robot: The arm, whose joint names select columns, topic and messages.

    Raises:
        RecordingError: The file is missing, empty, damaged, of an unknown format, or lacks a column.
        MissingExtraError: The format needs a package that is not installed.
    """
    path = Path(path)
    recording = _reader(path).read(path, log_format or LogFormat(), robot)
    return replace(recording, source=str(path), sha256=sha256_of_recording(path))


def _reader(path: Path) -> RecordingReader:
    """Reader module for a path."""
    if path.is_dir():
        return bag
    known = {suffix: reader for reader in READERS for suffix in reader.SUFFIXES}
    packed = path.suffix.lower() in csv.PACKED and Path(path.stem).suffix.lower() in csv.SUFFIXES
    reader = csv if packed else bag if is_packed(path) else known.get(path.suffix.lower())
    if reader is None:
        raise RecordingError(
            f"{path} is of an unknown format.",
            possible=f"{', '.join(known)}; text packed as .csv.gz, .xz, .bz2 or .zst; the folder of a ROS bag",
            remedy="export it in one of these, or give the file the suffix of its format.",
        )
    if not path.is_file():
        raise RecordingError(f"{path} does not exist.", remedy="check the path; a study's paths are relative to it.")
    if not path.stat().st_size:
        raise RecordingError(f"{path} is empty.", remedy="record again; nothing was written.")
    return reader
