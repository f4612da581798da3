"""Mutators of bytes and of text: what a broken copy, a wrong tool or an attacker makes of a file.

A mutator is a function of a clean input and a random generator that returns a damaged input; the same generator state
gives the same damage.
"""

from __future__ import annotations

import re

from numpy.random import Generator

WORDS = (
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e-308",
    "-1",
    "0",
    "1e-9",
    "9" * 30,
    "1e400",
    "2147483648",
    "9223372036854775808",
    "",
    "x",
    "true",
    "null",
    "[]",
    "{}",
    '"',
    "é",
    "\x00",
    "\U0001f600",
    "../../etc/passwd",
    "<b>&amp;",
    "%s%n",
    "${1/0}",
    "0x10",
    "1_000",
    "١٢",
    "1,5",
    "-",
    ".",
    "1e",
    "--json",
    "\r",
    "\n",
)
"""Texts that replace a number or a word."""

INTEGERS = (0, 1, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FFFFFFFFFFFFFFF, 2**64 - 1)
"""Integers that replace a size, an offset or a count in a binary file."""

EXCHANGED = ((",", ";"), ("\n", "\r"), ("=", ":"), ('"', "'"), (".", ","))
"""Characters that other tools use in place of others."""

NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
WORD = re.compile(r"[A-Za-z_][\w.-]*")


def damage_bytes(data: bytes, rng: Generator) -> bytes:
    """Bytes with one or a few faults of a binary file."""
    kind = rng.integers(9)
    copy = bytearray(data)
    if not copy:
        return b"\x00"
    if kind == 0:
        return data[: rng.integers(len(data))]
    if kind in (1, 2):
        # Headers are where sizes stand, so every second fault lies near an end of the file.
        for _ in range(rng.integers(1, 5)):
            copy[_place(len(copy), rng)] ^= 1 << int(rng.integers(8))
        return bytes(copy)
    first, second = sorted(int(k) for k in rng.integers(len(copy), size=2))
    second = min(second, first + int(rng.integers(1, 4096)))
    if kind == 3:
        return data[:first] + data[second:]
    if kind == 4:
        return data[:second] + data[first:]
    if kind == 5:
        return data[:first] + bytes([int(rng.choice([0, 255]))]) * (second - first) + data[second:]
    width = int(rng.choice([1, 2, 4, 8]))
    at = min(_place(len(copy), rng), max(len(copy) - width, 0))
    number = int(rng.choice(len(INTEGERS)))
    order = "little" if rng.integers(4) else "big"
    word = (INTEGERS[number] & (256**width - 1)).to_bytes(width, order)
    if kind == 6:
        return data[:at] + word + data[at:]
    return data[:at] + word + data[at + width :]


def damage_text(text: str, rng: Generator) -> str:
    """Text with one fault that keeps most of its structure: numbers, words, lines and separators."""
    kind = rng.integers(10)
    lines = text.splitlines(keepends=True) or [""]
    at = int(rng.integers(len(lines))) if rng.integers(3) else int(rng.integers(min(len(lines), 5)))
    if kind < 3:
        lines[at] = replace_one(NUMBER, lines[at], WORDS[int(rng.integers(len(WORDS)))], rng)
    elif kind == 3:
        lines[at] = replace_one(WORD, lines[at], WORDS[int(rng.integers(len(WORDS)))], rng)
    elif kind == 4:
        del lines[at]
    elif kind == 5:
        lines[at:at] = [lines[at]] * int(rng.choice([1, 2, 50]))
    elif kind == 6:
        other = int(rng.integers(len(lines)))
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 7:
        lines[at] = lines[at].replace(
            *((",", ";"), ("\n", "\r"), ("=", ":"), ('"', "'"), (".", ","))[int(rng.integers(5))]
        )
    elif kind == 8:
        lines[at] = replace_one(NUMBER, lines[at], "1" * int(rng.choice([400, 5000, 200_000])), rng)
    else:
        return text[: int(rng.integers(len(text) + 1))]
    return "".join(lines)


def replace_one(pattern: re.Pattern[str], line: str, word: str, rng: Generator) -> str:
    """Line in which one match of a pattern is replaced."""
    hits = list(pattern.finditer(line))
    if not hits:
        return line + word
    hit = hits[int(rng.integers(len(hits)))]
    return line[: hit.start()] + word + line[hit.end() :]


def _place(size: int, rng: Generator) -> int:
    """Index of a byte, with every second one among the first 512 or last 512."""
    if rng.integers(2) or size <= 1024:
        return int(rng.integers(size))
    near = int(rng.integers(512))
    return near if rng.integers(2) else size - 1 - near
