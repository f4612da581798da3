"""Detection of the period of a repeated motion from the positions.

A motion repeats with a lag L if q(t + L) = q(t) for every joint that moves, except during the moves to the start pose
and back. Possible lags are taken from the autocorrelation of the whole recording. Each possible lag is refined to a
fraction of a sample. It is accepted if the longest segment on which q(t + L) and q(t) agree contains at least two
whole repetitions and most of all motion. The difference between q(t + L) and q(t) is compared with the distance that
a joint moves within a time L, so slow motions and random motions do not count as repeated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding
from armid.maths.median import median
from armid.measurement.processing.channels.position_noise import position_noise
from armid.measurement.processing.channels.statistics import interpolated, standard_deviation
from armid.measurement.processing.uniform_runs import Segment
from armid.measurement.remedy_builders import lines
from armid.remedy import Remedy, setting

RATE = 100.0
"""Rate at which positions are compared [Hz]; at 5 Hz, linear interpolation has an error of 1 % of the amplitude."""

FEWEST_COMPARED = 6
"""Smallest number of repetitions with which confidence intervals are computed from the differences between
repetitions."""

SHORTEST = 2.0
"""Shortest period that is searched [s]. A faster motion also repeats with a multiple of its period; blocks that are
shorter than the correlation time of residuals would not be independent."""

LIKELY = 0.6
"""Mean squared difference of positions at a lag, divided by the mean squared difference of unrelated positions, below
which the lag is examined further. With two repetitions, the moves to the start pose and back contribute a third of
this value."""

SAME = 0.02
"""Largest RMS difference between repetitions, without noise and divided by the standard deviation of the joint's
positions, at which motions count as equal. The error of controllers is about 0.01."""

ALIKE = 0.1
"""Largest difference between repetitions at a single instant, divided by the standard deviation of the joint's
positions, at which motions count as equal at this instant."""

AS_GOOD, GOOD = 2.0, 0.002
"""Largest RMS difference between repetitions at which a shorter lag is taken as the period: as a multiple of the
difference at the best lag, and as an absolute value (whichever is larger). Differences are divided by the standard
deviation of the positions."""

CLOSE = 0.1
"""Largest share of a period by which the repetitions may differ at each end, because the motion starts and stops
there."""

FAR = 4.0
"""Squared difference between repetitions at an instant, divided by its median over time, above which the instant is
ignored in the alignment of the repetitions."""

MOST = 0.75
"""Smallest share of the recording, and of all motion in the recording, that whole repetitions must contain."""

MOVES = 1e-3
"""Smallest standard deviation of positions with which a joint counts as moving [rad or m]; a joint that holds a pose
has a smaller one."""

CLEAR = 30.0
"""Smallest ratio of the standard deviation of positions to their noise with which a joint counts as moving."""

SNAP = 0.05
"""Largest difference between a period and a whole number of samples at which the period is rounded to this number
[samples]."""

LACKS = 1.5
"""Number of samples by which the last repetition may be too short. A log of K periods of m samples may end with
sample K m - 1 or K m - 2."""

OUTSIDE = 0.05
"""Sum of the times before and after the repetitions above which a finding states these times [s]."""

OFF = 0.02
"""Largest relative difference between the stated period and a multiple of the detected period, or the reverse, at
which the stated period counts as right. Smaller differences are timing errors, which the doctor measures."""

ROUNDS = 4
"""Number of corrections of a lag; each one reduces the error of the lag to a tenth or less."""


SPARSE = 10_000
"""Number of samples, evenly spread, by which a lag of a long recording is examined first."""

FEW = 0.3
"""Smallest number of instants at which the signals must about agree, divided by the lag, so that all instants are
examined. Repetitions agree at all instants, but for gaps of a tenth of a period."""


@dataclass(frozen=True, slots=True)
class Repetition:
    """Repetitions that were detected in a motion.

    Attributes:
        period: Period [s].
        start: Start of the first repetition on the recording's clock [s].
        count: Number of whole repetitions.
        apart: RMS difference between repetitions, divided by the standard deviation of the position within a time of
            one period; largest value of all joints.
    """

    period: float
    start: float
    count: int
    apart: float


def period_of(
    segments: Sequence[Segment],
    stated: float | Literal["find"] | None,
    start: float | None,
    source: str,
    findings: list[Finding],
    noise: Array | None = None,
) -> tuple[float | None, float | None]:
    """Period and start [s] of the motion of a recording: stated values after a check, or values from the positions.

    Args:
        segments: Segments of the recording between its gaps.
        stated: Stated period [s]; `find` if it must be detected; `None` if the motion does not repeat.
        start: Stated start of the first period [s]; `None` if it is not stated.
        source: Path of the recording.
        findings: List to which a finding about the repetitions is added.
        noise: Standard deviation of the noise of the positions, shape (n,), if it is known [rad or m].
    """
    if stated == "find":
        return find_period(segments, source, findings, noise)
    if stated is not None:
        check_period(segments, stated, start, source, findings)
    return stated, start


def find_period(
    segments: Sequence[Segment], source: str, findings: list[Finding], noise: Array | None = None
) -> tuple[float | None, float | None]:
    """Detects period and start [s] of the motion of a recording without gaps; `None` if it does not repeat.

    Args:
        segments: Segments of the recording between its gaps.
        source: Path of the recording.
        findings: List to which a finding about the repetitions is added.
        noise: Standard deviation of the noise of the positions, shape (n,), if it is known [rad or m].
    """
    if len(segments) != 1:
        return None, None
    segment = segments[0]
    found = repetition(segment.time, segment.q, segment.rate, noise)
    if found is None:
        return None, None
    begin, end = float(segment.time[0]), float(segment.time[-1]) + 1.0 / segment.rate
    before, after = max(0.0, found.start - begin), max(0.0, end - found.start - found.count * found.period)
    ends = f"{before:.3g} s before and {after:.3g} s after the repetitions"
    outside = f" {ends} are not used." if before + after > OUTSIDE else ""
    evidence = f"The positions repeat every {found.period:.6g} s, {found.count} times.{outside}"
    use = (
        "Confidence intervals can be computed from the differences between repetitions; the result states the "
        "method that was used, and the reason."
        if found.count >= FEWEST_COMPARED
        else f"Confidence intervals are computed from the differences between repetitions only if there are "
        f"{FEWEST_COMPARED} or more; the result states the method that was used."
    )
    remedy = Remedy(
        f"{use} If the motion does not repeat, give ",
        setting("period", "none"),
        "; if this period is wrong, give the right period in s with the same key.",
    )
    findings.append(Finding("period-found", "info", source, evidence, remedy))
    return found.period, found.start


def check_period(
    segments: Sequence[Segment], period: float, start: float | None, source: str, findings: list[Finding]
) -> None:
    """Adds a finding if the motion of a recording without gaps does not repeat with the stated period.

    Args:
        segments: Segments of the recording between its gaps.
        period: The stated period [s].
        start: Stated start of the first period [s]; `None` if it is not stated.
        source: Path of the recording.
        findings: List to which the finding is added.
    """
    if len(segments) != 1:
        return
    segment = segments[0]
    begin = 0 if start is None else int(np.searchsorted(segment.time, start))
    time, q = segment.time[begin:], segment.q[begin:]
    lag = round(period * segment.rate)
    if len(time) < 2 * lag or lag < 1:
        return  # it is not run twice
    moves = q.std(axis=0) > MOVES
    apart = ((q[lag:] - q[:-lag])[:, moves] ** 2).mean(axis=0) / (2.0 * q[:, moves].var(axis=0))
    found = repetition(time, q, segment.rate)
    if not moves.any() or (float(apart.mean()) <= LIKELY and (found is None or _multiple(period, found.period))):
        return
    if found is None:
        evidence = f"The positions do not repeat every {period:g} s, the stated period."
        remedy = lines("the motion does not repeat", period="none")
    elif _multiple(period, found.period):
        return
    else:
        evidence = f"The positions repeat every {found.period:.6g} s, not every {period:g} s, the stated period."
        remedy = lines(period=float(f"{found.period:.6g}"))
    findings.append(Finding("period-misaligned", "warning", source, evidence, remedy))


def _multiple(stated: float, found: float) -> bool:
    """Checks whether the stated period is an integer multiple of the detected one, or the reverse."""
    ratio = stated / found
    return any(abs(x - round(x)) <= OFF * x and round(x) >= 1 for x in (ratio, 1.0 / ratio))


def repetition(time: Array, q: Array, rate: float, noise: Array | None = None) -> Repetition | None:
    """Detects the repetitions of a motion that was executed at least twice; `None` if there are none.

    Args:
        time: Times of the samples, which need not be uniform, shape (N,) [s].
        q: Positions as they were logged, shape (N, n) [rad or m].
        rate: Average sample rate [Hz].
        noise: Standard deviation of the noise of the positions, shape (n,) [rad or m]; it is estimated if not given.
    """
    length = float(time[-1] - time[0])
    step = 1.0 / min(RATE, rate)
    grid = time[0] + np.arange(int(length / step) + 1) * step
    noise = position_noise(q, time) if noise is None else noise
    deviation = standard_deviation(q)
    moves = deviation > np.maximum(MOVES, CLEAR * noise)
    shortest = max(2, round(SHORTEST / step))
    if not moves.any() or len(grid) < 2 * shortest:
        return None
    x = interpolated(grid, time, q)[:, moves]
    x = (x - x.mean(axis=0)) / deviation[moves]
    noise = noise[moves] / deviation[moves]
    found = [each for lag, within in _likely(x, shortest) if (each := _agreement(x, lag, within, noise)) is not None]
    if not found:
        return None
    least = min(each.apart for each in found)
    best = next(each for each in found if each.apart <= max(AS_GOOD * least, GOOD))
    return _whole(grid, x, best, length + 1.0 / rate, rate)


@dataclass(frozen=True, slots=True)
class _Agreed:
    """Repeated segment of a motion: lag [samples], first sample, end, and RMS difference between repetitions."""

    lag: float
    first: int
    last: int
    apart: float


def _likely(x: Array, shortest: int) -> list[tuple[int, Array]]:
    """Lags [samples] at which signals (N, m) may repeat, at least `shortest`.

    Each lag comes with the variance of the signals within a time of one lag, shape (m,).
    """
    samples = len(x)
    size = 1 << (2 * samples - 1).bit_length()
    transformed = np.fft.rfft(x, size, axis=0)
    correlation = np.fft.irfft(np.abs(transformed) ** 2, size, axis=0)[:samples]
    squares = np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(x**2, axis=0)])
    lags = np.arange(samples)
    pairs = (samples - lags)[:, None]
    apart = (squares[samples - lags] + squares[samples] - squares[lags] - 2.0 * correlation) / pairs
    apart = np.maximum(apart, 0.0)
    # Half the mean squared difference of two instants within a time L, each pair of them once.
    lengths = np.maximum(lags, 1)[:, None]
    within = (lengths * np.cumsum(apart, axis=0) - np.cumsum(lags[:, None] * apart, axis=0)) / lengths**2
    ratio = (apart / (2.0 * np.maximum(within, np.finfo(float).tiny))).mean(axis=1)
    longest = min(samples - 2, int(samples / 2 * (1.0 + CLOSE)))
    inner = np.arange(shortest, longest)
    inner = inner[(ratio[inner] < LIKELY) & (ratio[inner] <= ratio[inner - 1]) & (ratio[inner] <= ratio[inner + 1])]
    return [(int(k), within[k]) for k in inner]


def _agreement(x: Array, near: int, within: Array, noise: Array) -> _Agreed | None:
    """Refines a possible lag to the lag at which the signals (N, m) agree best with themselves.

    `within` is the variance within a time of one lag, `noise` the noise of the signals, shape (m,) each. The result
    is `None` if too few samples agree.
    """
    every = len(x) // SPARSE
    if every > 1:  # most lags of a long recording are refused by a few of its samples
        lag = _refined(x, near, within, every)
        if lag is None:
            return None
        ahead, _ = _ahead(x, np.arange(0, int(len(x) - lag), every), lag)
        near_enough = _largest(ahead, within) <= 4.0 * ALIKE**2 + 4.0 * float((noise**2 / within).max()) * FAR**2
        if near_enough.sum() * every < FEW * lag:
            return None
    lag = _refined(x, near, within, 1)
    if lag is None:
        return None
    ahead, _ = _ahead(x, np.arange(int(len(x) - lag)), lag)
    off = _largest(ahead, within)
    alike = off <= ALIKE**2 + 2.0 * float((noise**2 / within).max()) * FAR**2
    first, last = _longest(alike, round(CLOSE * lag))
    if last - first < (1.0 - CLOSE) * lag:
        return None
    known = np.flatnonzero(alike[first:last]) + first
    mismatch = (ahead[known] ** 2).mean(axis=0) / within
    moved = (np.diff(x, axis=0) ** 2).sum(axis=1)
    same = (mismatch <= SAME**2 + FAR * noise**2 / within).all()
    if not same or moved[first : last + round(lag)].sum() < MOST * moved.sum():
        return None
    return _Agreed(lag, first, last, float(np.sqrt(mismatch.max())))


def _refined(x: Array, near: int, within: Array, every: int) -> float | None:
    """Lag [samples] at which signals agree best, from each sample number `every`; `None` if it is far from `near`."""
    lag = float(near)
    for _ in range(ROUNDS):
        ahead, speed = _ahead(x, np.arange(0, int(len(x) - lag), every), lag)
        off = _largest(ahead, within)
        sure = off <= FAR * median(off) + ALIKE**2 / FAR
        energy = float((speed[sure] ** 2 / within).sum())
        if energy == 0.0:
            return None
        lag -= float((speed[sure] * ahead[sure] / within).sum()) / energy
        if abs(lag - near) > CLOSE * near:
            return None
    return lag


def _ahead(x: Array, first: NDArray[np.int64], lag: float) -> tuple[Array, Array]:
    """Differences of signals (N, m) over one lag, from the samples `first` on, and their derivatives by the lag."""
    later = first + lag
    index = np.arange(len(x), dtype=np.float64)
    ahead = np.column_stack([np.interp(later, index, each) for each in x.T]) - x[first]
    below = np.clip(later.astype(np.int64), 0, len(x) - 2)
    return ahead, x[below + 1] - x[below]


def _largest(ahead: Array, within: Array) -> Array:
    """Largest squared difference (N,) of the m signals at each sample, divided by the variances `within` (m,)."""
    return np.maximum.reduce([signal**2 / variance for signal, variance in zip(ahead.T, within, strict=True)])


def _longest(good: NDArray[np.bool_], bridged: int) -> tuple[int, int]:
    """First sample and end of the longest segment of true flags; gaps of up to `bridged` false flags are ignored."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]))).reshape(-1, 2)
    if not len(ends):
        return 0, 0
    apart = np.flatnonzero(ends[1:, 0] - ends[:-1, 1] > bridged)
    first = ends[np.concatenate([[0], apart + 1]), 0]
    last = ends[np.concatenate([apart, [len(ends) - 1]]), 1]
    k = int(np.argmax(last - first))
    return int(first[k]), int(last[k])


