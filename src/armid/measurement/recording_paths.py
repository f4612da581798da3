"""Paths of recordings: folders of several formats, episodes of a data set, and digests of their files."""

from __future__ import annotations

from pathlib import Path

from armid.hashes import digest, sha256_of_file
from armid.measurement.bag_files import data_files
from armid.measurement.catalogue import READERS, RecordingFormat

EPISODE = "#"
"""Separator of the folder of a data set and the number of an episode."""


def split_episode(path: Path) -> tuple[Path, int | None]:
    """Splits the path of an episode, `folder#3`, into folder and number; the number is `None` if there is none.

    A path that exists is never split.
    """
    before, separator, number = path.name.rpartition(EPISODE)
    if not (separator and before and number.isdecimal()) or path.exists():
        return path, None
    return path.with_name(before), int(number)


def recording_exists(path: Path) -> bool:
    """Checks whether a path is that of a file, of a folder, or of an episode in a folder."""
    folder, number = split_episode(path)
    return folder.exists() if number is None else folder.is_dir()


def format_of_folder(folder: Path) -> RecordingFormat:
    """Format of a folder with a recording, determined by the files in it."""
    found = (each for each in READERS.values() if each.folder and next(folder.glob(each.folder[0]), None) is not None)
    return next(found, READERS["bag"])


def sha256_of_recording(path: Path) -> str:
    """SHA-256, in hexadecimal digits, of a file, or of all data files of a folder and the number of an episode."""
    folder, number = split_episode(path)
    if not folder.is_dir():
        return sha256_of_file(path)
    patterns = format_of_folder(folder).folder
    files = [file for each in patterns for file in sorted(folder.glob(each))] or data_files(folder)
    digests = [sha256_of_file(file) for file in files]
    if number is not None:
        return digest(*digests, str(number))
    return digests[0] if len(digests) == 1 else digest(*digests)
