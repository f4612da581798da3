"""Last handler of the command line: one line about an unexpected error, and a file with its trace."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Collection, Generator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from types import FrameType, SimpleNamespace
from typing import Any

from armid.output.written import written

UNEXPECTED = 70
"""Exit code after an error that armid did not expect, EX_SOFTWARE of sysexits.h."""

BROKEN_PIPE = 141
"""Exit code if the reader of the output has gone, as that of a process that SIGPIPE ends."""

BAD_OUTPUT = 2
"""Exit code if standard output cannot be written, that of bad input."""

INTERRUPTED = 130
"""Exit code of a command that the user has stopped."""

ENDED_BY = {"SIGTERM": "terminated", "SIGHUP": "terminated, because the terminal was closed"}
"""Signals that end a command as Ctrl-C does, and how the message begins; the exit code is 128 plus their number."""


AGAIN = 3.0
"""Time after which the end of a command is asked for again [s]; cleaning up takes less."""

_asked = SimpleNamespace(number=0)


class Terminated(SystemExit):
    """End of a command by a signal of `ENDED_BY`."""

    def __init__(self, number: int) -> None:
        super().__init__(128 + number)
        self.reason = ENDED_BY[signal.Signals(number).name]


@contextmanager
def ended_by_signals(blocked: Collection[int] = ()) -> Generator[None]:
    """Context in which the signals of `ENDED_BY` raise `Terminated`, unless the caller handles or ignores them.

    Args:
        blocked: Signals that are unblocked as soon as they are handled.
    """
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for number in (getattr(signal, name) for name in ENDED_BY if hasattr(signal, name)):
            if signal.getsignal(number) is signal.SIG_DFL:
                before[number] = signal.signal(number, _terminate)
    try:
        if blocked:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, blocked)
        yield
    finally:
        if hasattr(signal, "setitimer") and signal.getsignal(signal.SIGALRM) is _terminate_again:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
        for number, handler in before.items():
            signal.signal(number, handler)


def _terminate(number: int, frame: FrameType | None) -> None:
    """Raises `Terminated`; further signals wait until what was begun is removed.

    A signal may arrive while Python runs a function whose errors it ignores, such as one that is called at a fork or
    when an object is removed. So the error is raised again after a while.
    """
    del frame
    signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "setitimer") and signal.getsignal(signal.SIGALRM) is signal.SIG_DFL:
        _asked.number = number
        signal.signal(signal.SIGALRM, _terminate_again)
        signal.setitimer(signal.ITIMER_REAL, AGAIN, AGAIN)
    raise Terminated(number)


def _terminate_again(number: int, frame: FrameType | None) -> None:
    """Raises `Terminated` for the signal that came first."""
    del number, frame
    raise Terminated(_asked.number)


def stopped_line(reason: str) -> str:
    """Line about a command that was stopped: the reason, and what it had written before."""
    done = written()
    return f"{reason}; {'nothing was written' if not done else f'{done[0]} was written before'}\n"


def report_unexpected(error: BaseException, arguments: list[str]) -> str:
    """One line about an unexpected error, after the trace was written to a file in the folder of temporary files.

    Args:
        error: The error.
        arguments: Command line, which is written to the file, too.
    """
    try:
        handle, name = tempfile.mkstemp(prefix="armid-trace-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as stream:
            stream.write(f"armid {version('armid')}, Python {sys.version}\narmid {' '.join(arguments)}\n\n")
            stream.writelines(traceback.format_exception(error))
        place = f"the trace is in {name}"
    except OSError:
        place = "the trace could not be written"
    text = " ".join(f"{type(error).__name__} at {_places(error)}: {error}".split())[:300]
    return f"error armid failed in a way that it does not know: {text}; {place}; please report it"


def _places(error: BaseException) -> str:
    """Last place in armid, and place where the error was raised."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "armid" in Path(frame.filename).parts]
    places = [f"{Path(frame.filename).name}:{frame.lineno}" for frame in (*own[-1:], *frames[-1:])]
    return " from ".join(dict.fromkeys(places))


def discard_output() -> None:
    """Connects standard output to nothing, so that the end of the program does not fail on a broken pipe again."""
    try:
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, sys.stdout.fileno())
        os.close(nothing)
    except (OSError, ValueError, AttributeError):
        pass


def flushed(code: int) -> int:
    """Exit code of a command after its output was written out: another one than `code` if this fails."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        discard_output()
        return BROKEN_PIPE
    except (OSError, ValueError) as error:
        discard_output()
        with suppress(OSError, ValueError):
            sys.stderr.write(
                f"error The output could not be written: {getattr(error, 'strerror', None) or error}.\n"
                "hint: send standard output to a file on a disk with free space.\n"
            )
        return code or BAD_OUTPUT
    return code


def open_missing_streams() -> None:
    """Replaces standard streams that are closed by ones that discard what is written."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
