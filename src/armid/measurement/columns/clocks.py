"""Choice of the time column, by its name or by a unit of time and increasing values."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.errors import RecordingError
from armid.maths.median import median
from armid.measurement.columns.names import Clock, clock_of, named, time_unit, words
from armid.values import Array

Values = Callable[[str], NDArray[np.generic]]
"""Function that returns the numbers of a column; it raises `RecordingError` where they are not numeric."""

FORWARD = 0.95
"""Share of the steps of a clock that are not negative; single faulty steps are tolerated."""

EVEN = 0.9
"""Share of the steps of a uniform clock that are within a half of the median step."""

LONGEST_STEP = 0.5
"""Median step [s] from which a clock cannot count seconds: nobody records a motion at 2 Hz."""

UNITS = ((100.0, 1e-3, "milliseconds"), (1e5, 1e-6, "microseconds"), (np.inf, 1e-9, "nanoseconds"))
"""Possible units of a clock that does not count seconds, by its step: 10 Hz to 2 kHz in each of them."""

IN_STEP = 1e-3
"""Relative difference up to which the spans of two clocks count as equal."""


@dataclass(frozen=True, slots=True)
class ClockRequest:
    """Ambiguous guess: several sets of columns that fit equally well.

    Attributes:
        quantity: Quantity that the columns may hold.
        sets: Columns of each set.
    """

    quantity: str
    sets: tuple[tuple[str, ...], ...]


def clock_columns(names: Sequence[str], values: Values | None = None) -> tuple[str, ...] | ClockRequest:
    """Chooses the time column that is closest to the measurement, with its column of nanoseconds if any.

    Args:
        names: All columns.
        values: Function that returns their numbers; without it a column is judged by its name alone.

    Returns:
        One column, two (seconds and nanoseconds), or none; or the ambiguous choice.
    """
    clocks = [clock for name in dict.fromkeys(names) if (clock := clock_of(name)) is not None]
    fine = {_stem(clock): clock for clock in clocks if clock.unit == 1e-9 and _counts_rest(clock)}
    clocks = [clock for clock in clocks if clock not in fine.values()]
    if not clocks:
        return () if values is None else _by_unit(names, values)
    nearest = min(clock.rank for clock in clocks)
    best = [clock for clock in clocks if clock.rank == nearest]
    pairs = [(clock.column, *([fine[_stem(clock)].column] if _stem(clock) in fine else [])) for clock in best]
    return pairs[0] if len(pairs) == 1 else ClockRequest("time", tuple(pairs))


def _grows(values: Array) -> bool:
    """Tests whether numbers increase from row to row as times do, up to single faults."""
    step = np.diff(values)
    return bool(step.size and np.isfinite(values).all() and median(step) > 0.0 and np.mean(step >= 0.0) >= FORWARD)


def evenly_growing(names: Sequence[str], used: Collection[str], values: Values) -> dict[str, float]:
    """Columns that increase uniformly and may be a clock although neither name nor unit shows it.

    Args:
        names: All columns.
        used: Columns with another use.
        values: Function that returns their numbers.

    Returns:
        Median step of each column that increases evenly from row to row.
    """
    found: dict[str, float] = {}
    for name in dict.fromkeys(names):
        numbers = None if name in used else _numbers(name, values)
        if numbers is None or not _grows(numbers):
            continue
        step = np.diff(numbers)
        typical = float(median(step))
        if np.mean(np.abs(step / typical - 1.0) < 0.5) >= EVEN:
            found[name] = typical
    return found


def unit_of_step(step: float) -> tuple[float, str] | None:
    """Name and length [s] of the unit of a clock with a given median step; `None` where it can be seconds."""
    if step < LONGEST_STEP:
        return None
    return next((length, name) for most, length, name in UNITS if step < most)


def _by_unit(names: Sequence[str], values: Values) -> tuple[str, ...] | ClockRequest:
    """Increasing column with a unit of time; the first where several count the same time."""
    spans: dict[str, float] = {}
    for name in dict.fromkeys(names):
        unit = time_unit(name)
        numbers = None if unit is None or named(name, ()) else _numbers(name, values)
        if unit is not None and numbers is not None and _grows(numbers):
            spans[name] = unit * float(np.ptp(numbers))
    if not spans:
        return ()
    first = next(iter(spans.values()))
    if any(abs(span / first - 1.0) > IN_STEP for span in spans.values()):
        return ClockRequest("time", tuple((name,) for name in spans))
    return (next(iter(spans)),)


def _numbers(name: str, values: Values) -> Array | None:
    """Numbers of one column; `None` where it has none, or several per row."""
    try:
        found = values(name)
    except RecordingError:
        return None
    found = found.reshape(-1) if 1 in found.shape else found
    return found.astype(np.float64) if found.ndim == 1 and found.dtype.kind in "fiu" else None


def _counts_rest(clock: Clock) -> bool:
    """Tests whether a column holds the nanoseconds to a column of whole seconds."""
    return any(word in ("nanosec", "nsec", "nsecs") for word in words(clock.column))


def _stem(clock: Clock) -> tuple[str, ...]:
    return tuple(word for word in words(clock.column) if word not in ("sec", "secs", "nanosec", "nsec", "nsecs"))
