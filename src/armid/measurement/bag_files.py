"""Files of ROS bags: folders (ROS 2), files (ROS 1), and single files from a folder."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from armid.errors import MissingExtraError, RecordingError
from armid.input_boundary import most_unpacked, within_unpacked
from armid.measurement.catalogue import READERS
from armid.output.scratch import scratch_folder

BLOCK = 1 << 20
"""Number of bytes that are unpacked at once."""

METADATA = "metadata.yaml"

STORAGE: tuple[str, ...] = READERS["bag"].suffixes
"""Suffixes of the files in which bags store messages."""

(COMPRESSED,) = READERS["bag"].packings
"""Suffix that ROS 2 adds to the name of a compressed file."""

OURS = {
    "plan.json": (
        "the folder is a plan of armid excite, not a recording; simulate the plan, or give a recording of its motion."
    ),
    "estimate.json": "the folder is a run of armid identify, not a recording; give a recording.",
}
"""Remedies for folders that armid has written and that are not recordings, by the name of a file in the folder."""


def is_packed(path: Path) -> bool:
    """Checks whether a path is a single bag file that ROS 2 has compressed as a whole, such as `run_0.db3.zstd`."""
    return path.name.lower().endswith(READERS["bag"].packed)


@contextmanager
def opened(path: Path) -> Generator[list[Path]]:
    """Context manager that gives the paths to open for a bag; compressed files are unpacked to a temporary folder.

    Raises:
        RecordingError: The folder has no bag, or a file cannot be decompressed.
        MissingExtraError: No module for zstd is installed.
    """
    if path.is_dir() or not is_packed(path):
        yield bag_paths(path)
        return
    with scratch_folder() as folder:
        plain = folder / path.name[: -len(COMPRESSED)]
        zstd = _zstd()
        try:
            most = most_unpacked(path)
            with zstd.open(path) as stream, plain.open("wb") as copy:
                while block := stream.read(BLOCK):
                    copy.write(block)
                    if copy.tell() > most:
                        within_unpacked(copy.tell(), path, RecordingError)
        except (zstd.ZstdError, EOFError, ValueError, OSError) as error:
            raise RecordingError(
                f"{path} cannot be unpacked ({error}).", remedy="copy the file again, because its end may be missing."
            ) from error
        yield [plain]


def _zstd() -> Any:
    """Imports the Python module that unpacks zstd: from the standard library, or the one that rosbags installs."""
    name = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingExtraError(name.partition(".")[0], "Unpacking a compressed bag", "io") from error


def bag_paths(path: Path) -> list[Path]:
    """Paths to open for a bag: the path itself, or the message files if it is a folder without metadata.

    Raises:
        RecordingError: The folder has no bag.
    """
    if not path.is_dir() or (path / METADATA).is_file():
        return [path]
    files = data_files(path)
    kinds = sorted({file.suffix.lower() for file in files})
    if len(kinds) == 1 and kinds[0] != COMPRESSED:
        return files
    known = next((remedy for name, remedy in OURS.items() if (path / name).is_file()), "")
    found = ", ".join(sorted(file.name for file in path.iterdir())[:10]) or "nothing"
    raise RecordingError(
        f"{path} is a folder without a bag: it has no {METADATA}; found {found}.",
        possible=f"a bag folder of ROS 2 has {METADATA} and its .db3 or .mcap files, one of ROS 1 has .bag files; "
        "other recordings are single files",
        remedy=known
        or f"give the folder that ros2 bag record has written, or a single file; if {METADATA} is lost, "
        "ros2 bag reindex writes it again.",
    )


def data_files(folder: Path) -> list[Path]:
    """Files with messages in a folder, sorted by name; compressed files are included."""
    return sorted(
        file
        for file in folder.iterdir()
        if file.is_file() and file.name.lower().removesuffix(COMPRESSED).endswith(STORAGE)
    )
