"""Atomic writing of folders: a folder is written under a temporary name and renamed when it is complete."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from armid.errors import OutputError
from armid.output.interruption import deferred_signals
from armid.output.locks import PREFIX, PROBE, claim, complete, locked, resolved, sweep
from armid.output.renaming import put_in_place, synchronise
from armid.output.written import add_written


@contextmanager
def whole_folder(folder: Path | str, marker: str, kind: str) -> Generator[Path]:
    """Context manager that gives a draft folder, which replaces the target folder if the block ends without an error.

    Args:
        folder: Target folder. An existing folder with the file `marker` is replaced; any other folder is refused.
        marker: Name of a file that identifies a folder that may be replaced, for instance `plan.json`.
        kind: Name of such folders in messages, for instance `plan`.

    Raises:
        OutputError: The folder cannot be written, or has other contents.
    """
    refuse(folder, marker, kind)
    target = resolved(folder)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with locked(target) as lock:
            try:
                lock.draft.mkdir(mode=0o700)
                yield lock.draft
                mask = os.umask(0)
                os.umask(mask)
                lock.draft.chmod(0o777 & ~mask)
                synchronise(lock.draft)
                with deferred_signals():
                    put_in_place(lock.draft, target, lock.aside)
                    add_written(folder)
            finally:
                lock.clear()
    except OSError as error:
        raise OutputError(
            f"{folder} could not be written: {error.strerror or error}.",
            remedy="choose another folder with --out that is writable and has enough free space.",
        ) from error


def completed(folder: Path | str) -> Path:
    """Path of a folder to be read; files that a killed process had not yet put in their places are put there."""
    complete(folder)
    return Path(folder)


def refuse(folder: Path | str, marker: str, kind: str) -> None:
    """Raises an error, before any work is done, if a folder cannot or must not be replaced.

    Args:
        folder: The folder.
        marker: Name of a file that identifies a folder that may be replaced, for instance `plan.json`.
        kind: Name of such folders in messages, for instance `plan`.

    Raises:
        OutputError: The folder has other contents, is the current working folder, is not writable, or is being
            written by another process.
    """
    given, folder = folder, resolved(folder)  # `new/../old` is `old`, also where `new` does not exist yet
    try:
        taken = folder.exists() and not (folder / marker).is_file()
        taken = taken and (not folder.is_dir() or any(folder.iterdir()))
    except OSError as error:
        raise OutputError(
            f"{given} cannot be used: {error.strerror}.", remedy="choose another folder with --out."
        ) from error
    if taken:
        raise OutputError(
            f"The result cannot be written to {given}, because "
            + (f"the folder exists and is not a {kind} of armid." if folder.is_dir() else "this is a file."),
            remedy="choose another folder with --out.",
        )
    if folder == Path.cwd().resolve():
        raise OutputError(
            f"The result cannot be written to {given}, because this is the current working folder.",
            remedy="choose another folder with --out, for instance a new folder inside this one.",
        )
    nearest = next(parent for parent in folder.parents if parent.exists())
    try:
        sweep(nearest)
        with tempfile.TemporaryDirectory(prefix=PREFIX, suffix=PROBE, dir=nearest, ignore_cleanup_errors=True):
            pass
        claim(folder)
    except OSError as error:
        why = f"is not writable ({error.strerror or error})" if nearest.is_dir() else "is a file"
        raise OutputError(
            f"{given} cannot be written: {nearest} {why}.", remedy="choose another folder with --out."
        ) from error
