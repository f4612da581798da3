"""Writing of a file completely or not at all; all functions of armid that write files use it."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from armid.errors import OutputError


def replace_file(path: Path | str, content: bytes | str) -> Path:
    """Writes `content` to `path`, completely or not at all, with a temporary file in the same folder.

    Raises:
        OutputError: The folder cannot be made or written, or the disk is full. The temporary file is then removed.
    """
    path = Path(path)
    data = content.encode() if isinstance(content, str) else content
    temporary: str | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(temporary, 0o666 & ~mask)
        os.replace(temporary, path)
        temporary = None
    except OSError as error:
        raise OutputError(
            f"{path} could not be written: {error.strerror or error}.",
            remedy="choose an existing and writable folder on a disk with enough free space.",
        ) from error
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)
    return path
