"""Hashes (SHA-256) of files, arrays and strings."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike


def sha256_of_file(path: Path | str) -> str:
    """Hexadecimal sha256 of a file's bytes."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def digest(*parts: ArrayLike | str) -> str:
    """Hexadecimal sha256 over arrays and strings, which identifies the inputs of a value."""
    state = hashlib.sha256()
    for part in parts:
        state.update(part.encode() if isinstance(part, str) else np.ascontiguousarray(part).tobytes())
        state.update(b"\0")
    return state.hexdigest()
