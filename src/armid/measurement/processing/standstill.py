"""Detection of standstill of joints, during which static friction can have any value up to its bound.

A joint that reverses passes through rest quickly: with acceleration a, its speed is below v for a time 2 v / a. A
joint that sticks stays at rest for longer, and moves fast soon afterwards. A segment of slow samples is therefore
standstill if an equally long segment before or after it contains a speed that is too high for a smooth passage
through zero. If a joint sticks once in a recording, it may also stick at other times; to detect these, a lower speed
before or after the slow segment is sufficient.

If all joints stand at the same time, the arm rests. Rests of a second or more occur before and after a motion and
between poses, not because of sticking. The motion before the rest determines the sign of friction, and the torque
contains the weight of the arm. Segments in which the arm rests do not count as standstill, unless only one joint
moves in the whole recording. In long rests, joints may creep (move very slowly).

Rests of less than a second occur if one motion ends and the next begins, for instance if a designed motion is
repeated. Within a few samples, the friction of every joint passes through its whole range. In these rows, friction at
rest would bias the estimate, and they do not contain more information about the weight than the motion before and
after them. Such rests count as standstill of all joints, together with the adjacent samples at which a joint is so
slow that it may stick.

If friction is tracked over time, long rests count as standstill, too: after a long rest, an estimate that forgets old
rows would depend on rows at rest only. These rests are detected for each joint from speeds over a quarter of a
second, which reduces the noise.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding
from armid.measurement.processing.channels.position_noise import position_noise
from armid.measurement.processing.channels.speed_tiles import SpeedTiles
from armid.measurement.processing.row_mask import MOST_STILL
from armid.measurement.recording import Recording

SPAN = 0.024
"""Time over which a speed is computed from positions [s]. Encoder noise of 1e-5 rad at 1 kHz then causes a noise of
3e-4 rad/s, and a standstill of 0.05 s can still be detected."""

NARROWEST = 2
"""Smallest number of samples before and after a sample from which its speed is computed, for low sample rates."""

SURE = 4.0
"""Number of standard deviations of the noise of a speed up to which the speed is not significant."""

SLOW = 0.005
"""Ratio of the speed of a joint to its RMS speed below which the joint counts as slow, if the noise is small enough.
At 1 rad/s² a joint passes through this range in some milliseconds."""

BLIND = 0.1
"""Largest ratio of the speed limit of slow samples to the RMS speed of a joint at which standstill can be
distinguished from noise."""

SHORTEST = 0.04
"""Duration of the shortest standstill that is detected [s]; a shorter one moves an estimate by less than its standard
deviation."""

LEAST = 3
"""Smallest number of samples of a standstill, for low sample rates."""

STANDS = 25.0
"""Speed that a joint must exceed before or after a slow segment, within the length of the segment, so that the
segment counts as standstill; it is divided by the speed limit of slow samples. The ratio is 3 at constant
acceleration, 9 if the velocity touches zero, and 17 if the velocity just crosses zero and comes back; it is larger if
the segment has only a few samples."""

LINGERS = 6.0
"""Value that replaces `STANDS` for a joint that stands still elsewhere in the recording: twice the ratio at constant
acceleration."""

RESTING = 0.5
"""Smallest share of a slow segment in which all joints must be slow, so that the whole arm counts as resting in this
segment."""

LONG = 1.0
"""Length from which a slow segment is a long rest [s]; in a long rest, joints that creep also count as resting. In
shorter segments they do not, because sticking joints come to rest one after another within 0.25 s if a motion starts
again."""

MOMENT = 0.02
"""Ratio of the speed to the RMS speed of each joint below which all joints count as resting for a moment between
motions."""

SLIDING = 0.1
"""Ratio of the speed to the RMS speed of a joint above which the joint certainly slides before or after such a
moment."""

PASSES, HURRIES = 5.0, 3.5
"""Factor between two speed limits, and largest ratio of the durations below the larger and the smaller limit at which
a joint counts as coming to rest. If a velocity only passes through zero, the ratio of the durations is equal to the
factor; if the joint comes to rest, even for an instant, it is at most the square root of the factor. The threshold
lies between these two values."""

HELD = 0.5
"""Shortest rest of a joint that is left out if only rows in motion are used [s]. At the ends of a recording, where a
rest may continue outside, half of this time is sufficient. The speed is computed over half of this time; position
noise of 0.4 mrad (4096 counts per turn) at 250 Hz then gives a speed noise of 0.8 mrad/s."""

AT_REST = 0.03
"""Ratio of the speed to the RMS speed of a joint below which the joint counts as resting in long rests, in which
joints may creep."""

STILL = 1e-3
"""Speed below which a joint always counts as resting in long rests [rad/s or m/s]; it is needed for joints that never
move, because their RMS speed is only noise."""

BESIDE = 0.5
"""Time before and after a moment of rest in which adjacent slow samples are searched [s]."""


def standing(q: Array, rate: float, noise: Array | None = None) -> NDArray[np.bool_]:
    """Mask of samples at which a joint stands still while others move, or all joints rest briefly between motions.

    The arguments are those of `sticks_and_rests`.

    Returns:
        Mask, shape (N, n).
    """
    sticks, rests = sticks_and_rests(q, rate, noise)
    return sticks | rests


def sticks_and_rests(
    q: Array, rate: float, noise: Array | None = None, *, every: bool = False
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Masks of samples at which a joint stands still while others move, and at which all joints rest briefly.

    If `every` is false, the masks are false for joints that never move, and for joints whose noise is too large to
    detect standstill.

    Args:
        q: Positions at a uniform rate, not filtered, shape (N, n) [rad or m].
        rate: Sample rate [Hz].
        noise: Standard deviation of the noise of the positions as logged, shape (n,) [rad or m]; if not given, it is
            estimated from `q`. After interpolation on a uniform grid, rounded positions would seem to have no noise.
        every: True if the second mask also contains all rests of single joints of at least `HELD`, and joints that
            never move.

    Returns:
        Two masks, shape (N, n) each.
    """
    flags, moments = np.zeros(q.shape, dtype=np.bool_), np.zeros(q.shape, dtype=np.bool_)
    noise = position_noise(q, np.arange(len(q)) / rate) if noise is None else noise
    if every:
        moments = _long_rests(q, rate, noise)
    half = max(NARROWEST, round(SPAN * rate / 2))
    if len(q) <= 2 * half:
        return flags, moments
    speed = SpeedTiles(q, half, rate)
    usual = speed.rms()
    limit = np.maximum(_significant(noise, half, rate), SLOW * usual)
    seen = (usual > 0.0) & (limit <= BLIND * usual)
    joints = np.flatnonzero(seen).tolist()
    several = len(joints) > 1
    together = LINGERS * limit, np.maximum(limit, MOMENT * usual)
    slow, (creeps, at_rest) = speed.below(limit, joints, together)
    rests = np.logical_and.reduce([slow[j] for j in joints]) if several else np.zeros(len(q), dtype=np.bool_)
    creeps &= several
    for j in joints:
        segments = _slow_segments(slow[j], max(LEAST, round(SHORTEST * rate)))
        resting = [(creeps if end - begin >= LONG * rate else rests)[begin:end].mean() for begin, end in segments]
        segments = segments[np.array(resting) < RESTING]
        departure = np.array([_departure(speed, j, *ends) for ends in segments.tolist()]) / limit[j]
        if departure.max(initial=0.0) > STANDS:
            for begin, end in segments[departure > LINGERS]:
                flags[max(0, begin - half) : end + half, j] = True
    if several:
        _mark_moments(speed, at_rest, np.where(seen, limit, np.inf), usual, moments)
    return flags, moments


