"""Catalogue `READERS` of the formats of recordings. A new format needs a new module and one line here."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Protocol, cast

from armid.lazy_catalogue import Catalogue

if TYPE_CHECKING:
    from pathlib import Path

    from armid.measurement.log_format import LogFormat
    from armid.measurement.recording import Recording
    from armid.robot.robot import Robot


class RecordingReader(Protocol):
    """Interface of a module that reads one format of recordings."""

    @staticmethod
    def read(path: Path, log_format: LogFormat, robot: Robot | None = None) -> Recording:
        """Reads one file; if the robot is given, its joint names may be used to find the columns.

        The function `load_recording` then adds the path to the recording.
        """
        ...


@dataclass(frozen=True, slots=True)
class RecordingFormat:
    """Format of recordings.

    Attributes:
        module: Module that reads this format.
        suffixes: Suffixes of files of this format, in lower case, with the dot.
        packings: Suffixes that are added to one of `suffixes` in the names of compressed files.
        ambiguous: Members of `suffixes` that are also usual for files that are not recordings.
        has_folders: True if a folder is a recording of this format.
    """

    module: str
    suffixes: tuple[str, ...]
    packings: tuple[str, ...] = ()
    ambiguous: tuple[str, ...] = ()
    has_folders: bool = False

    @property
    def packed(self) -> tuple[str, ...]:
        """Endings of the names of compressed files of this format, such as `.csv.gz`."""
        return tuple(f"{suffix}{packing}" for suffix in self.suffixes for packing in self.packings)

    @property
    def endings(self) -> tuple[str, ...]:
        """Endings of the names of all files of this format."""
        return *self.suffixes, *self.packed

    @property
    def reader(self) -> RecordingReader:
        """Module that reads this format; it is imported on first use."""
        return cast("RecordingReader", import_module(self.module))


TEXT_ALSO_OF_OTHERS = (".txt", ".dat", ".asc", ".log")

READERS: Catalogue[RecordingFormat] = Catalogue(
    {
        "csv": RecordingFormat(
            "armid.measurement.readers.csv",
            (".csv", ".tsv", *TEXT_ALSO_OF_OTHERS),
            packings=(".gz", ".xz", ".bz2", ".zst"),
            ambiguous=TEXT_ALSO_OF_OTHERS,
        ),
        "parquet": RecordingFormat("armid.measurement.readers.parquet", (".parquet", ".pq")),
        "npz": RecordingFormat("armid.measurement.readers.npz", (".npz",)),
        "mat": RecordingFormat("armid.measurement.readers.mat", (".mat",)),
        "bag": RecordingFormat(
            "armid.measurement.readers.bag", (".bag", ".db3", ".mcap"), packings=(".zstd",), has_folders=True
        ),
        "excel": RecordingFormat("armid.measurement.readers.excel", (".xlsx", ".xlsm")),
    }
)
"""Formats of recordings, by their names."""


def recording_suffixes() -> tuple[str, ...]:
    """Suffixes of all formats of recordings, without those of compressed files."""
    return tuple(suffix for each in READERS.values() for suffix in each.suffixes)


def recording_endings() -> tuple[str, ...]:
    """Endings of the names of all files that can be read as recordings; the folder of a ROS bag can be read, too."""
    return tuple(ending for each in READERS.values() for ending in each.endings)
