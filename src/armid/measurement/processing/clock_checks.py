"""Checks of the clock of a recording: its direction, its unit, its rate, and repeated time stamps."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, RecordingError
from armid.maths.median import median
from armid.measurement.columns.clocks import unit_of_step
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording, recording_error, select_rows
from armid.measurement.remedy_builders import lines, naming
from armid.remedy import Remedy, setting

RATE_TOLERANCE = 0.1
"""Largest tolerated relative difference between two values of the sample rate; a wrong rate differs by a large
factor."""

CLOCK_TIES = 0.01
"""Largest share of rows with the time stamp of the row before at which a coarse clock can be the cause."""

SCATTER = 5.0
"""Largest distance of a time stamp from a uniform clock, in steps of this clock, that counts as scatter of the time
stamps. A missing second, or rows of another recording, move the time stamps much further."""

SHORTEST_STEP = 4e-5
"""Smallest plausible median step of a clock [s]; the fastest control loops of drives have a step of 5e-5 s."""

COUNTED_STEPS = (5e-4, 0.5)
"""Smallest and largest median step [s] that is plausible after correction of the unit. If a clock seems too fast, a
unit is searched with which its step lies between these values."""

UNITS = {1.0: "seconds", 1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
"""Names of the units in which clocks count, by the length of the unit [s]."""


def check_clock(recording: Recording, log_format: LogFormat) -> None:
    """Raises an error if the clock runs backwards, has another unit than stated, or contradicts the rate.

    Args:
        recording: Recording as read from its file.
        log_format: Log format with which the recording was read.

    Raises:
        RecordingError: The clock runs backwards, has another unit than stated, or contradicts the rate.
    """
    if recording.time is None:
        return
    step = np.diff(recording.time)
    if (step < 0).any():
        raise _backwards(recording, recording.time, log_format)
    typical = float(median(step))
    if recording.consecutive is not False:
        _check_unit(recording, typical, log_format.clock_unit)
    if recording.rate is not None and typical > 0 and abs(recording.rate * typical - 1) > RATE_TOLERANCE:
        raise recording_error(
            "clock-rate",
            recording,
            f"the time column gives {1 / typical:.4g} Hz, but the key `rate` gives {recording.rate:g} Hz.",
            "correct one of the two: remove the key `rate`, or leave the time column out (an empty name of "
            "`time` under `columns`).",
        )


def _backwards(recording: Recording, time: Array, log_format: LogFormat) -> RecordingError:
    """Error for a clock that runs backwards; if its time stamps only scatter, the remedy is a uniform clock."""
    back = np.diff(time) < 0
    row = int(np.argmax(back))
    evidence = (
        f"time runs backwards from row {row + 1} to {row + 2} ({time[row]:.6f} s, then {time[row + 1]:.6f} s)"
        f"{f', and {back.sum() - 1} times more' if back.sum() > 1 else ''}"
    )
    step = float(time[-1] - time[0]) / (len(time) - 1)
    scatter = time - time[0] - step * np.arange(len(time))
    if step <= 0.0 or np.abs(scatter - scatter.mean()).max() > SCATTER * step:
        remedy = (
            "correct the file: sort its rows by time, or, if it contains two recordings, split it into two files."
        )
        return recording_error("clock-jitter", recording, f"{evidence}.", remedy)
    steps = float(scatter.std()) / step
    doubt = 2.0 * steps / len(time)
    rates = (float(f"{1.0 / step:.{digits}g}") for digits in range(2, 10))
    rate = next((each for each in rates if abs(each * step - 1.0) < doubt), 1.0 / step)
    return recording_error(
        "clock-jitter",
        recording,
        f"{evidence}. The time stamps scatter around a uniform clock of {rate:g} Hz by {steps:.2g} steps (standard "
        "deviation), so sorting the rows by time would exchange samples.",
        Remedy(
            *naming(log_format, {"time": ""}).parts,
            *lines(rate=rate).parts,
            note="Hz; if the rows are in order and only their time stamps scatter",
        ),
    )


def _check_unit(recording: Recording, step: float, unit: float) -> None:
    """Raises an error if the median step [s] of a clock shows that it was read in a wrong unit."""
    counted = _counted_unit(step, unit)
    as_read = UNITS.get(unit, f"units of {unit:g} s")
    moved = f"the time column increases by {step / unit:g} from row to row"
    if counted is not None:
        raise recording_error(
            "clock-unit",
            recording,
            f"{moved}; it seems to count {UNITS.get(counted, f'units of {counted:g} s')}, not {as_read}.",
            lines("s; or consecutive = false, if rows are separate measurements", time_unit=counted),
        )
    if 0.0 < step < SHORTEST_STEP and unit != 1.0:
        raise recording_error(
            "clock-unit",
            recording,
            f"{moved}; if it counts {as_read}, the sample rate is {1.0 / step:.3g} Hz, at which no arm is recorded.",
            "find out the unit of the time column, and give the length of this unit in seconds (time_unit = …).",
        )


def _counted_unit(step: float, unit: float) -> float | None:
    """Length [s] of the unit that a clock probably counts; `None` if the unit with which it was read is plausible.

    Args:
        step: Median step [s], with the unit with which the clock was read.
        unit: Length of the unit with which the clock was read [s].
    """
    shorter = unit_of_step(step)
    if shorter is not None:
        return float(f"{unit * shorter[0]:.12g}")
    if not 0.0 < step < SHORTEST_STEP:
        return None
    low, high = COUNTED_STEPS
    return next((each for each in UNITS if each > unit and low <= step / unit * each < high), None)


def without_ties(recording: Recording) -> tuple[Recording, tuple[Finding, ...]]:
    """Drops rows that have the time stamp of the row before, as a clock with a coarse resolution causes.

    Raises an error if there are more of these rows than a coarse clock can cause.
    """
    if recording.time is None:
        return recording, ()
    tied = np.concatenate([[False], np.diff(recording.time) == 0])
    if not tied.any():
        return recording, ()
    row = int(np.argmax(tied))
    evidence = f"{tied.sum()} of {tied.size} rows have the time stamp of the row before; the first is row {row + 1}"
    if tied.mean() > CLOCK_TIES:
        raise recording_error(
            "clock-jitter",
            recording,
            f"{evidence}; their values differ.",
            Remedy(
                "find out what the time column contains; if the rows are equally spaced, leave it out (",
                setting("columns", {"time": ""}),
                ") and give the key `rate`.",
            ),
        )
    return select_rows(recording, ~tied), (
        Finding("clock-jitter", "info", "time", f"{evidence}; these rows were dropped."),
    )