def standstill_findings(
    recording: Recording, share: Array, sticks: Array, rests: Array, *, every: bool = False
) -> list[Finding]:
    """Findings about rows that are left out because of standstill, and about joints that mostly stand still.

    Args:
        recording: The recording.
        share: Share of the rows of each joint that any standstill affects, shape (n,).
        sticks: Share of the rows of each joint that are affected because the joint sticks, shape (n,).
        rests: Share of the rows of each joint that are affected because all joints rest between motions, shape (n,).
        every: True if long rests are left out, too, even if few rows remain.
    """
    spared = (share > MOST_STILL) & (not every)
    findings = [
        Finding(
            "sticking",
            "warning",
            recording.channels[j],
            f"{recording.source}: Standstill of the joint affects {share[j]:.0%} of its rows, including those into "
            "which the filter mixes samples at standstill. These rows are used, because too few other rows are "
            "left, but static friction can bias the estimate by up to its bound.",
            "record motion without rests, or with faster reversals of this joint.",
        )
        for j in np.flatnonzero(spared)
    ]
    if (gone := _shares(recording, np.where(spared, 0.0, sticks))) != "":
        evidence = (
            "Joints stand still while others move, for instance because they stick at a reversal. Share of rows that "
            f"are not used, at standstill or because the filter mixes samples at standstill into them: {gone}."
        )
        findings.append(Finding("sticking", "info", recording.source, evidence))
    if (gone := _shares(recording, np.where(spared, 0.0, rests))) != "":
        when = "Joints rest, so static friction can have any value up to its bound"
        if not every:
            when = (
                f"All joints rest for less than {LONG:g} s between motions, for instance before a motion is repeated"
            )
        evidence = f"{when}; share of rows that are not used: {gone}."
        findings.append(Finding("rests-left-out", "info", recording.source, evidence))
    return findings


