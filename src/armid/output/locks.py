"""Locks of output folders: one process writes a folder, another is told which; leftovers of killed ones are removed.

A lock is a file next to the folder, `.armid-KEY.lock`, which is locked as long as its process lives. The key is made
from the name of the folder. The process that has the lock owns `.armid-KEY.draft` (the folder that is being written)
and `.armid-KEY.old` (the earlier folder, on systems that cannot exchange names). So these files are leftovers if
nobody has the lock. Where the folder's parent cannot be written, the lock is in the folder, with the key of `.`.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import os
import shutil
import socket
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from armid.errors import OutputError
from armid.output.held_files import hold, is_abandoned, is_same
from armid.output.interruption import deferred_signals
from armid.output.journal import COMMIT, DRAFT, finish, remove

PREFIX = ".armid-"
"""Beginning of the names of all temporary files and folders."""

PART, PROBE = ".part", ".probe"
"""Ends of the names of temporary files, and of folders that test if a folder can be written."""

WAITING = 10.0
"""Time for which a short write waits for another one [s]."""

_state = SimpleNamespace(claiming="", swept=set[str]())
_held: dict[Path, Lock] = {}


@dataclass(slots=True)
class Lock:
    """A lock that this process has.

    Attributes:
        target: The folder to be written.
        base: The folder in which the lock is.
        key: Key in the names of lock, draft and earlier folder.
        handle: Descriptor of the lock.
        thread: Thread that uses the lock.
        users: Number of blocks that use the lock.
    """

    target: Path
    base: Path
    key: str
    handle: int
    thread: int
    users: int = 0

    @property
    def draft(self) -> Path:
        """Folder that is being written."""
        return self.base / f"{PREFIX}{self.key}.draft"

    @property
    def aside(self) -> Path:
        """Earlier folder, while it is being replaced."""
        return self.base / f"{PREFIX}{self.key}.old"

    def clear(self) -> None:
        """Removes draft and earlier folder, but never the only copy of a result."""
        with deferred_signals():
            remove(self.draft)
            if os.path.lexists(self.target):
                remove(self.aside)


def start_claims(command: str) -> None:
    """Lets `claim` keep locks until `end_claims`; called by the command line at the beginning of a command.

    Args:
        command: Name of the command, for the message to another process.
    """
    _state.claiming = command
    _state.swept.clear()


def end_claims() -> None:
    """Gives up all locks that are not in use."""
    _state.claiming = ""
    for lock in list(_held.values()):
        if not lock.users:
            _release(lock)


def resolved(target: Path | str) -> Path:
    """Absolute path of a folder for output, without links.

    Raises:
        OutputError: Links lead in a loop, or the working folder was removed.
    """
    try:
        return Path(target).resolve()
    except (OSError, RuntimeError, ValueError) as error:
        raise OutputError(
            f"{target} cannot be used: {getattr(error, 'strerror', None) or error}.",
            remedy="choose another folder with --out.",
        ) from error


def claim(target: Path | str) -> None:
    """Locks a folder that a command will write after its computation, so that no other command begins the same.

    Without effect outside of the command line, and if the folder in which the lock would be does not exist yet.

    Raises:
        OutputError: Another process writes the folder, or it cannot be written.
    """
    given, target = target, resolved(target)
    base, _ = _place(target)
    try:
        if _state.claiming and base.is_dir():
            _acquire(target)
    except OSError as error:
        raise OutputError(
            f"{given} cannot be written: {error.strerror or error}.",
            remedy="choose another folder with --out that is writable and has enough free space.",
        ) from error


@contextmanager
def locked(target: Path, wait: float = 0.0) -> Generator[Lock]:
    """Context with the lock of a folder; what a killed process left of the folder is repaired before.

    Args:
        target: The folder, an absolute path without links.
        wait: Time to wait for another process [s].

    Raises:
        OutputError: Another process writes the folder.
    """
    lock = _acquire(target, wait)
    lock.users += 1
    try:
        yield lock
    finally:
        lock.users -= 1
        if not lock.users and not _state.claiming:
            _release(lock)


def complete(folder: Path | str) -> None:
    """Completes files of a folder, before they are read, if the process that replaced them was killed.

    Without effect if another process is completing them, or if the folder can only be read.
    """
    if (Path(folder) / COMMIT).is_dir():
        with suppress(OutputError, OSError), locked(Path(folder).resolve(), WAITING):
            pass


def sweep(folder: Path | str) -> None:
    """Removes leftovers of killed processes in a folder, once for each command."""
    if str(folder) in _state.swept:
        return
    _state.swept.add(str(folder))
    with suppress(OSError):
        names = [name for name in os.listdir(folder) if name.startswith(PREFIX)]
        if {DRAFT, COMMIT} & {*names}:
            with suppress(OutputError), locked(Path(folder).resolve()):
                pass
        for name in names:
            path = Path(folder, name)
            if name.endswith(PROBE):
                with suppress(OSError):
                    path.rmdir()
            elif name.endswith(PART) and (handle := is_abandoned(path)) is not None:
                with suppress(OSError):
                    path.unlink()
                os.close(handle)
            elif name.endswith(".lock") and path not in _held:
                _recover(path)
            elif name.endswith(".draft") and name != DRAFT and not path.with_suffix(".lock").exists():
                shutil.rmtree(path, ignore_errors=True)  # its lock is created before it and removed after it


def key_of(name: str) -> str:
    """Key in the names of the temporary files of a folder."""
    return hashlib.sha256(os.fsencode(name)).hexdigest()[:16]


def _place(target: Path) -> tuple[Path, str]:
    """Folder in which the lock of a folder is, and its key."""
    parent = target.parent
    if target.is_dir() and (parent == target or not os.access(parent, os.W_OK)):
        return target, key_of(".")
    return parent, key_of(target.name)


def _acquire(target: Path, wait: float = 0.0) -> Lock:
    """Locks a folder, or returns the lock that this process already has."""
    base, key = _place(target)
    path = base / f"{PREFIX}{key}.lock"
    end = time.monotonic() + wait
    while True:
        lock, thread = _held.get(path), threading.get_ident()
        if lock is not None and (not lock.users or lock.thread == thread):
            lock.thread = thread
            return lock
        handle = _open(path) if lock is None else None
        if handle is not None:
            break
        if time.monotonic() > end:
            raise _busy(target, path)
        time.sleep(0.02)
    with deferred_signals():
        lock = _held[path] = Lock(target, base, key, handle, thread)
        try:
            _repair(lock)
            _state_holder(handle, target)
        except BaseException:
            _release(lock)
            raise
    sweep(base)
    return lock


def _open(path: Path) -> int | None:
    """Descriptor of a lock that this process has got; `None` if another process has it."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            got = hold(handle)
            if got is None:  # no locks on this file system: the process that is named in the file
                got = not _lives(_read(handle))
            current = is_same(handle, path)
        except BaseException:
            os.close(handle)
            raise
        if got and current:
            return handle
        os.close(handle)
        if current:
            return None


