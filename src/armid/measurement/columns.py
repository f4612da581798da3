"""Which columns of a file hold time, position, velocity, acceleration and effort."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.errors import RecordingError
from armid.measurement.reading import PRESETS, QUANTITIES, Reading
from armid.measurement.recording import Recording
from armid.values import Array

__all__ = ["Selection", "assemble", "select"]

DEFAULTS: Mapping[str, tuple[str, ...]] = {
    "time": ("t", "time", "timestamp"),
    "q": ("q{}", "q"),
    "dq": ("dq{}", "qd{}", "dq", "qd"),
    "ddq": ("ddq{}", "qdd{}", "ddq", "qdd"),
    "effort": ("tau{}", "effort{}", "torque{}", "tau", "effort", "torque", "i{}"),
}
"""Names tried in this order where the reading gives none; `{}` counts from 1."""

CURRENT = re.compile(r"i([_\[]?\d+\]?)?|.*current.*", re.IGNORECASE)
"""Names that columns of motor current have: i1, i_1, i[0], actual_current_0."""

LISTED = 60
"""Names shown in a message; a log of a controller may have hundreds."""


@dataclass(frozen=True, slots=True)
class Selection:
    """The names chosen in one file.

    Attributes:
        time: None, one, or two (seconds and nanoseconds).
        q: A column for each channel, or one matrix.
        dq: Likewise, or none.
        ddq: Likewise, or none.
        effort: Likewise, or none.
    """

    time: tuple[str, ...]
    q: tuple[str, ...]
    dq: tuple[str, ...]
    ddq: tuple[str, ...]
    effort: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """All of them, each once."""
        return tuple(dict.fromkeys((*self.time, *self.q, *self.dq, *self.ddq, *self.effort)))


def select(names: Sequence[str], reading: Reading, path: Path) -> Selection:
    """Choose columns by the reading's map, its preset, or the usual names.

    Args:
        names: Columns or variables of the file.
        reading: How to read it.
        path: The file, for messages.

    Raises:
        RecordingError: A named column is not there, a number is missing in a row of columns, or no column holds
            positions; the message lists what is there.
    """
    present = dict.fromkeys(names)
    chosen: dict[str, tuple[str, ...]] = {}
    for quantity in QUANTITIES:
        if quantity in reading.columns:
            patterns = tuple(reading.columns[quantity])
            chosen[quantity] = _named(patterns, present, quantity, path) if patterns else ()
        elif reading.preset is not None:
            patterns = PRESETS[reading.preset].columns.get(quantity, ())
            needed = patterns and quantity in ("time", "q")
            chosen[quantity] = (
                _named(patterns, present, quantity, path)
                if needed
                else tuple(chain.from_iterable(_expand(pattern, present, path) for pattern in patterns))
            )
        else:
            found = (_expand(pattern, present, path) for pattern in DEFAULTS[quantity])
            chosen[quantity] = next((columns for columns in found if columns), ())
    if not chosen["q"]:
        raise _unknown("No column holds positions", present, "q", path)
    if reading.drive_gain is not None and "effort" not in reading.columns and reading.preset is None:
        _refuse_two_efforts(chosen["effort"], present, path)
    return Selection(**chosen)


def assemble(
    selection: Selection,
    column: Callable[[str], NDArray[Any]],
    reading: Reading,
    path: Path,
    joint_names: Sequence[str] = (),
) -> Recording:
    """The recording that a file's columns make.

    Args:
        selection: Chosen names.
        column: Gives the numbers under a name, shape (N,) or (N, n).
        reading: How to read it.
        path: The file.
        joint_names: Names of the channels, where the file has them.
    """
    q = _matrix(selection.q, column, path)
    effort = _matrix(selection.effort, column, path) if selection.effort else None
    if effort is not None and effort.ndim == q.ndim == 2 and effort.shape[1] != q.shape[1]:
        raise _uneven(selection, q.shape[1], effort.shape[1], path)
    return Recording(
        time=_time(selection.time, column, _time_unit(reading)),
        q=q,
        dq=_matrix(selection.dq, column, path) if selection.dq else None,
        ddq=_matrix(selection.ddq, column, path) if selection.ddq else None,
        effort=effort,
        joint_names=tuple(joint_names),
        rate=reading.rate,
        consecutive=reading.consecutive,
        effort_is_current=any(CURRENT.fullmatch(name) for name in selection.effort),
        columns={name: found for name in QUANTITIES if (found := getattr(selection, name))},
        source=str(path),
    )


def _time_unit(reading: Reading) -> float:
    """Length of one unit of the time column [s]: what the reading says, else what its preset does."""
    if reading.time_unit is not None:
        return reading.time_unit
    preset = PRESETS.get(reading.preset or "")
    return 1.0 if preset is None or "time" in reading.columns else preset.time_unit


def _uneven(selection: Selection, q: int, effort: int, path: Path) -> RecordingError:
    """More channels of one quantity than of another."""
    listed = [
        f"{count} of {name} ({' … '.join(dict.fromkeys((*names[:1], *names[-1:])))})"
        for name, names, count in (("q", selection.q, q), ("effort", selection.effort, effort))
    ]
    fewer = "effort" if effort < q else "q"
    return RecordingError(
        f"{path} has {listed[0]}, but {listed[1]}: {abs(q - effort)} of {fewer} missing.",
        remedy=f"add what is missing of {fewer}; or name as many of each in columns, and lock the joints that were "
        "not recorded.",
    )


def numeric(values: NDArray[Any], name: str, path: Path) -> Array:
    """A column as float64.

    Raises:
        RecordingError: It holds something else than real numbers, or is no vector or matrix.
    """
    if values.dtype.kind not in "fiub":
        raise RecordingError(
            f"{path}: {name!r} holds {values.dtype.name}, not numbers.",
            remedy="save plain arrays of real numbers, or name another column.",
        )
    if values.ndim not in (1, 2):
        raise RecordingError(
            f"{path}: {name!r} has {values.ndim} dimensions.", remedy="give one row a sample and one column a joint."
        )
    return values.astype(np.float64)


def _named(patterns: tuple[str, ...], present: Mapping[str, Any], quantity: str, path: Path) -> tuple[str, ...]:
    """The columns that one pattern or a list of names asks for; all must be there."""
    if len(patterns) == 1:
        found = _expand(patterns[0], present, path)
        if not found:
            raise _unknown(f"No column is called {patterns[0]!r}", present, quantity, path)
        return found
    missing = [name for name in patterns if name not in present]
    if missing:
        raise _unknown(f"No column is called {', '.join(map(repr, missing))}", present, quantity, path)
    return patterns


def _expand(pattern: str, present: Mapping[str, Any], path: Path) -> tuple[str, ...]:
    """The columns that match a pattern, in the order of their numbers."""
    for braces, first in (("{}", 1), ("{0}", 0)):
        if braces not in pattern:
            continue
        before, after = pattern.split(braces, 1)
        form = re.compile(re.escape(before) + r"(\d+)" + re.escape(after))
        numbered = {int(hit[1]): name for name in present if (hit := form.fullmatch(name))}
        if not numbered:
            return ()
        expected = range(first, first + len(numbered))
        if sorted(numbered) != list(expected):
            found = ", ".join(numbered[i] for i in sorted(numbered))
            raise RecordingError(
                f"{path}: columns {pattern!r} must count from {first} without a gap; found {found}.",
                possible="{} counts from 1, {0} from 0; a list of names takes any",
                remedy="say which columns to take in columns.",
            )
        return tuple(numbered[i] for i in expected)
    return (pattern,) if pattern in present else ()


def _refuse_two_efforts(effort: tuple[str, ...], present: Mapping[str, Any], path: Path) -> None:
    """With drive gains given, torque beside current leaves open which of them the gains are for."""
    current = _expand("i{}", present, path)
    if effort and current and effort != current:
        raise RecordingError(
            f"{path} has {effort[0]} … and {current[0]} …; drive_gain does not say which of them it belongs to.",
            remedy='name the effort, for instance columns = { effort = "i{}" }.',
        )


def _unknown(problem: str, present: Mapping[str, Any], quantity: str, path: Path) -> RecordingError:
    names = list(present)
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return RecordingError(
        f"{path}: {problem} for {quantity}.",
        possible=(", ".join(names[:LISTED]) or "the file has no columns") + more,
        remedy=f'name them, for instance columns = {{ {quantity} = "{quantity}{{}}" }}, or give a preset '
        f"({', '.join(PRESETS)}).",
    )


def _matrix(names: tuple[str, ...], column: Callable[[str], NDArray[Any]], path: Path) -> NDArray[Any]:
    """Columns side by side, shape (N, n)."""
    values = [column(name) for name in names]
    if len(values) == 1:
        return values[0] if values[0].ndim == 2 else values[0][:, None]
    if len({len(column) for column in values}) > 1:
        found = ", ".join(f"{name} {len(column)}" for name, column in zip(names, values, strict=True))
        raise RecordingError(f"{path}: columns differ in length: {found}.", remedy="give each channel every sample.")
    return np.column_stack(values)


def _time(names: tuple[str, ...], column: Callable[[str], NDArray[Any]], unit: float) -> NDArray[Any] | None:
    """Times in seconds; of two columns the second counts nanoseconds."""
    if not names:
        return None
    first = column(names[0]).reshape(-1)
    if len(names) == 1:
        return first * unit
    # The first whole second is taken off before the sum, or 1e9 s would eat the nanoseconds' digits.
    return (first - first[:1]) + 1e-9 * column(names[1]).reshape(-1)
