"""Last handler of the command line: one line about an unexpected error, and a file with its trace."""

from __future__ import annotations

import os
import sys
import tempfile
import traceback
from importlib.metadata import version
from pathlib import Path

UNEXPECTED = 70
"""Exit code after an error that armid did not expect, EX_SOFTWARE of sysexits.h."""

BROKEN_PIPE = 141
"""Exit code if the reader of the output has gone, as that of a process that SIGPIPE ends."""


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


def open_missing_streams() -> None:
    """Replaces standard streams that are closed by ones that discard what is written."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
