"""Renaming of a complete folder to its target, which exists before, during and after the renaming."""

from __future__ import annotations

import ctypes
import errno
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

AT_CURRENT_FOLDER, RENAME_EXCHANGE = -100, 2
"""Constants `AT_FDCWD` and `RENAME_EXCHANGE` of Linux."""

CANNOT_EXCHANGE = (errno.ENOSYS, errno.EINVAL, errno.ENOTSUP, errno.EPERM)
"""Numbers of the errors of kernels and file systems that cannot exchange two names."""


def put_in_place(draft: Path, target: Path, aside: Path) -> None:
    """Renames a complete folder to its target. An earlier folder at the target is at `draft` or `aside` afterwards.

    Linux exchanges both names in one step. Elsewhere the earlier folder is renamed to `aside` first; if the process
    ends between the two steps, `armid.output.locks` renames it back at the next run.

    Args:
        draft: The complete folder.
        target: Its target, in the same folder.
        aside: Name for the earlier folder.
    """
    if not os.path.lexists(target):
        draft.rename(target)
    elif not _exchange(draft, target):
        target.rename(aside)
        try:
            draft.rename(target)
        except BaseException:
            aside.rename(target)
            raise
    with suppress(OSError):  # the result is in its place; a power cut could at most bring the earlier one back
        synchronise(target.parent)


def synchronise(folder: Path) -> None:
    """Writes the entries of a folder to the disk, as far as the system can do this."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # file systems that have nothing to write
            raise
    finally:
        os.close(handle)


def _exchange(first: Path, second: Path) -> bool:
    """Exchanges the names of two folders in one step; false if this is not possible here."""
    call = _renameat2()
    if call is None:
        return False
    if call(AT_CURRENT_FOLDER, os.fsencode(first), AT_CURRENT_FOLDER, os.fsencode(second), RENAME_EXCHANGE) == 0:
        return True
    number = ctypes.get_errno()
    if number in CANNOT_EXCHANGE:
        return False
    raise OSError(number, os.strerror(number), str(second))


@cache
def _renameat2() -> Callable[..., int] | None:
    """Function `renameat2` of the C library; `None` if there is none."""
    if sys.platform != "linux":
        return None
    call = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if call is not None:
        call.argtypes = [ctypes.c_int, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_uint]
    return call
