"""Writing of a file completely or not at all; all functions of armid that write files use it."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path

from armid.errors import OutputError
from armid.output.held_files import hold, is_same
from armid.output.interruption import deferred_signals
from armid.output.locks import PART, PREFIX, sweep
from armid.output.written import add_written


def replace_file(path: Path | str, content: bytes | str, *, is_result: bool = True) -> Path:
    """Writes `content` to `path`, completely or not at all, with a temporary file in the same folder.

    Temporary files of killed processes in this folder are removed.

    Args:
        path: The file.
        content: Its new content.
        is_result: False for a file that a message about an interruption need not name.

    Raises:
        OutputError: The folder cannot be made or written, or the disk is full. The temporary file is then removed.
    """
    path = Path(path)
    data = content.encode() if isinstance(content, str) else content
    temporary: str | None = None
    held: int | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        sweep(path.parent)
        with deferred_signals():
            handle, temporary, held = _made(path.parent)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        with deferred_signals():
            os.replace(temporary, path)
            temporary = None
            if is_result:
                add_written(path)
    except OSError as error:
        raise OutputError(
            f"{path} could not be written: {error.strerror or error}.",
            remedy="choose an existing and writable folder on a disk with enough free space.",
        ) from error
    finally:
        with deferred_signals():
            if temporary is not None:
                with suppress(OSError):  # the folder may have vanished
                    Path(temporary).unlink(missing_ok=True)
            if held is not None:
                os.close(held)
    return path


def _made(folder: Path) -> tuple[int, str, int | None]:
    """New temporary file: descriptor, path, and a second descriptor, which keeps it locked until it is renamed."""
    while True:
        handle, path = tempfile.mkstemp(dir=folder, prefix=PREFIX, suffix=PART)
        if os.name == "nt":  # an open file cannot be renamed
            return handle, path, None
        if hold(handle) is not False and is_same(handle, path):
            return handle, path, os.dup(handle)
        os.close(handle)  # taken for one of a killed process before it was locked
