"""Checks of the rows of a recording: missing and repeated values, and whether rows are consecutive in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding, RecordingError
from armid.maths.median import median
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.clock_checks import RATE_TOLERANCE, check_clock, without_ties
from armid.measurement.processing.command_checks import without_incomplete_command
from armid.measurement.recording import Recording, recording_error, select_rows
from armid.measurement.remedy_builders import excluding, lines, naming
from armid.remedy import Assignment, Remedy, setting

MIN_SAMPLES = 10
"""Smallest number of samples of a recording; fewer are not enough for derivatives at both ends and for residuals."""

LARGEST = 1e15
"""Largest value of a channel in the unit of the log. Counts of encoders are below 2^40, and squares of larger values
spoil every fit."""

MOST_HOLES, LARGEST_HOLES = 8, 0.2
"""Largest number of segments with non-finite values, and largest share of the rows of a recording that lie in them,
for which the remedy is to exclude these segments. If there are more, the channel is faulty."""

REPEATED_RUN = 5
"""Largest number of successive rows equal to the row before that are dropped, because the recorder has repeated them.
A longer series of equal rows is a pause, whose rows stay on the grid and are masked."""

REACH = (20, 200)
"""Smallest and largest number of rows, before and after equal rows, that are used to estimate the rate of change."""

CHANCE, LEAST_STEPS = 1e-3, 3.0
"""Probability of equal rows below which they are not equal by chance, and smallest change of all channels together
after these rows. The change is counted in steps of the resolution; the channels of an arm at rest change by one or
two steps."""

SAME_STEP = 0.25
"""Largest difference between the step of q and the product of velocity and time step, relative to this product, at
which both count as equal. Filtered velocities are late, and encoders round positions."""

COHERENT = 0.8
"""Smallest share of the rows in motion whose step of q agrees with the velocity, with which rows count as
consecutive. In a log with jitter this share is 0.9, in separate samples about 0.1."""

MOVING = 0.05
"""Ratio of the speed in a row to the largest speed, above which the row is used to estimate the sample rate."""

SMOOTH = 0.5
"""Ratio of the RMS step from row to row to the standard deviation of positions below which rows are consecutive. The
ratio is √2 for separate samples, and below 0.1 for a motion."""


def clean(recording: Recording, log_format: LogFormat) -> tuple[Recording, tuple[Finding, ...]]:
    """Checks the clock, drops or masks rows that are not measurements, and determines whether rows are consecutive.

    Args:
        recording: Recording as it was read from the file.
        log_format: Log format with which the recording was read.

    Returns:
        The recording and the findings. The recording has `time` or `rate`, a known value of `consecutive`, and a
        complete mask `valid`.

    Raises:
        RecordingError: Values are NaN, the clock is missing or wrong, or there are too few samples.
    """
    rate = recording.rate if log_format.rate is None else log_format.rate
    given = recording.consecutive if log_format.consecutive is None else log_format.consecutive
    recording = replace(recording, rate=rate, consecutive=given)
    recording, lost = without_incomplete_command(recording)
    recording = _without_excluded_nan(recording, log_format)
    _refuse_nan(recording, log_format)
    _refuse_few(recording)
    check_clock(recording, log_format)
    recording, findings = _without_repeats(recording)
    recording, ties = without_ties(recording)
    _refuse_few(recording)
    recording, found = _with_consecutive(recording, np.where(log_format.degrees(recording.n), 360.0, 2 * np.pi))
    return _masked(recording, log_format), (*lost, *findings, *ties, *found)


def _excluded(recording: Recording, log_format: LogFormat) -> NDArray[np.bool_]:
    """Mask of rows inside the excluded intervals, shape (N,)."""
    inside = np.zeros(recording.samples, dtype=np.bool_)
    if not log_format.exclude:
        return inside
    if recording.time is None and recording.rate is None:
        raise RecordingError(
            "The key `exclude` gives times, but the recording has neither a time column nor a sample rate.",
            remedy="give `rate`, or name the time column under `columns`.",
        )
    time = np.arange(recording.samples) / (recording.rate or 1.0) if recording.time is None else recording.time
    for t0, t1 in log_format.exclude:
        inside |= (time >= t0) & (time <= t1)
    return inside


def _check_exclude(recording: Recording, log_format: LogFormat) -> None:
    """Raises an error for excluded intervals outside the time of the recording, which refer to another clock."""
    if recording.time is None:
        return
    for t0, t1 in log_format.exclude:
        if t1 < recording.time[0] or t0 > recording.time[-1]:
            raise RecordingError(
                f"the interval [{t0:g}, {t1:g}] s of the key `exclude` lies outside the time of the recording.",
                source=recording.source,
                possible=f"times from {recording.time[0]:g} to {recording.time[-1]:g} s",
                remedy="give the interval on the clock of this recording, or remove it.",
            )


def _without_excluded_nan(recording: Recording, log_format: LogFormat) -> Recording:
    """Drops excluded rows with NaN if the recording has a clock; the dropped rows then appear as a gap."""
    _check_exclude(recording, log_format)
    broken = (~_is_number(_everything(recording))).any(axis=1)
    if recording.time is None or not log_format.exclude or not broken.any():
        return recording
    return select_rows(recording, ~(broken & _excluded(recording, log_format)))


def _masked(recording: Recording, log_format: LogFormat) -> Recording:
    """Masks the rows inside the excluded intervals."""
    if not log_format.exclude:
        return recording
    inside = _excluded(recording, log_format)
    if inside.all():
        raise RecordingError(
            "the intervals of the key `exclude` contain all rows.",
            remedy="exclude shorter intervals; they are given in seconds on the clock of the recording.",
            source=recording.source,
        )
    return replace(recording, valid=recording.valid & ~inside[:, None])


def _everything(recording: Recording) -> Array:
    """All measured channels in one matrix, shape (N, number of channels).

    The command is among them if there is no effort, because it then stands in the place of the effort. Beside an
    effort it does not decide about rows, so that all results of the effort are the same with and without it.
    """
    measured = (recording.q, recording.dq, recording.ddq, _input(recording))
    return np.hstack([values for values in measured if values is not None])


def _input(recording: Recording) -> Array | None:
    """Effort of a recording, or its command if it has no effort."""
    return recording.command if recording.effort is None else recording.effort


def _is_number(values: Array) -> NDArray[np.bool_]:
    """Mask of the values that are finite and not above `LARGEST`, in the shape of the values."""
    return np.abs(values) <= LARGEST  # false for NaN


def _refuse_nan(recording: Recording, log_format: LogFormat) -> None:
    """Raises an error if a value is not finite or too large; the remedy gives the intervals to exclude."""
    for name in ("time", "q", "dq", "ddq", "effort", "command"):
        values = getattr(recording, name)
        good = None if values is None else np.isfinite(values) if name == "time" else _is_number(values)
        if values is None or good is None or good.all():
            continue
        bad = np.argwhere(~good)
        row = int(bad[0, 0])
        empty = [] if values.ndim == 1 else np.flatnonzero(~good.any(axis=0)).tolist()
        if empty and name not in ("dq", "ddq"):
            raise recording_error(
                "value-missing",
                recording,
                f"{name} of {', '.join(recording.channels[k] for k in empty)} is empty: no row has a number.",
                "check that this channel was logged, or name another column under `columns`; if the joint did not "
                "move, lock it: lock in [robot], or --lock.",
            )
        channel = "time" if values.ndim == 1 else f"{name} of {recording.channels[int(bad[0, 1])]}"
        rows = np.unique(bad[:, 0])
        raise recording_error(
            "value-missing",
            recording,
            f"{channel} is {values[tuple(bad[0])]} in row {row + 1} (number of such rows: {len(rows)}).",
            _without(name, rows, recording, log_format),
        )


def _without(name: str, rows: NDArray[np.intp], recording: Recording, log_format: LogFormat) -> str:
    """Remedy that excludes rows with non-finite values, or leaves out a quantity that is not needed."""
    pieces = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    few = len(pieces) <= MOST_HOLES and len(rows) <= LARGEST_HOLES * recording.samples
    if few and recording.time is not None and np.isfinite(recording.time).all():
        times = [(float(recording.time[piece[0]]), float(recording.time[piece[-1]])) for piece in pieces]
        return excluding(log_format, times)
    if name in ("dq", "ddq"):
        return naming(log_format, {name: ""}, "the positions are then differentiated")
    if name == "time":
        return "correct the time column, or leave it out and give the key `rate`."
    return "record again, or, if the file has a time column, remove these rows from the file."


def _refuse_few(recording: Recording) -> None:
    if recording.samples < MIN_SAMPLES:
        raise RecordingError(
            f"the number of usable samples is too small: {recording.samples}.",
            source=recording.source,
            possible=f"at least {MIN_SAMPLES}; an identification needs some thousands",
            remedy="record a longer motion.",
        )


def _without_repeats(recording: Recording) -> tuple[Recording, tuple[Finding, ...]]:
    """Drops or masks rows that repeat the row before, because the recorder is faster than the bus of the robot.

    A recording without effort is returned unchanged: a command has no noise, and where it rests, equal rows of
    position and command are a measurement.
    """
    if recording.effort is None:
        return recording, ()
    values = _everything(recording)
    repeated = np.concatenate([[False], (values[1:] == values[:-1]).all(axis=1)])
    if not repeated.any():
        return recording, ()
    runs = np.flatnonzero(np.diff(np.concatenate([[False], repeated, [False]]))).reshape(-1, 2)
    if recording.consecutive is not False:
        runs = runs[_should_differ(values, runs)]
    repeated, drop = np.zeros((2, recording.samples), dtype=np.bool_)
    for start, end in runs:
        short = recording.time is not None and end - start <= REPEATED_RUN
        repeated[start:end], drop[start:end] = True, short or recording.consecutive is False
    if not repeated.any():
        return recording, ()
    finding = Finding(
        "rows-repeated",
        "warning",
        "",
        f"{repeated.sum()} of {recording.samples} rows repeat the row before; {drop.sum()} of them were "
        f"dropped, {(repeated & ~drop).sum()} masked.",
        "record at the rate at which the robot sends new samples.",
    )
    recording = replace(recording, valid=recording.valid & ~repeated[:, None])
    return select_rows(recording, ~drop), (finding,)


def _should_differ(values: Array, runs: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Decides for runs of equal rows whether the recorder has repeated one sample, from the channels around them.

    Rows may also be equal because the arm rests and the resolution of the channels is coarse. If a channel changes by
    r of its smallest steps per row before and after the equal rows, the probability that it keeps its value from one
    row to the next is 1 - r.

    Args:
        values: All channels, shape (N, c).
        runs: Index of the first equal row, and index after the last, for K runs of equal rows, shape (K, 2).

    Returns:
        Mask of the runs that are repetitions of one sample, shape (K,).
    """
    steps = np.abs(np.diff(values, axis=0))
    moving = steps.any(axis=0)
    steps = steps[:, moving]
    steps /= np.where(steps > 0.0, steps, np.inf).min(axis=0)
    sums = np.concatenate([np.zeros((1, steps.shape[1])), steps.cumsum(axis=0)])
    first, behind = runs.T
    reach = np.clip(2 * (behind - first + 1), *REACH)

    def rate(low: NDArray[np.intp], high: NDArray[np.intp]) -> Array:
        return (sums[high] - sums[low]) / np.maximum(high - low, 1)[:, None]

    before = np.where(first[:, None] > 1, rate(np.maximum(first - 1 - reach, 0), first - 1), np.inf)
    after = rate(behind - 1, np.minimum(behind - 1 + reach, len(steps)))
    chance = np.maximum(1.0 - np.minimum(before, after), 0.0).prod(axis=1)
    ends = np.append(steps, np.zeros((1, steps.shape[1])), axis=0)[behind - 1].sum(axis=1)
    return (chance < CHANCE) & (ends >= LEAST_STEPS)


