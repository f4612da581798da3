"""Segments of a recording between the gaps of its clock, and their resampling at a uniform rate."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, all_finite, frozen
from armid.errors import Finding, RecordingError
from armid.input_boundary import within
from armid.maths.median import median
from armid.maths.signals.resampling import resample
from armid.measurement.recording import Recording
from armid.remedy import Remedy, setting

TILE = 16384
"""Number of time stamps that are compared with a uniform grid at a time."""

GAP_STEPS = 2.5
"""Length of a time step, in median steps, above which it counts as a gap. Two successive lost samples exceed this
length; jitter does not."""

GAP_PERIODS = 0.25
"""Length of a time step, in periods of the cut-off, up to which it is not a gap. Inside such a step, a cubic spline
has an error of 2 % of the amplitude at the cut-off and of 4e-4 at 0.4 times the cut-off, whereas a gap costs a second
of rows. In a recording of the UR10e, 10, 20 and 30 % of the rows were removed at random. With this value, the errors
on other motion were 1.00, 1.00 and 1.03 times those with the whole recording. With a value of 0.1, they were 1.20 and
3.42 times as large for 10 and 20 %, and no row was left for 30 %."""

FEW_GAPS = 3
"""Largest number of gaps for which each gap has its own finding."""

JITTER = 0.05
"""Standard deviation of the time stamps from a uniform grid, in steps, above which samples are resampled. Smaller
jitter changes a position by less than the motion in a twentieth of a step."""

ASTRAY = 0.5
"""Distance of a time stamp from a uniform grid, in steps, above which samples are resampled. With this limit, a
sample that is lost near an end is detected, which hardly changes the standard deviation."""

WHOLE = 0.05
"""Difference between the duration of all periods and a whole number of samples above which the samples are resampled
[samples]."""

DIGITS = 10
"""Number of significant digits of a mean sample rate. Further digits come from rounding of the clock; without them,
the times drift by less than 1e-6 s in an hour."""

CONTINUED = 3
"""Number of samples by which a periodic motion is continued before it is resampled: one to reach the end of the
period, and two so that the spline has points on both sides."""


ALWAYS_RESAMPLED = 1e6
"""Number of samples that every uniform grid may have."""

BRIEF = 1.0
"""Length of a segment, in periods of the cut-off, below which the segment is too short for a filter. Without this
limit, a segment of two samples a nanosecond apart would have a huge sample rate and need a filter of unlimited
length."""


@dataclass(frozen=True, eq=False, slots=True)
class Segment:
    """Segment of a recording: consecutive samples without a gap.

    Attributes:
        time: Times of the samples, shape (N,) [s].
        rate: Average sample rate [Hz].
        q: Positions, shape (N, n) [rad or m].
        dq: Velocities, shape (N, n) [rad/s or m/s]; `None` if not recorded.
        ddq: Accelerations, shape (N, n) [rad/s² or m/s²]; `None` if not recorded.
        effort: Torque, shape (N, n) [N·m or N].
        bad: Mask of the samples that must not be used, shape (N, n).
        number: Number of each sample in the recording, shape (N,), if samples in between have been left out.
    """

    time: Array
    rate: float
    q: Array
    dq: Array | None
    ddq: Array | None
    effort: Array
    bad: NDArray[np.bool_]
    number: NDArray[np.int64] | None = None

    @property
    def samples(self) -> int:
        """Number of samples N."""
        return len(self.time)

    def changed(
        self,
        signals: Callable[[Array], Array],
        time: Array,
        rate: float,
        bad: Callable[[NDArray[np.bool_]], NDArray[np.bool_]],
    ) -> Segment:
        """Applies one function to all signals and another one to the mask; the result has no missing samples."""
        dq = None if self.dq is None else signals(self.dq)
        ddq = None if self.ddq is None else signals(self.ddq)
        return Segment(time, rate, signals(self.q), dq, ddq, signals(self.effort), bad(self.bad))

    def select(self, rows: NDArray[np.bool_]) -> Segment:
        """Part of the segment with the samples that a mask (N,) selects."""
        few = self.changed(lambda x: x[rows], self.time[rows], self.rate, lambda bad: bad[rows])
        number = np.arange(self.samples) if self.number is None else self.number
        return replace(few, number=number[rows])

    def cut(self, first: int, stop: int) -> Segment:
        """Part of the segment with the samples `first` to `stop` - 1; the arrays are not copied."""
        part = slice(first, stop)
        number = None if self.number is None else self.number[part]
        few = self.changed(lambda x: x[part], self.time[part], self.rate, lambda bad: bad[part])
        return replace(few, number=number)


def jitter(time: Array, number: NDArray[np.int64] | None = None) -> float:
    """Standard deviation of time stamps from the uniform grid that fits best, in steps of the grid.

    Args:
        time: Time stamps, shape (N,) [s].
        number: Number of each sample in the recording, shape (N,), if some samples have been left out.
    """
    return _unevenness(time, number)[0]


def is_even(time: Array, number: NDArray[np.int64] | None = None) -> bool:
    """Checks whether samples were taken at a uniform rate; the arguments are those of `jitter`."""
    deviation, largest = _unevenness(time, number)
    return deviation <= JITTER and largest <= ASTRAY


def is_brief(segment: Segment, cutoff: float) -> bool:
    """Checks whether a segment is too short for a filter with the given cut-off [Hz], so that it must be left out."""
    return segment.samples * cutoff < BRIEF * segment.rate


def _unevenness(time: Array, number: NDArray[np.int64] | None) -> tuple[float, float]:
    """Standard deviation and largest distance of time stamps from the grid that fits best, in steps of the grid."""
    if len(time) < 3:
        return 0.0, 0.0
    count = len(time)
    mean, middle = float(time.mean()), (count - 1) / 2.0 if number is None else float(number.mean())

    def parts() -> Iterator[tuple[Array, Array]]:
        for begin in range(0, count, TILE):
            end = min(begin + TILE, count)
            index = np.arange(begin, end) if number is None else number[begin:end]
            yield np.asarray(index - middle, dtype=np.float64), time[begin:end] - mean

    sums = np.sum([(index @ index, index @ centred) for index, centred in parts()], axis=0)
    step = float(sums[1] / sums[0])
    total, squares, largest = 0.0, 0.0, 0.0
    for index, centred in parts():
        off = (centred - step * index) / step
        total, squares = total + float(off.sum()), squares + float(off @ off)
        largest = max(largest, float(off.max()), -float(off.min()))
    return float(np.sqrt(max(0.0, squares / count - (total / count) ** 2))), largest


def cut_at_gaps(recording: Recording, cutoff: float | None) -> tuple[list[Segment], list[Finding]]:
    """Cuts a recording at the gaps of its clock.

    Samples that are not finite, and short sequences of samples that are not valid for any joint, count as missing.
    Missing samples are a gap only if the time step from the sample before to the sample after them is long.

    Args:
        recording: Recording in the robot's joint order, SI units, joint side; its rows are consecutive in time.
        cutoff: Highest cut-off that will be used [Hz]; `None` if nothing is filtered.

    Raises:
        RecordingError: There is neither clock nor rate, or no effort; a valid value is not finite; time does not
            increase; or there are fewer than two samples.
    """
    whole, median = gather(recording)
    longest = max(GAP_STEPS * median, GAP_PERIODS / cutoff if cutoff else 0.0)
    whole = _without_specks(whole, longest)
    borders = [0, *(np.flatnonzero(np.diff(whole.time) > longest) + 1).tolist(), whole.samples]
    segments = [whole.cut(first, stop) for first, stop in pairwise(borders)]
    findings = _gap_findings(whole, np.asarray(borders[1:-1], dtype=np.int64) - 1, median, recording.source)
    return [replace(segment, rate=_mean_rate(segment, median)) for segment in segments], findings


def _gap_findings(whole: Segment, before: NDArray[np.int64], median: float, source: str) -> list[Finding]:
    """Findings about the gaps of a clock: one for each gap, or one for all gaps if there are many.

    Args:
        whole: All samples of the recording.
        before: Index of the last sample before each gap, shape (k,).
        median: Median step of the clock [s].
        source: Path of the recording.
    """
    steps = np.diff(whole.time)[before]
    starts = whole.time[before] - whole.time[0]
    if len(before) > FEW_GAPS:
        longest = int(np.argmax(steps))
        evidence = (
            f"The clock has {len(before)} gaps; {steps.sum():.3g} s are missing. The first gap is {starts[0]:.2f} s "
            f"after the start of the log, and the longest, of {steps[longest]:.3g} s, {starts[longest]:.2f} s after "
            f"it; this is {steps[longest] / median:.1f} times the median step."
        )
        note = "The run was split at these gaps, and nothing is filtered across them. Rows next to them are lost."
        return [Finding("clock-gap", "warning", source, evidence, f"{note} If many are missing, record again.")]
    return [
        Finding(
            "clock-gap",
            "warning",
            source,
            f"There is no sample for {step:.3g} s, from {start:.2f} s after the start of the log; this is "
            f"{step / median:.1f} times the median step.",
            "The run was split at this gap, and nothing is filtered across it. If many samples are missing, record "
            "again.",
        )
        for step, start in zip(steps, starts, strict=True)
    ]


def _without_specks(whole: Segment, longest: float) -> Segment:
    """Leaves out samples that are not valid for any joint, if the time step across them is at most `longest` [s]."""
    if not whole.bad.any():
        return whole
    spoilt = whole.bad.all(axis=1)
    if not spoilt.any() or spoilt.all():
        return whole
    good = np.flatnonzero(~spoilt)
    after = np.searchsorted(good, np.arange(whole.samples))  # first good sample from each one on
    inside = spoilt & (after > 0) & (after < len(good))
    last, following = good[np.maximum(after - 1, 0)], good[np.minimum(after, len(good) - 1)]
    keep = ~(inside & (whole.time[following] - whole.time[last] <= longest))
    return whole.select(keep)


def gather(recording: Recording, *, clock: bool = True) -> tuple[Segment, float]:
    """Joins all samples with finite values in one segment, which may have gaps.

    The median step of its clock [s] is returned, too.

    Args:
        recording: Recording in the robot's joint order, SI units, joint side.
        clock: True if the recording must have a clock or a rate. If false, the row number is used as time.
    """
    name = recording.source or "The recording"
    if recording.effort is None:
        possible = next((each for each in recording.findings if each.code == "effort-possible"), None)
        hint = "" if possible is None else f" {possible.evidence}"
        remedy = "" if possible is None else possible.remedy
        wanted = Remedy(
            "if the file has columns of effort, name them: ", setting("columns", {"effort": ["…", "…"]}), "."
        )
        servo = (
            "" if recording.command is None else " It has a command: `armid servo` identifies arms without torque."
        )
        raise RecordingError(f"{name} has no effort (torque or current).{servo}{hint}", remedy=remedy or wanted)
    if not clock:
        time = np.arange(float(recording.samples))
    elif recording.time is None and recording.rate is None:
        raise RecordingError(
            f"{name} has no time column, and its sample rate is not given.",
            possible="a time column, or for instance `rate = 100.0` (Hz) under [[recording]]",
            remedy="give the key `rate`; or `consecutive = false`, if the rows are separate samples.",
        )
    else:
        time = recording.time
        if time is None:
            time = frozen(np.arange(recording.samples) / (recording.rate or 1.0))
    quantities = recording.q, recording.dq, recording.ddq, recording.effort
    segment = Segment(time, 1.0, *quantities, ~recording.valid, recording.number)
    signals = [x for x in quantities if x is not None]
    if recording.samples >= 2 and all(all_finite(x) for x in (time, *signals)):
        return segment, _median_step(time, name)
    present = np.isfinite(time) & np.logical_and.reduce([np.isfinite(x).all(axis=1) for x in signals])
    lost = ~present & recording.valid.any(axis=1)
    if lost.any() or present.sum() < 2:
        raise RecordingError(
            f"{name}: only {int(present.sum())} of {recording.samples} samples are finite; the first sample "
            f"that is neither finite nor excluded is sample {int(np.argmax(lost))}.",
            possible="at least two samples, all of them finite",
            remedy="remove these samples, or exclude their interval (key `exclude`).",
        )
    if not present.all():
        segment = segment.select(present)
    return segment, _median_step(segment.time, name)


def _median_step(time: Array, name: str) -> float:
    steps = np.diff(time)
    if not steps.min() > 0.0:
        sample = int(np.argmin(steps > 0))
        raise RecordingError(
            f"{name}: time does not increase from t = {time[sample]:.9g} s (sample {sample}) to "
            f"t = {time[sample + 1]:.9g} s.",
            remedy="remove the samples that are not in the order of time; if the clock is too coarse for the sample "
            "rate, leave the time column out and give the rate.",
        )
    return float(median(steps))


def _mean_rate(segment: Segment, step: float) -> float:
    """Mean rate of a clock [Hz], rounded to the digits that are certain."""
    time, number = segment.time, segment.number
    steps = len(time) - 1 if number is None else int(number[-1] - number[0])
    mean = steps / float(time[-1] - time[0]) if len(time) > 1 else 1.0 / step
    return float(f"{mean:.{DIGITS}g}")


def resample_uniform(segment: Segment, span: float | None, rows: float, *, each: bool) -> Segment:
    """Segment on a uniform grid: the grid of its clock if this is uniform enough, otherwise a new grid.

    On the grid of the clock, only missing samples are interpolated, by a cubic spline; all other samples are
    unchanged. On a new grid, all samples are interpolated.

    Args:
        segment: Segment whose time stamps need not be uniform.
        span: Period [s] that must contain a whole number of samples; `None` if there is none.
        rows: Rate of the output rows [Hz]; the new rate is a multiple of it. If it is 0, the new rate is not
            restricted.
        each: True if periods are used one by one, so that a fraction of a sample may be lost between two periods.
    """
    missed = 0.0
    if span is not None:
        samples = span * segment.rate
        missed = abs(samples - round(samples)) * (1.0 if each else max(1.0, segment.samples / samples))
    if is_even(segment.time, segment.number) and missed <= WHOLE:
        return _filled(segment)
    length = 1.0 if span is None else span
    unit = 1.0 if span is not None else 0.0  # samples that the new rate must be a multiple of, in each span
    if rows:
        unit = rows if span is None else float(max(1, round(span * rows)))
    wanted = segment.rate * length
    wanted = unit * np.ceil(wanted / unit * (1.0 - 1e-9)) if unit else wanted
    return uniform(segment, float(wanted) / length, span)


def _filled(segment: Segment) -> Segment:
    """Interpolates the missing samples of a uniform segment; new samples next to a bad sample are marked as bad."""
    if segment.number is None:
        return segment
    place = segment.number - segment.number[0]
    every = np.arange(place[-1] + 1)
    if len(every) == len(place):
        return segment
    time = np.interp(every, place, segment.time)
    before = np.searchsorted(place, every, side="right") - 1
    behind = np.searchsorted(place, every)

    def signals(x: Array) -> Array:
        whole = resample(segment.time, x, time)
        whole[place] = x
        return whole

    return segment.changed(signals, time, segment.rate, lambda bad: bad[before] | bad[behind])


def uniform(segment: Segment, rate: float, period: float | None = None) -> Segment:
    """Resamples a segment on a uniform grid from its first sample; samples next to bad ones are marked as bad.

    Args:
        segment: Segment whose time stamps need not be uniform.
        rate: Rate of the uniform grid [Hz].
        period: Period of the motion, if it repeats [s]. The grid then also contains the time between the last sample
            and the end of the period, for which the samples one period earlier are used.
    """
    time, end = segment.time, float(segment.time[-1])
    order = np.arange(len(time))
    if period is not None:
        again = np.searchsorted(time, end - period, side="right") + np.arange(CONTINUED)
        order = np.append(order, again[again < len(time)])
        time = np.append(time, segment.time[order[len(time) :]] + period)
        end = min(end + (1.0 - 1e-9) / segment.rate, float(time[-1]))
    wanted = (end - float(time[0])) * rate
    if not wanted <= ALWAYS_RESAMPLED:
        within("resampled", wanted / segment.samples, "The uniform grid of a recording", RecordingError)
    grid = time[0] + np.arange(int((end - time[0]) * rate * (1 + 1e-12)) + 1) / rate
    before = np.clip(np.searchsorted(time, grid, side="right") - 1, 0, len(time) - 2)

    def bad(flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
        return flags[order[before]] | flags[order[before + 1]]

    return segment.changed(lambda x: resample(time, x[order], grid), grid, rate, bad)