def _shares(recording: Recording, share: Array) -> str:
    """Text that lists the channels with a share above zero, and their shares in percent."""
    return ", ".join(f"{recording.channels[j]} {share[j]:.0%}" for j in np.flatnonzero(share > 0.0))


def _significant(noise: Array, half: int, rate: float) -> Array:
    """Smallest significant speed in the presence of noise, shape (n,), for means of `half` samples on each side."""
    return SURE * noise * np.sqrt(2.0 / half) / (half + 1) * rate


def _long_rests(q: Array, rate: float, noise: Array) -> NDArray[np.bool_]:
    """Mask of samples at which a joint rests for at least the time `HELD`, shape (N, n)."""
    flags = np.zeros(q.shape, dtype=np.bool_)
    half = min(max(NARROWEST, round(HELD * rate / 4)), (len(q) - 1) // 2 - 1)
    if half < 1:
        return flags
    speed = SpeedTiles(q, half, rate, held=half)
    limit = np.maximum(np.maximum(_significant(noise, half, rate), AT_REST * speed.rms()), STILL)
    slow, _ = speed.below(limit)
    for j, slow_j in enumerate(slow):
        for begin, end in _segments(slow_j).tolist():
            # A speed over a span already contains motion that is half a span away from the rest.
            first, last = (begin - half if begin else 0), (end + half if end < len(q) else len(q))
            beyond = (0 if begin else half) + (0 if end < len(q) else half)
            if last - first + 2 * beyond >= HELD * rate:
                flags[first:last, j] = True
    return flags


def _mark_moments(
    speed: SpeedTiles, resting: NDArray[np.bool_], limit: Array, usual: Array, flags: NDArray[np.bool_]
) -> None:
    """Marks brief rests of all joints between motions, with the adjacent slow samples of each joint.

    Args:
        speed: Speeds of n joints at N samples.
        resting: Mask of the samples at which all joints rest, shape (N,).
        limit: Speed below which a joint is slow, shape (n,); infinite for joints that are not considered.
        usual: RMS speed of each joint, shape (n,).
        flags: Mask in which the samples are marked, shape (N, n).
    """
    rate, reach = speed.rate, round(BESIDE * speed.rate)
    joints = np.flatnonzero(np.isfinite(limit))
    slow = limit[joints] / usual[joints]
    at_rest = np.maximum(slow, MOMENT)
    for begin, end in _segments(resting).tolist():
        if begin == 0 or end == len(flags) or end - begin >= LONG * rate:
            continue
        first, stop = max(0, begin - reach), min(len(flags), end + reach)
        near = speed.between(first, stop)[joints] / usual[joints, None]
        ends = [_around(each, begin - first, end - first) for each in near]
        lengths = [[b - a for a, b in (of(v), of(PASSES * v))] for of, v in zip(ends, at_rest, strict=True)]
        if all(wide <= HURRIES * narrow for narrow, wide in lengths):
            for j, of, least in zip(joints, ends, slow, strict=True):
                a, b = of(max(SLIDING, float(least)))
                flags[first + a : first + b, j] = True


def _around(speed: Array, begin: int, end: int) -> Callable[[float], tuple[int, int]]:
    """Function that returns the segment around `begin` to `end` in which speeds (N,) are below a speed limit.

    The segment is given by its first sample and its end.
    """

    def below(limit: float) -> tuple[int, int]:
        before, after = np.flatnonzero(speed[:begin] >= limit), np.flatnonzero(speed[end:] >= limit)
        return int(before[-1]) + 1 if len(before) else 0, end + int(after[0]) if len(after) else len(speed)

    return below


def _segments(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """First sample and end (K, 2) of the segments of true flags (N,)."""
    return np.flatnonzero(np.diff(mask, prepend=False, append=False)).reshape(-1, 2)


def _slow_segments(slow: NDArray[np.bool_], shortest: int) -> NDArray[np.intp]:
    """First sample and end (K, 2) of segments of slow samples (N,) that have at least `shortest` samples."""
    ends = _segments(slow)
    return ends[ends[:, 1] - ends[:, 0] >= shortest]


def _departure(speed: SpeedTiles, joint: int, begin: int, end: int) -> float:
    """Largest speed of a joint around a segment: before and after it, within the length of the segment."""
    length = end - begin
    around = ((max(0, begin - length), begin), (end, min(len(speed.q), end + length)))
    return max((float(speed.between(a, b)[joint].max()) for a, b in around if a < b), default=0.0)
