"""Record of what a piece of code opens, runs and connects to, from the audit events of Python."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

RUN = ("os.system", "os.exec", "os.posix_spawn", "os.spawn", "os.startfile", "subprocess.Popen", "socket.connect")
"""Events of programs that are started and of connections."""

_lists: list[list[tuple[str, str]]] = []


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if _lists and (event == "open" or event in RUN):
        what = arguments[0] if arguments else ""
        name = os.fsdecode(what) if isinstance(what, str | bytes | os.PathLike) else str(what)
        for each in _lists:
            each.append((event, name))


sys.addaudithook(_hook)


@contextmanager
def recorded_events() -> Iterator[list[tuple[str, str]]]:
    """Context in which events are recorded: pairs of the name of the event and the file or program."""
    events: list[tuple[str, str]] = []
    _lists.append(events)
    try:
        yield events
    finally:
        _lists.remove(events)
