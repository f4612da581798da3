"""Remedies as lines of a study, which change or extend the log format.

A remedy is either TOML, its keys those of a `[[recording]]` unless a comment names another table, or begins with one
of `BY_HAND`: nothing that a study can say would heal the log.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armid.measurement.log_format import LogFormat
from armid.toml import toml_line

__all__ = ["BY_HAND", "excluding", "lines", "naming"]

BY_HAND = ("record ", "log ", "rewrite ", "find out ", "correct ")
"""Beginnings of remedies that are no line of a study."""

DIGITS = 4
"""Decimals of excluded times [s]; they are rounded outwards."""


def lines(note: str = "", **keys: Any) -> str:
    """Keys of a study with their values, one per line, with a comment behind the last.

    Args:
        note: The comment; it names the table where that is not `[[recording]]`, as in `in [model]`.
        keys: Values as TOML has them, arrays among them.
    """
    told = [toml_line(key, _plain(value)) for key, value in keys.items()]
    return "\n".join(told) + (f"  # {note}" if note else "")


def excluding(reading: LogFormat, intervals: Sequence[tuple[float, float]], note: str = "") -> str:
    """Intervals to leave out in addition to the existing ones, merged where they meet [s]."""
    unit = 10.0**DIGITS
    wider = [(float(np.floor(a * unit)) / unit, float(np.ceil(b * unit)) / unit) for a, b in intervals]
    joined: list[list[float]] = []
    for low, high in sorted([*((float(a), float(b)) for a, b in reading.exclude), *wider]):
        if joined and low <= joined[-1][1]:
            joined[-1][1] = max(joined[-1][1], high)
        else:
            joined.append([low, high])
    return lines(note, exclude=joined)


def naming(reading: LogFormat, names: Mapping[str, Sequence[str] | str], note: str = "") -> str:
    """Columns in addition to those that the log format names; an empty name leaves a quantity out."""
    kept = {key: _pattern(value) for key, value in reading.columns.items()}
    return lines(note, columns={**kept, **{key: _pattern(value) for key, value in names.items()}})


def _pattern(names: Sequence[str] | str) -> str | list[str]:
    if isinstance(names, str):
        return names
    return "" if not names else names[0] if len(names) == 1 else list(names)


def _plain(value: Any) -> Any:
    """Arrays and numbers of NumPy as TOML values."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return value.item()
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value
