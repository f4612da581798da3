"""Folders that are there whole or not at all: made under another name and renamed when they are complete."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from armid.errors import OutputError

__all__ = ["refuse", "whole_folder"]


@contextmanager
def whole_folder(folder: Path | str, marker: str, kind: str) -> Generator[Path]:
    """A draft to write into, which takes the folder's name when all has gone well.

    Args:
        folder: Where it goes. One of the same kind that is there already is replaced; anything else is left alone.
        marker: File by which a folder of this kind is known.
        kind: What messages call it.

    Raises:
        OutputError: The folder cannot be written, or holds something else.
    """
    folder = Path(folder)
    refuse(folder, marker, kind)
    target = folder.resolve()
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
            remedy="choose another folder with --out, one that is writable and has room.",
        ) from error
    finally:
        if draft is not None:
            shutil.rmtree(draft, ignore_errors=True)


def refuse(folder: Path | str, marker: str, kind: str) -> None:
    """Refuse a folder that cannot or must not be replaced, before any work is done for it.

    Args:
        folder: The folder.
        marker: File by which a folder of this kind is known.
        kind: What messages call it.

    Raises:
        OutputError: It holds something else, is the working folder, or lies where nothing can be written.
    """
    folder = Path(folder)
    try:
        taken = folder.exists() and not (folder / marker).is_file()
        taken = taken and (not folder.is_dir() or any(folder.iterdir()))
    except OSError as error:
        raise OutputError(
            f"{folder} cannot be used: {error.strerror}.", remedy="choose another with --out."
        ) from error
    if taken:
        raise OutputError(f"{folder} exists and is no {kind} of armid.", remedy="choose another folder with --out.")
    if folder.resolve() == Path.cwd():
        raise OutputError(f"{folder} is the working folder.", remedy="name a folder inside it with --out.")
    nearest = next(parent for parent in folder.resolve().parents if parent.exists())
    if not (nearest.is_dir() and os.access(nearest, os.W_OK | os.X_OK)):
        why = "is not writable" if nearest.is_dir() else "is a file"
        raise OutputError(f"{folder} cannot be written: {nearest} {why}.", remedy="choose another with --out.")


def _put_in_place(draft: Path, folder: Path) -> None:
    """Give a complete draft its name; what bore it before goes only when the draft is there."""
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
