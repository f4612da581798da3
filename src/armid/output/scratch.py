"""Folders for temporary files, which the next run removes if this process is killed."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

from armid.output.held_files import hold, is_abandoned

PREFIX = "armid-scratch-"
"""Beginning of the names of these folders."""


@contextmanager
def scratch_folder() -> Generator[Path]:
    """Context with a new folder among the temporary files of the system."""
    folder, handle = _held(Path(tempfile.gettempdir()))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if handle is not None:
            os.close(handle)


def remove_abandoned() -> None:
    """Removes the folders of killed processes; called by the command line at the beginning of a command."""
    with suppress(OSError):
        for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}*") if os.name != "nt" else ():
            handle = is_abandoned(path)
            if handle is not None:
                shutil.rmtree(path, ignore_errors=True)
                os.close(handle)


def _held(place: Path) -> tuple[Path, int | None]:
    """New folder, and the descriptor that locks it as long as this process lives."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=PREFIX, dir=place))
        if os.name == "nt":  # folders cannot be locked
            return folder, None
        handle = os.open(folder, os.O_RDONLY)
        if hold(handle) is not False and folder.exists():
            return folder, handle
        os.close(handle)  # taken for one of a killed process before it was locked