def _with_consecutive(recording: Recording, turn: Array) -> tuple[Recording, tuple[Finding, ...]]:
    """Determines whether rows are consecutive in time: from the clock or, without a clock, from q and dq.

    Args:
        recording: Recording whose rows were checked.
        turn: Size of a full turn in the unit of each channel, shape (n,); a wrapped angle jumps by a full turn.
    """
    if recording.time is not None:
        clocked = replace(recording, rate=None, consecutive=recording.consecutive is not False)
        return _needing_derivatives(clocked), ()
    if recording.consecutive is False:
        return _needing_derivatives(recording), ()
    coherent, implied = _coherence(recording, turn)
    if recording.rate is None:
        raise _clockless(recording, implied if coherent >= COHERENT else float("nan"))
    if coherent >= COHERENT:
        if np.isfinite(implied) and abs(implied / recording.rate - 1) > RATE_TOLERANCE:
            raise recording_error(
                "clock-rate",
                recording,
                f"positions and velocities imply {implied:.3g} Hz, but the key `rate` gives {recording.rate:g} Hz.",
                lines("Hz, as positions and velocities imply", rate=float(f"{implied:.3g}")),
            )
        return replace(recording, consecutive=True), ()
    evidence = f"Steps from row to row agree with the velocity in {100 * coherent:.0f} % of the rows"
    if recording.dq is None:
        evidence = "Steps from row to row are about as large as the whole spread of the positions"
    if recording.consecutive:
        stated = f"{evidence}, but consecutive = true was given."
        finding = Finding("rows-not-consecutive", "warning", "", stated, lines(consecutive=False))
        return recording, (finding,)
    finding = Finding(
        "rows-not-consecutive",
        "warning",
        "",
        f"{evidence}, so the rows are treated as separate samples: they are not filtered, and terms with memory "
        "(hysteresis) cannot be used.",
        lines("they are separate samples", consecutive=False),
    )
    return _needing_derivatives(replace(recording, consecutive=False)), (finding,)


