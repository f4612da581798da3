"""Cache of arrays in the user's cache folder, for results that depend only on the content of a file.

An entry is written to a temporary file and then renamed, so that another process never reads a part of an entry. An
entry that cannot be read is computed again. If the folder cannot be written, nothing is stored and no error is
raised. If the total size of the entries exceeds `LARGEST`, the least recently used entries are removed.
"""

from __future__ import annotations

import io
import os
import time
import zlib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from armid.atomic_file import replace_file
from armid.errors import OutputError

LARGEST = 200_000_000
"""Largest total size of all cache entries [bytes]. The hulls of a humanoid robot take some megabytes."""

LEFT_BEHIND = 86_400.0
"""Age above which a temporary file is removed [s]: the process that wrote it has ended before it renamed the file."""

Arrays = Mapping[str, NDArray[np.generic]]


def cache_folder() -> Path | None:
    """Cache folder: `ARMID_CACHE`, `armid` in `XDG_CACHE_HOME`, or `~/.cache/armid`; `None` without home folder."""
    if given := os.environ.get("ARMID_CACHE"):
        return Path(given)
    if shared := os.environ.get("XDG_CACHE_HOME"):
        return Path(shared) / "armid"
    with suppress(RuntimeError):
        return Path.home() / ".cache" / "armid"
    return None


def read_entry(name: str) -> dict[str, NDArray[np.generic]] | None:
    """Reads the cache entry with a given name; `None` if it does not exist or cannot be read."""
    folder = cache_folder()
    if folder is None:
        return None
    path = folder / f"{name}.npz"
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as entry:
            found = dict(entry)
        with suppress(OSError):  # a folder that can only be read
            os.utime(path)
        return found
    except (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error, RuntimeError):
        return None


def write_entry(name: str, arrays: Arrays) -> None:
    """Writes an entry with a given name to the cache, if the folder can be written."""
    folder = cache_folder()
    if folder is None:
        return
    with suppress(OSError, OutputError):
        folder.mkdir(parents=True, exist_ok=True)
        buffer = io.BytesIO()
        np.savez(buffer, **dict(arrays))  # pyright: ignore[reportArgumentType]
        replace_file(folder / f"{name}.npz", buffer.getvalue(), is_result=False)
        _prune(folder, f"{name}.npz")


def _prune(folder: Path, newest: str) -> None:
    """Removes the least recently used cache entries until their total size is at most `LARGEST`.

    The entry `newest` is not removed.
    """
    found: list[tuple[float, int, Path]] = []
    for path in folder.glob("*.npz"):
        with suppress(OSError):  # another process was faster
            state = path.stat()
            found.append((state.st_mtime, state.st_size, path))
    whole = sum(size for _, size, path in found if not path.name.startswith("."))
    for used, size, path in sorted(found, key=lambda each: each[0]):
        if path.name.startswith("."):
            gone = time.time() - used > LEFT_BEHIND
        else:
            gone = whole > LARGEST and path.name != newest
            whole -= size if gone else 0
        if gone:
            with suppress(OSError):
                path.unlink()
