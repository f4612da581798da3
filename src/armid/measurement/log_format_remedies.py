"""Remedies as lines of a study, which change or extend the log format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armid.measurement.log_format import LogFormat
from armid.remedy import Remedy, setting

DIGITS = 4
"""Decimals of excluded times [s]; they are rounded outwards."""


def lines(note: str = "", table: str = "", **keys: Any) -> Remedy:
    """Keys of a study with their values, one per line, with a comment after the last.

    Args:
        note: Comment.
        table: Table, where that is not `[[recording]]`, in place of a comment.
        keys: Values by key, arrays included.
    """
    return Remedy(*(setting(key, _plain(value)) for key, value in keys.items()), note=note, table=table)


def excluding(log_format: LogFormat, intervals: Sequence[tuple[float, float]], note: str = "") -> Remedy:
    """Intervals to leave out in addition to the existing ones, merged where they meet [s]."""
    unit = 10.0**DIGITS
    wider = [(float(np.floor(a * unit)) / unit, float(np.ceil(b * unit)) / unit) for a, b in intervals]
    joined: list[list[float]] = []
    for low, high in sorted([*((float(a), float(b)) for a, b in log_format.exclude), *wider]):
        if joined and low <= joined[-1][1]:
            joined[-1][1] = max(joined[-1][1], high)
        else:
            joined.append([low, high])
    return lines(note, exclude=joined)


def naming(log_format: LogFormat, names: Mapping[str, Sequence[str] | str], note: str = "") -> Remedy:
    """Columns in addition to those that the log format names; an empty name leaves a quantity out."""
    kept = {key: _pattern(value) for key, value in log_format.columns.items()}
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
