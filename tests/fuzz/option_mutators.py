"""Wrong values of the options of a command that describe a recording and an arm."""

from __future__ import annotations

from byte_mutators import WORDS
from numpy.random import Generator

NAMES = (
    "--rate",
    "--torque-sign",
    "--units",
    "--columns",
    "--time-unit",
    "--period",
    "--preset",
    "--gravity",
    "--lock",
    "--only",
    "--tip",
    "--package",
    "--terms",
)
"""Options of `doctor`."""

VALUES = (
    "q=q{}",
    "q=",
    "=",
    "q=q{0}",
    "q={",
    "q={}{}",
    "q={a}",
    "q={:999999999999}",
    "q=q{0.__class__}",
    "time=t",
    "effort=",
    "x=y",
    "joint_1=1e308",
    "joint_1",
    "joint_*",
    "*",
    "[",
    "joint_1=nan",
    "0 0 -9.81",
    "nan nan nan",
    "1e308 0 0",
    "0,0",
    "auto",
    "default,x",
    "rigid-body",
    "1e-9",
    "1e9",
    "1e-300",
    "none",
    "base",
    "link_3",
    "a=/",
    "a=",
    "nan",
    "inf",
)


def damage_options(rng: Generator) -> list[str]:
    """Options with odd values, at most two."""
    found: list[str] = []
    for _ in range(int(rng.integers(1, 3))):
        pool = VALUES if rng.integers(3) else WORDS
        found += [NAMES[int(rng.integers(len(NAMES)))], pool[int(rng.integers(len(pool)))]]
    return [word.replace("\x00", "") for word in found]
