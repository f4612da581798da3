"""Locks of open files, which the system releases when their process ends, however it ends."""

from __future__ import annotations

import errno
import os
import sys

UNSUPPORTED = (errno.ENOLCK, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL)
"""Numbers of the errors of file systems without locks."""

BEYOND = 1 << 30
"""Position of the locked byte on Windows, where a locked byte cannot be read by others."""


def hold(handle: int) -> bool | None:
    """Locks an open file or folder for this process.

    Args:
        handle: Descriptor of the file.

    Returns:
        True if the file is locked now, false if another process has locked it, `None` if the file system has no
            locks.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(handle, BEYOND, os.SEEK_SET)
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES, errno.EAGAIN, errno.EDEADLK):
            return False
        if error.errno in UNSUPPORTED:
            return None
        raise
    return True


def is_same(handle: int, path: str | os.PathLike[str]) -> bool:
    """Tests whether an open file still has a given path."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path, follow_symlinks=False))
    except OSError:
        return False


def is_abandoned(path: str | os.PathLike[str]) -> int | None:
    """Locks a temporary file or folder of a process that has ended.

    Returns:
        Descriptor, which the caller closes after it has removed the file; `None` if the process still works, or if
        this cannot be determined.
    """
    try:
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0))
    except OSError:
        return None
    try:
        if hold(handle) and is_same(handle, path):
            return handle
    except OSError:
        pass
    os.close(handle)
    return None
