"""Atomic writing of folders: a folder is written under a temporary name and renamed when it is complete."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from armid.errors import OutputError


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
    target = Path(folder).resolve()
    draft: Path | None = None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(dir=target.parent, prefix=f".{target.name}."))
        yield draft
        mask = os.umask(0)
        os.umask(mask)
        draft.chmod(0o777 & ~mask)
        _put_in_place(draft, target)
    except OSError as error:
        raise OutputError(
            f"{folder} could not be written: {error.strerror or error}.",
            remedy="choose another folder with --out that is writable and has enough free space.",
        ) from error
    finally:
        if draft is not None:
            shutil.rmtree(draft, ignore_errors=True)


def refuse(folder: Path | str, marker: str, kind: str) -> None:
    """Raises an error, before any work is done, if a folder cannot or must not be replaced.

    Args:
        folder: The folder.
        marker: Name of a file that identifies a folder that may be replaced, for instance `plan.json`.
        kind: Name of such folders in messages, for instance `plan`.

    Raises:
        OutputError: The folder has other contents, is the current working folder, or is not writable.
    """
    given, folder = folder, Path(folder).resolve()  # `new/../old` is `old`, also where `new` does not exist yet
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
        with tempfile.TemporaryDirectory(prefix=".armid-", dir=nearest):
            pass
    except OSError as error:
        why = "is not writable" if nearest.is_dir() else "is a file"
        raise OutputError(
            f"{given} cannot be written: {nearest} {why}.", remedy="choose another folder with --out."
        ) from error


def _put_in_place(draft: Path, folder: Path) -> None:
    """Renames a complete draft folder to its target; an old folder at the target is deleted only afterwards."""
    if not folder.exists():
        draft.rename(folder)
        return
    old = folder.with_name(f".{folder.name}.old")
    shutil.rmtree(old, ignore_errors=True)
    folder.rename(old)
    try:
        draft.rename(folder)
    except BaseException:
        old.rename(folder)
        raise
    shutil.rmtree(old, ignore_errors=True)