def _clockless(recording: Recording, implied: float) -> RecordingError:
    """Error for a missing clock; its message proposes a column as the clock, or the rate that q and dq imply [Hz]."""
    told = {each.code: each for each in recording.findings}
    possible, effort = told.get("clock-possible"), told.get("effort-possible")
    evidence = "the recording has neither a time column nor a sample rate"
    evidence += ", and no effort (torque or current)." if recording.effort is None else "."
    unread = "" if effort is None else effort.evidence
    of_effort = Remedy() if effort is None else Remedy.read(effort.remedy)
    if possible is not None:
        remedy = _both(Remedy.read(possible.remedy), of_effort)
        return recording_error("clock-missing", recording, f"{evidence} {possible.evidence}", remedy, unread)
    if np.isfinite(implied):
        rate = lines(f"Hz; positions and velocities imply {implied:.3g} Hz", rate=float(f"{implied:.3g}"))
        return recording_error("clock-missing", recording, evidence, _both(rate, of_effort), unread)
    remedy = Remedy(
        "find out the sample rate of the log and give it in Hz: ",
        Assignment("rate = HZ", {"rate": "HZ"}),
        "; or name the time column: ",
        setting("columns", {"time": "NAME", **of_effort.keys.get("columns", {})}),
        "; or, if the rows are separate samples, write ",
        setting("consecutive", value=False),
        " into a study.",
    )
    return recording_error("clock-missing", recording, evidence, remedy, unread)


