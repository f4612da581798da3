"""Files as they should not be, for the contracts of readers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armid.errors import ArmidError


def cut(content: bytes, pieces: int) -> Iterator[bytes]:
    """The first parts of a file, as a full disk or a broken copy leaves it."""
    for k in range(1, pieces):
        yield content[: len(content) * k // pieces]


def changed(content: bytes, copies: int, seed: int) -> Iterator[bytes]:
    """The file with some bytes replaced by printable ones, so that text stays text."""
    rng = np.random.default_rng(seed)
    for _ in range(copies):
        copy = bytearray(content)
        for at in rng.integers(len(copy), size=rng.integers(1, 6)):
            copy[at] = int(rng.integers(32, 127))
        yield bytes(copy)


def junk() -> Iterator[bytes]:
    """Files of no format at all."""
    rng = np.random.default_rng(11)
    yield b"\n"
    yield b"hello\n"
    yield b"\x00" * 1000
    yield rng.bytes(2000)
    yield b"%PDF-1.7\n" + rng.bytes(500)
    yield b"<?xml version='1.0'?><html/>\n"


def is_helpful(error: ArmidError) -> bool:
    """Tell whether an error says more than that something is wrong: what is possible, what must be, or what to do."""
    return bool(error.remedy or error.possible or " must " in error.problem)
