"""Deferral of signals, so that Ctrl-C or SIGTERM cannot divide a change of the disk."""

from __future__ import annotations

import signal
from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def deferred_signals() -> Generator[None]:
    """Context in which signals that end a command wait; without effect where threads have no masks of signals."""
    mask = getattr(signal, "pthread_sigmask", None)
    if mask is None:
        yield
        return
    before = mask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGALRM})
    try:
        yield
    finally:
        mask(signal.SIG_SETMASK, before)