def _state_holder(handle: int, target: Path) -> None:
    """Writes into a lock who has it."""
    record = {
        "pid": os.getpid(),
        "host": socket.gethostname(),
        "command": _state.claiming or "a Python program",
        "since": time.strftime("%H:%M:%S"),
        "target": os.fsencode(target.name).hex(),
    }
    os.ftruncate(handle, 0)
    os.lseek(handle, 0, os.SEEK_SET)
    os.write(handle, json.dumps(record).encode())


def _read(handle: int) -> dict[str, Any]:
    """Record of who has a lock; empty if there is none."""
    try:
        os.lseek(handle, 0, os.SEEK_SET)
        record = json.loads(os.read(handle, 4096))
        return record if isinstance(record, dict) else {}
    except (OSError, ValueError):
        return {}


def _lives(record: dict[str, Any]) -> bool:
    """Tests whether the process that wrote a lock may still work; processes of other computers may."""
    if record.get("host") != socket.gethostname():
        return bool(record)
    try:
        os.kill(int(record["pid"]), 0)
    except (ProcessLookupError, KeyError, ValueError, TypeError):
        return False
    except OSError:
        return True
    return record["pid"] != os.getpid()


def _busy(target: Path, path: Path) -> OutputError:
    """Error that another process writes a folder."""
    record: dict[str, Any] = {}
    with suppress(OSError):
        handle = os.open(path, os.O_RDONLY)
        record = _read(handle)
        os.close(handle)
    who = "{command} (process {pid} on {host}, since {since})".format_map(
        {"command": "another process", "pid": "?", "host": "?", "since": "?"} | record
    )
    return OutputError(
        f"{target} is being written by {who}.",
        remedy="wait until it has ended, or choose another folder with --out.",
    )


def _repair(lock: Lock) -> None:
    """Completes or removes what a killed process left of a folder."""
    if os.path.lexists(lock.aside):
        if os.path.lexists(lock.target):
            remove(lock.aside)
        else:
            lock.aside.rename(lock.target)
    remove(lock.draft)
    remove(lock.target / DRAFT)
    if (lock.target / COMMIT).is_dir():
        finish(lock.target)


def _recover(path: Path) -> None:
    """Removes a lock whose process has ended, after its folder is repaired."""
    handle = is_abandoned(path)
    if handle is None:
        return
    record = _read(handle)
    with deferred_signals():
        key = path.name[len(PREFIX) : -len(".lock")]
        try:
            name = os.fsdecode(bytes.fromhex(record["target"]))
            base = path.parent
            target = base if key == key_of(".") else base / name
            if key in (key_of("."), key_of(name)) and "/" not in name:
                _repair(Lock(target, base, key, handle, threading.get_ident()))
            path.unlink()
        except (OSError, KeyError, ValueError, TypeError):
            remove(path.with_suffix(".draft"))
            if not os.path.lexists(path.with_suffix(".old")):
                path.unlink(missing_ok=True)
        finally:
            os.close(handle)


def _release(lock: Lock) -> None:
    """Gives a lock up and removes its file."""
    path = lock.base / f"{PREFIX}{lock.key}.lock"
    with deferred_signals():
        _held.pop(path, None)
        lock.clear()
        if os.name == "nt":  # an open file cannot be removed
            os.close(lock.handle)
            path.unlink(missing_ok=True)
            return
        with suppress(OSError):
            if is_same(lock.handle, path):
                path.unlink()
        with suppress(OSError):
            os.close(lock.handle)


def _forget() -> None:
    """Leaves the locks to the parent process; called in a process that was just forked."""
    for lock in _held.values():
        with suppress(OSError):
            os.close(lock.handle)
    _held.clear()


atexit.register(end_claims)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
