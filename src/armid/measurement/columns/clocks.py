"""Choice of the time column: by its name, or by a unit of time together with increasing values."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import RecordingError
from armid.maths.median import median
from armid.measurement.columns.column_name_parsing import Clock, clock_of, named, time_unit, words

Values = Callable[[str], NDArray[np.generic]]
"""Function that returns the numbers of a column, or raises `RecordingError` if the column is not numeric."""

FORWARD = 0.95
"""Smallest share of the steps of a clock, from row to row, that must not be negative; single faulty steps are
tolerated."""

EVEN = 0.9
"""Smallest share of the steps of a uniform clock, from row to row, that must be between 0.5 and 1.5 median steps."""

LONGEST_STEP = 0.5
"""Median step [s] at and above which the unit of a clock cannot be the second, because motion is not recorded at 2 Hz
or slower."""

UNITS = ((100.0, 1e-3, "milliseconds"), (1e5, 1e-6, "microseconds"), (np.inf, 1e-9, "nanoseconds"))
"""Possible units of a clock that does not count seconds: upper limit of its median step in these units, length of the
unit [s], and name of the unit. With these limits, each unit covers sample rates from 10 Hz to 2 kHz."""

IN_STEP = 1e-3
"""Relative difference up to which the total times of two clocks count as equal."""


@dataclass(frozen=True, slots=True)
class ClockRequest:
    """Ambiguous guess of the columns of a quantity: several sets of columns fit equally well.

    Attributes:
        quantity: Quantity that the columns may contain.
        sets: Names of the columns in each set.
        others: Ambiguous guesses of other quantities.
    """

    quantity: str
    sets: tuple[tuple[str, ...], ...]
    others: tuple[ClockRequest, ...] = ()


def clock_columns(names: Sequence[str], values: Values | None = None) -> tuple[str, ...] | ClockRequest:
    """Chooses the column whose time is closest to the instant of measurement.

    If there is a column of nanoseconds that belongs to it, this column is chosen, too.

    Args:
        names: All columns.
        values: Function that returns the numbers of a column. If it is not given, columns are judged by their names
            only.

    Returns:
        Names of one column, of two columns (seconds and nanoseconds), or of no column; if several choices are equally
        good, a `ClockRequest` that contains them.
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
    """Checks whether numbers increase from row to row, as times do; a few exceptions are tolerated."""
    step = np.diff(values)
    return bool(step.size and np.isfinite(values).all() and median(step) > 0.0 and np.mean(step >= 0.0) >= FORWARD)


def evenly_growing(names: Sequence[str], used: Collection[str], values: Values) -> dict[str, float]:
    """Finds unused columns that increase uniformly and may therefore be clocks.

    Args:
        names: All columns.
        used: Columns that are used for another quantity.
        values: Function that returns the numbers of a column.

    Returns:
        Median step from row to row of each column that increases uniformly, by the name of the column.
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
    """Length [s] and name of the unit that a clock probably counts; `None` for seconds.

    The median step of the clock is given in seconds, computed as if the clock counted seconds.
    """
    if step < LONGEST_STEP:
        return None
    return next((length, name) for most, length, name in UNITS if step < most)


def _by_unit(names: Sequence[str], values: Values) -> tuple[str, ...] | ClockRequest:
    """Chooses an increasing column whose name contains a unit of time.

    If several such columns cover the same time, the first one is chosen; otherwise the result is a `ClockRequest`.
    """
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
    """Numbers of one column; `None` if the column is not numeric or has several values in each row."""
    try:
        found = values(name)
    except RecordingError:
        return None
    found = found.reshape(-1) if 1 in found.shape else found
    return found.astype(np.float64) if found.ndim == 1 and found.dtype.kind in "fiu" else None


def _counts_rest(clock: Clock) -> bool:
    """Checks whether a column contains nanoseconds that must be added to a column of whole seconds."""
    return any(word in ("nanosec", "nsec", "nsecs") for word in words(clock.column))


def _stem(clock: Clock) -> tuple[str, ...]:
    return tuple(word for word in words(clock.column) if word not in ("sec", "secs", "nanosec", "nsec", "nsecs"))
