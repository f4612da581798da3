"""Remedies that are lines of a study; the lines change or extend the log format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armid.measurement.log_format import LogFormat
from armid.remedy import Remedy, setting

DIGITS = 4
"""Number of decimals of the times [s] in a remedy that excludes intervals; intervals are rounded outwards."""


def lines(note: str = "", table: str = "", **keys: Any) -> Remedy:
    """Remedy that sets keys of a study, one line for each key, with a comment at the end of the last line.

    Args:
        note: Text of the comment.
        table: Table of the study to which the keys belong, if it is not `[[recording]]`.
        keys: Values by key; they may be arrays.
    """
    return Remedy(*(setting(key, _plain(value)) for key, value in keys.items()), note=note, table=table)


def excluding(log_format: LogFormat, intervals: Sequence[tuple[float, float]], note: str = "") -> Remedy:
    """Remedy that excludes intervals [s] in addition to those of the log format; overlapping intervals are merged."""
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
    """Remedy that names columns of quantities, in addition to those in the log format.

    An empty name leaves a quantity out.
    """
    kept = {key: _pattern(value) for key, value in log_format.columns.items()}
    return lines(note, columns={**kept, **{key: _pattern(value) for key, value in names.items()}})


def _pattern(names: Sequence[str] | str) -> str | list[str]:
    if isinstance(names, str):
        return names
    return "" if not names else names[0] if len(names) == 1 else list(names)


def _plain(value: Any) -> Any:
    """Converts arrays and numbers of NumPy to values that can be written as TOML."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return value.item()
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value
