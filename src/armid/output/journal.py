"""Replacement of several files of a folder whose other files stay: all of them, or none.

New files are written into a folder inside. When they are complete, this folder gets the name `COMMIT`, and then they
are moved to their places. If the process ends in between, the next one that writes the folder completes this.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from armid.output.interruption import deferred_signals
from armid.output.renaming import synchronise

DRAFT, COMMIT = ".armid-files.draft", ".armid-files.commit"
"""Names of the folder with new files, before and after they are complete."""

NEW, EARLIER, STALE = "new", "earlier", "stale.json"
"""Names in this folder: new files, the files that they replace, and names of files that are removed."""


def remove(path: Path) -> None:
    """Removes a file or folder, as far as this is possible."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with suppress(OSError):
            path.unlink()


def write_new(path: Path, data: bytes) -> None:
    """Writes a new file to the disk, with the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "xb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def replace_in(folder: Path, files: Mapping[str, bytes], stale: Iterable[str] = ()) -> None:
    """Replaces files of a folder; the caller has the lock of the folder.

    Args:
        folder: The folder, which exists.
        files: Contents by relative path.
        stale: Relative paths of files of an earlier result, which are removed.

    Raises:
        OSError: A file cannot be written; then all files are as before.
    """
    draft, commit = folder / DRAFT, folder / COMMIT
    removed = [name for name in stale if name not in files and (folder / name).is_file()]
    try:
        draft.mkdir()
        for name, data in files.items():
            write_new(draft / NEW / name, data)
            if (folder / name).is_dir():
                raise IsADirectoryError(21, "Is a directory", str(folder / name))
        for name in (*files, *removed):
            if (folder / name).is_file():
                _keep(folder / name, draft / EARLIER / name)
        write_new(draft / STALE, json.dumps(removed).encode())
        with deferred_signals():
            draft.rename(commit)
            try:
                synchronise(folder)
                finish(folder)
            except OSError:
                _restore(folder, files)
                raise
    finally:
        with deferred_signals():
            remove(draft)


def finish(folder: Path) -> None:
    """Moves complete new files to their places, and removes files of an earlier result; may be called again."""
    commit = folder / COMMIT
    new = commit / NEW
    for path in sorted(new.rglob("*")):
        if not path.is_dir():
            place = folder / path.relative_to(new)
            place.parent.mkdir(parents=True, exist_ok=True)
            os.replace(path, place)
    if (commit / STALE).is_file():  # else the process ended while it removed this folder
        for name in json.loads((commit / STALE).read_bytes()):
            (folder / name).unlink(missing_ok=True)
    synchronise(folder)
    remove(commit)


def _keep(path: Path, copy: Path) -> None:
    """Keeps a file under another name, too."""
    copy.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(path, copy)
    except OSError:  # a file system without links
        shutil.copy2(path, copy)


def _restore(folder: Path, names: Iterable[str]) -> None:
    """Puts the earlier files back, and removes new ones that replaced none."""
    earlier = folder / COMMIT / EARLIER
    for name in names:
        if not (earlier / name).is_file() and not (folder / COMMIT / NEW / name).exists():
            (folder / name).unlink(missing_ok=True)
    for path in sorted(earlier.rglob("*")) if earlier.is_dir() else ():
        if not path.is_dir():
            os.replace(path, folder / path.relative_to(earlier))
    remove(folder / COMMIT)
