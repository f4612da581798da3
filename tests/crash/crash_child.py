"""A command in a process of its own that is killed, or whose disk is full, at a chosen moment."""

from __future__ import annotations

import contextlib
import errno
import os
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crash_scenes import Command

NEEDING = {"os.mkdir", "os.rename", "os.link", "os.chmod", "os.truncate"}
"""Events of the interpreter that may need space on the disk, beside the opening of a file for writing."""

REMOVING = {"os.remove", "os.rmdir"}
"""Events that change the disk, but never need space."""

WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT

LONGEST = 120.0
"""Time after which a command that was not killed counts as hung [s]."""


@dataclass(frozen=True, slots=True)
class Moment:
    """Moment of a disturbance.

    Attributes:
        after: Time after the start of the command at which it gets a signal [s]; `None` for none.
        by: Number of the signal.
        at: Number of the change of the disk before which it is killed, or which fails; `None` for none.
        full: True if the change fails because the disk is full.
        largest: Largest size of a file [bytes], as a quota; `None` for no limit.
    """

    after: float | None = None
    by: int = signal.SIGKILL
    at: int | None = None
    full: bool = False
    largest: int | None = None


@dataclass(frozen=True, slots=True)
class Ended:
    """End of a command: exit code (negative for a signal), messages, time [s], changes of the disk, processes."""

    code: int
    err: str
    seconds: float
    changes: int
    left: int


def run_disturbed(command: Command, folder: Path, moment: Moment = Moment(), environment: Any = None) -> Ended:
    """Runs a command in a folder, with a disturbance.

    Args:
        command: The command.
        folder: Working folder.
        moment: The disturbance; by default none.
        environment: Function that is called in the process before the command.
    """
    said = folder.parent / "said"
    said.mkdir(exist_ok=True)
    (said / "changes").write_text("0")
    (said / "err").write_text("")
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if not child:
        _be_child(command, folder, said, moment, environment)
    begin = time.monotonic()
    state, sent = None, False
    while state is None:
        done, status = os.waitpid(child, os.WNOHANG)
        passed = time.monotonic() - begin
        if done:
            state = status
        elif passed > LONGEST:
            os.kill(child, signal.SIGKILL)
        elif moment.after is not None and passed >= moment.after and not sent:
            os.kill(child, moment.by)
            sent = True
        else:
            time.sleep(0.0005)
    seconds = time.monotonic() - begin
    return Ended(
        os.waitstatus_to_exitcode(state),
        (said / "err").read_text(errors="replace"),
        seconds,
        int((said / "changes").read_text() or 0),
        _processes_left(child),
    )


def _processes_left(session: int, patience: float = 2.0) -> int:
    """Number of processes of a session that still live after some time [s]; those that do are killed."""
    end = time.monotonic() + patience
    while (alive := _members(session)) and time.monotonic() < end:
        time.sleep(0.01)
    for each in alive:
        with contextlib.suppress(OSError):
            os.kill(each, signal.SIGKILL)
    return len(alive)


def _members(session: int) -> list[int]:
    """Processes of a session that have not ended."""
    found: list[int] = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = path.read_text().rsplit(")", 1)[1].split()
            if int(fields[3]) == session and fields[0] not in "ZX":
                found.append(int(path.parent.name))
    return found


def _be_child(command: Command, folder: Path, said: Path, moment: Moment, environment: Any) -> None:
    """Runs a command in this process, and ends the process."""
    for each in (signal.SIGTERM, signal.SIGHUP):  # a shell may start the tests with these ignored
        signal.signal(each, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    status = 99
    try:
        os.setsid()
        for name, stream in (("out", 1), ("err", 2)):
            os.dup2(os.open(said / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.environ["TMPDIR"] = tempfile.tempdir = str(folder.parent / "tmp")
        os.makedirs(tempfile.tempdir, exist_ok=True)
        os.chdir(folder)
        if environment is not None:
            environment()
        sys.stdout = os.fdopen(1, "w", closefd=False)  # else it takes the stream for that of the parent process
        sys.stderr = os.fdopen(2, "w", buffering=1, errors="backslashreplace", closefd=False)
        if moment.largest is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (moment.largest, moment.largest))
        count = _watch_changes(moment)
        from armid.cli.entry import main

        sys.argv = ["armid", *command]
        try:
            main()
            status = 0
        except SystemExit as ended:
            status = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
        except BaseException as error:
            os.write(2, f"\nTraceback: {error!r}\n".encode("utf-8", "replace"))
        count.stop()
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2) if os.geteuid() == 0 else None
        (said / "changes").write_text(str(count.number))
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(Exception):
                stream.flush()
    finally:
        os._exit(status & 0xFF)


class _Changes:
    """Counter of the changes of the disk by this process."""

    def __init__(self, act: Callable[[int], None], *, space_only: bool) -> None:
        self.number = 0
        self._space_only = space_only
        self._act, self._process, self._active = act, os.getpid(), True

    def stop(self) -> None:
        """Ends the counting."""
        self._active = False

    def add(self) -> None:
        """Counts a change that is about to happen."""
        if self._active and os.getpid() == self._process:
            self.number += 1
            self._act(self.number)

    def hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Counts an event of the interpreter if it changes the disk."""
        if event == "open":
            counts = bool(arguments[2] and arguments[2] & WRITING) and not str(arguments[0]).startswith("/dev/")
        else:
            counts = event in NEEDING or (event in REMOVING and not self._space_only)
        if counts:
            self.add()


def _watch_changes(moment: Moment) -> _Changes:
    """Counts changes of the disk, and kills this process or fails at the chosen one."""
    from armid.output import renaming

    def act(number: int) -> None:
        if number != moment.at:
            return
        if moment.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        os.kill(os.getpid(), signal.SIGKILL)

    changes = _Changes(act, space_only=moment.full)
    fsync, exchange = os.fsync, renaming._exchange

    def counted_fsync(handle: int) -> None:
        changes.add()
        fsync(handle)

    def counted_exchange(first: Path, second: Path) -> bool:
        changes.add()
        done = exchange(first, second)
        if not moment.full:  # killed after the exchange, before what follows
            changes.add()
        return done

    os.fsync, renaming._exchange = counted_fsync, counted_exchange
    sys.addaudithook(changes.hear)
    return changes