def _whole(grid: Array, x: Array, agreed: _Agreed, length: float, rate: float) -> Repetition | None:
    """Repetitions with period and start in seconds; the period is the mean time between successive repetitions."""
    step = float(grid[1] - grid[0])
    lag = agreed.lag
    count = int((agreed.last - agreed.first) / lag + 1.0 + CLOSE)
    if count > 2:
        lag = _from_ends(x, lag, agreed.first, count)
    period = lag * step
    if abs(period * rate - round(period * rate)) <= SNAP:
        period = round(period * rate) / rate
    count = min(count, int((length + LACKS / rate) / period))
    if count < 2 or count * period < MOST * length:
        return None
    # All of them lie in the recording, and begin with it where the motion begins about there.
    begin = float(grid[0])
    start = float(grid[agreed.first])
    start = begin if start - begin <= CLOSE * period else start
    return Repetition(float(period), float(min(start, begin + length - count * period)), count, agreed.apart)


def _from_ends(x: Array, lag: float, first: int, count: int) -> float:
    """Refines a lag [samples] by the delay between the first and the last repetition, divided by their distance."""
    for _ in range(ROUNDS):
        behind = (count - 1) * lag
        ahead, speed = _ahead(x, np.arange(first, min(first + int(lag), int(len(x) - behind))), behind)
        off = (ahead**2).max(axis=1)
        sure = off <= FAR * median(off) + ALIKE**2 / FAR
        energy = float((speed[sure] ** 2).sum())
        if energy == 0.0:
            return lag
        lag -= float((speed[sure] * ahead[sure]).sum()) / energy / (count - 1)
    return lag