def _both(clock: Remedy, effort: Remedy) -> Remedy:
    """Joins the remedies for a missing clock and for missing effort; if one has no settings, returns the first."""
    if not clock.keys or not effort.keys:
        return clock
    keys = dict(clock.keys)
    keys["columns"] = {**keys.get("columns", {}), **effort.keys["columns"]}
    settings = [setting(key, value) for key, value in keys.items()]
    return Remedy(*settings, note="; ".join(filter(None, (clock.note, effort.note))))


def _coherence(recording: Recording, turn: Array) -> tuple[float, float]:
    """Share of the rows in motion whose step of q agrees with dq, and the sample rate that q and dq imply [Hz].

    Without velocities, the share is 1 if the steps are small compared with the standard deviation of the positions,
    otherwise 0; the rate is NaN.
    """
    step = np.diff(recording.q, axis=0)
    step -= turn * np.round(step / turn)
    if recording.dq is None:
        spread = np.linalg.norm(np.std(recording.q, axis=0))
        rough = float(np.sqrt(np.mean(step**2, axis=0).sum()) / spread) if spread > 0 else 0.0
        return float(rough < SMOOTH), float("nan")
    mean = (recording.dq[1:] + recording.dq[:-1]) / 2
    speed = np.linalg.norm(mean, axis=1)
    along = (step * mean).sum(axis=1)
    telling = speed > MOVING * speed.max(initial=0.0)
    forward = telling & (along > 0)
    if not forward.any():
        return 0.0, float("nan")
    rate = float(median(speed[forward] ** 2 / along[forward]))
    off = np.linalg.norm(step - mean / rate, axis=1)
    return float(np.mean(off[telling] <= SAME_STEP * speed[telling] / rate)), rate


def _needing_derivatives(recording: Recording) -> Recording:
    """Raises an error if rows are not consecutive and lack velocity or acceleration; else returns the recording."""
    lacking = [name for name in ("dq", "ddq") if getattr(recording, name) is None]
    if not recording.consecutive and lacking:
        raise recording_error(
            "rows-not-consecutive",
            recording,
            f"rows are not consecutive in time and have no {' and no '.join(lacking)}; without consecutive rows "
            "these cannot be computed.",
            "record velocity and acceleration, too, or give consecutive = true if the rows are consecutive in time.",
        )
    return recording
