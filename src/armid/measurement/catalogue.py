"""Catalogue `READERS` of the formats of recordings. A new format needs a new module and one line here."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Protocol, cast

from armid.lazy_catalogue import Catalogue

if TYPE_CHECKING:
    from collections.abc import Iterator
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
class RecordingPieces:
    """Recording that is read piece by piece, so that it need not fit into memory.

    Attributes:
        samples: Number of samples of all pieces together, or an estimate of it.
        pieces: Successive parts of the recording as logged; they can be iterated once.
    """

    samples: int
    pieces: Iterator[Recording]


class PieceReader(Protocol):
    """Interface of a module that can read its format piece by piece, too."""

    @staticmethod
    def pieces(path: Path, log_format: LogFormat, robot: Robot | None, length: int) -> RecordingPieces | None:
        """Opens one file to be read in pieces of about `length` samples; `None` if it must be read as a whole."""
        ...


@dataclass(frozen=True, slots=True)
class RecordingFormat:
    """Format of recordings.

    Attributes:
        module: Module that reads this format.
        suffixes: Suffixes of files of this format, in lower case, with the dot.
        title: What a file of this format is, with its article, for messages.
        repair: What to do if a file is damaged.
        packings: Suffixes that are added to one of `suffixes` in the names of compressed files.
        ambiguous: Members of `suffixes` that are also usual for files that are not recordings.
        folder: Patterns of the files of a folder that is a recording of this format. A folder with a file of the
            first pattern has this format; a folder without such a file of any format counts as a bag.
    """

    module: str
    suffixes: tuple[str, ...]
    title: str = "a recording"
    repair: str = "copy the file again, because it may be damaged."
    packings: tuple[str, ...] = ()
    ambiguous: tuple[str, ...] = ()
    folder: tuple[str, ...] = ()

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

    @property
    def piece_reader(self) -> PieceReader | None:
        """Module that reads this format piece by piece; `None` if it only reads whole files."""
        module = import_module(self.module)
        return cast("PieceReader", module) if hasattr(module, "pieces") else None


TEXT_ALSO_OF_OTHERS = (".txt", ".dat", ".asc", ".log")

READERS: Catalogue[RecordingFormat] = Catalogue(
    {
        "csv": RecordingFormat(
            "armid.measurement.readers.csv",
            (".csv", ".tsv", *TEXT_ALSO_OF_OTHERS),
            "a text table",
            packings=(".gz", ".xz", ".bz2", ".zst"),
            ambiguous=TEXT_ALSO_OF_OTHERS,
        ),
        "parquet": RecordingFormat(
            "armid.measurement.readers.parquet",
            (".parquet", ".pq"),
            "Parquet",
            "copy the file again, because its end may be missing.",
        ),
        "npz": RecordingFormat("armid.measurement.readers.npz", (".npz",), "a NumPy archive"),
        "mat": RecordingFormat(
            "armid.measurement.readers.mat",
            (".mat",),
            "a MATLAB file of version 5 or 7.3",
            "save the file again with MATLAB or scipy.io.savemat, or copy it again if its end is missing.",
        ),
        "bag": RecordingFormat(
            "armid.measurement.readers.bag",
            (".bag", ".db3", ".mcap"),
            "a bag",
            "copy it again, or repair it (rosbag reindex, ros2 bag reindex).",
            packings=(".zstd",),
        ),
        "excel": RecordingFormat(
            "armid.measurement.readers.excel",
            (".xlsx", ".xlsm"),
            "a workbook",
            "copy the file again, or export the sheet as CSV.",
        ),
        "hdf5": RecordingFormat(
            "armid.measurement.readers.hdf5",
            (".hdf5", ".h5"),
            "HDF5",
            "copy the file again, because its end may be missing.",
        ),
        "lerobot": RecordingFormat(
            "armid.measurement.readers.lerobot",
            (),
            "a LeRobot data set",
            "copy the folder again.",
            folder=("meta/info.json", "data/*/*.parquet"),
        ),
        "sage": RecordingFormat(
            "armid.measurement.readers.sage",
            (),
            "a folder of SAGE",
            "copy the folder again.",
            folder=("state_motor.csv", "control.csv", "joint_list.txt", "event.csv"),
        ),
    }
)
"""Formats of recordings, by their names."""


def recording_suffixes() -> tuple[str, ...]:
    """Suffixes of all formats of recordings, without those of compressed files."""
    return tuple(suffix for each in READERS.values() for suffix in each.suffixes)


def recording_endings() -> tuple[str, ...]:
    """Endings of the names of all files that can be read as recordings; the folder of a ROS bag can be read, too."""
    return tuple(ending for each in READERS.values() for ending in each.endings)
