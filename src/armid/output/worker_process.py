"""Settings of worker processes: they leave signals to their parent, and end when it ends."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

PARENT_DEATH_SIGNAL = 1
"""Constant `PR_SET_PDEATHSIG` of Linux."""

PERIOD = 0.5
"""Time between two looks at the parent process, where the system does not report its end [s]."""


def follow_parent(parent: int) -> None:
    """Prepares a worker process: Ctrl-C is left to the parent, and the worker ends with it, also if it is killed.

    Args:
        parent: Number of the parent process.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
    if not _dies_with_parent():
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()
    if os.getppid() != parent:  # it ended before this was set
        os._exit(1)


def _dies_with_parent() -> bool:
    """Lets Linux kill this process when its parent ends; false on other systems."""
    if sys.platform != "linux":
        return False
    import ctypes

    return ctypes.CDLL(None).prctl(PARENT_DEATH_SIGNAL, signal.SIGKILL) == 0


def _watch(parent: int) -> None:
    """Ends this process when its parent has ended; on Windows, `getppid` keeps the number, so this has no effect."""
    while os.getppid() == parent:
        time.sleep(PERIOD)
    os._exit(1)
