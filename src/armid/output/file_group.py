"""Writing of several files that belong together: all of them or none."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from armid.errors import OutputError
from armid.output.interruption import deferred_signals
from armid.output.journal import replace_in, write_new
from armid.output.locks import WAITING, Lock, locked, resolved
from armid.output.renaming import put_in_place
from armid.output.written import add_written


def replace_files(
    folder: Path | str, files: Mapping[str, bytes | str], *, stale: Iterable[str] = ()
) -> tuple[Path, ...]:
    """Writes files of a folder, all of them or none.

    If the folder is new or has no other files, it is replaced in one step. Otherwise the complete files are moved
    into it one after the other; if the process ends in between, the next run that writes the folder completes this.

    Args:
        folder: The folder; other files in it are not changed.
        files: Contents by relative path.
        stale: Relative paths of files of an earlier result, which are removed.

    Returns:
        Paths of the files, in the order given.

    Raises:
        OutputError: A file cannot be written; then all files are as before.
    """
    given, folder = Path(folder), resolved(folder)
    data = {name: text.encode() if isinstance(text, str) else text for name, text in files.items()}
    stale = [*stale]
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with locked(folder, WAITING) as lock:
            if _is_own(folder, {*data, *stale}, lock):
                _replace_folder(lock, data)
            else:
                replace_in(folder, data, stale)
            add_written(given)
    except OSError as error:
        raise OutputError(
            f"{given} could not be written: {error.strerror or error}.",
            remedy="choose an existing and writable folder on a disk with enough free space.",
        ) from error
    return tuple(given / name for name in files)


def _is_own(folder: Path, names: set[str], lock: Lock) -> bool:
    """True if a folder does not exist, or has no other files, and its name can be exchanged."""
    if not os.path.lexists(folder):
        return True
    if lock.base == folder or folder == Path.cwd() or os.path.ismount(folder):
        return False
    return all(path.name in names and path.is_file() for path in folder.iterdir())


def _replace_folder(lock: Lock, files: Mapping[str, bytes]) -> None:
    """Writes all files into a new folder, which replaces the earlier one."""
    try:
        lock.draft.mkdir()
        for name, data in files.items():
            write_new(lock.draft / name, data)
        with deferred_signals():
            put_in_place(lock.draft, lock.target, lock.aside)
    finally:
        lock.clear()
