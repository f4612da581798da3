"""Detection of standstill of joints between motion, where dry friction takes any value up to its bound.

A joint that turns round passes through rest in a moment: with acceleration a it is slower than v for 2 v / a. A joint
that sticks stays there, and is fast soon after. So a stretch of slow samples is standstill where a stretch as long
before or behind it holds a speed that no smooth passage leads to. A joint that is seen to stand in one place may do
so wherever its velocity lingers about zero: passages that acceleration does not hurry through then count as well.

Where all joints stand at once, the arm rests. For a second and more it does so before and after a motion and between
poses, not by sticking; what it was moved by says on which side friction holds it, and its weight is to be seen. Such
stretches are no standstill, unless a single joint moves at all. In long ones a joint may creep meanwhile.

For less than a second it rests where one motion ends and the next begins, as a designed motion does that is run
through again. Friction goes through all of its range there within a few samples, for every joint; what that adds to
an estimate is bias by friction at rest, and no weight that the motion on both sides does not show. Such moments are
standstill of all joints, with what lies next to them while a joint is too slow to be sure to slide.

Where friction is tracked, long rests count as standstill, too: an estimate that forgets would soon consist of them.
They are found joint by joint from speeds over a quarter of a second, which noise does not hide.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from armid.errors import Finding
from armid.maths.median import median
from armid.measurement.processing.row_mask import MOST_STILL
from armid.measurement.recording import Recording
from armid.values import Array

SPAN = 0.024
"""Time over which a speed is measured [s]: an encoder's noise of 1e-5 rad at 1 kHz is 3e-4 rad/s then, and what a
joint that sticks for a twentieth of a second does is seen between its edges."""

NARROWEST = 2
"""Smallest number of samples on each side of one whose speed is measured, at low rates."""

SURE = 4.0
"""Number of standard deviations of a measured speed below which it is not significant."""

SLOW = 0.005
"""Share of a joint's RMS speed below which it is slow, where noise allows: at 1 rad/s² a joint passes through this
range in some milliseconds."""

BLIND = 0.1
"""Noise relative to a joint's RMS speed from which it hides standstill altogether."""

SHORTEST = 0.04
"""Shortest standstill that is detected [s]; a shorter one moves an estimate by less than its standard deviation."""

LEAST = 3
"""Smallest number of samples of a standstill, at low rates."""

STANDS = 25.0
"""Speed, in limits of slowness, that is reached within the length of a slow stretch before or after it, from which on
the joint stood: at constant acceleration that is 3, where the velocity touches zero 9, and where it just crosses it
and comes back 17, or some more when the stretch is a few samples."""

LINGERS = 6.0
"""The same ratio for a joint that stands elsewhere in the recording: twice that of constant acceleration."""

RESTING = 0.5
"""Share of a slow stretch in which all joints are slow from which the whole arm rests."""

LONG = 1.0
"""Seconds of a slow stretch from which on the arm rests for long, and joints that but linger rest, too. In shorter
ones they do not: where a motion begins anew, joints that stick come to rest one after another within 0.25 s."""

MOMENT = 0.02
"""Share of their RMS speeds below which all joints together are at rest for a moment between motions."""

SLIDING = 0.1
"""Share of its RMS speed from which a joint before or after such a moment certainly slides."""

PASSES, HURRIES = 5.0, 3.5
"""A joint that just passes through zero is slower than so many times a speed for as many times as long; one that
comes to rest, if only for an instant, for at most the root of that as long. What lies between tells them apart."""

HELD = 0.5
"""Shortest rest of a joint within a motion that is left out where only rows in motion count [s]; half of it at the
ends of a recording, beyond which it goes on. The speed is measured over half of it: noise of 0.4 mrad at 250 Hz, as
of 4096 counts a turn, is 0.8 mrad/s there."""

AT_REST = 0.03
"""Share of a joint's RMS speed below which it rests for so long: what a joint that creeps may reach in long rests."""

STILL = 1e-3
"""Speed below which a joint rests in any case [rad/s or m/s]: in a recording of rest alone the share says nothing."""

BESIDE = 0.5
"""Time on each side of a moment of rest in which a joint may be slower [s]."""


def standing(q: Array, rate: float, noise: Array | None = None) -> NDArray[np.bool_]:
    """Mask of samples at which a joint stands still while others move, or all for a moment between motions.

    The arguments are those of `sticks_and_rests`.

    Returns:
        Flags (N, n).
    """
    sticks, rests = sticks_and_rests(q, rate, noise)
    return sticks | rests


def sticks_and_rests(
    q: Array, rate: float, noise: Array | None = None, *, every: bool = False
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Masks of samples at which a joint stands still while others move, and at which all rest between motions.

    A joint that never moves has none, nor one whose noise hides whether it does.

    Args:
        q: Positions at an even rate, not filtered, shape (N, n) [rad or m].
        rate: Samples a second [Hz].
        noise: Of the positions as they were logged, shape (n,) [rad or m]; that of `q` where none is given. Moved
            to an even grid, positions that were rounded seem to have none.
        every: The second mask holds every joint's rests of `HELD` and more as well, and joints that never move.

    Returns:
        Flags (N, n) of each.
    """
    flags, moments = np.zeros(q.shape, dtype=np.bool_), np.zeros(q.shape, dtype=np.bool_)
    noise = position_noise(q, np.arange(len(q)) / rate) if noise is None else noise
    if every:
        moments = _long_rests(q, rate, noise)
    half = max(NARROWEST, round(SPAN * rate / 2))
    if len(q) <= 2 * half:
        return flags, moments
    speed = _speed(q, half, rate)
    usual = np.sqrt(np.mean(speed**2, axis=0))
    limit = np.maximum(_significant(noise, half, rate), SLOW * usual)
    seen = (usual > 0.0) & (limit <= BLIND * usual)
    several = seen.sum() > 1
    rests, creeps = ((speed[:, seen] < share * limit[seen]).all(axis=1) & several for share in (1.0, LINGERS))
    for j in np.flatnonzero(seen):
        ends, departure = _slow_stretches(speed[:, j] / limit[j], max(LEAST, round(SHORTEST * rate)))
        resting = [(creeps if end - begin >= LONG * rate else rests)[begin:end].mean() for begin, end in ends]
        alone = np.array(resting) < RESTING
        ends, departure = ends[alone], departure[alone]
        if departure.max(initial=0.0) > STANDS:
            for begin, end in ends[departure > LINGERS]:
                flags[max(0, begin - half) : end + half, j] = True
    if several:
        moments[:, seen] |= _moments(speed[:, seen] / usual[seen], limit[seen] / usual[seen], rate)
    return flags, moments


def standstill_findings(
    recording: Recording, share: Array, sticks: Array, rests: Array, *, every: bool = False
) -> list[Finding]:
    """Findings about rows left out because of standstill, and about joints that mostly stand still.

    Args:
        recording: The recording.
        share: Share of each joint's rows that standstill reaches, shape (n,).
        sticks: Share that is reached by its sticking alone, shape (n,).
        rests: Share that is reached by rests of all joints between motions, shape (n,).
        every: Whether long rests are left out, too, however few rows remain.
    """
    spared = (share > MOST_STILL) & (not every)
    findings = [
        Finding(
            "sticking",
            "warning",
            recording.channels[j],
            f"{recording.source}: The joint mostly stands still, which reaches {share[j]:.0%} of its rows. They "
            "count, as too few others are left, and friction at rest biases the estimate by up to its bound.",
            "record motion without rests, or with faster reversals of this joint.",
        )
        for j in np.flatnonzero(spared)
    ]
    if (gone := _shares(recording, np.where(spared, 0.0, sticks))) != "":
        evidence = f"Joints stand while others move, as where they stick at a reversal; rows not counted: {gone}."
        findings.append(Finding("sticking", "info", recording.source, evidence))
    if (gone := _shares(recording, np.where(spared, 0.0, rests))) != "":
        when = "Joints rest, where dry friction may have any value up to its bound"
        if not every:
            when = f"All joints rest for less than {LONG:g} s between motions, as where a repeated motion begins anew"
        evidence = f"{when}; rows not counted: {gone}."
        findings.append(Finding("rests-left-out", "info", recording.source, evidence))
    return findings


def _shares(recording: Recording, share: Array) -> str:
    """Channels with a share above zero, as text."""
    return ", ".join(f"{recording.channels[j]} {share[j]:.0%}" for j in np.flatnonzero(share > 0.0))


def position_noise(q: Array, time: Array) -> Array:
    """Standard deviation of the noise of each position, including rounding.

    Args:
        q: Positions as they were logged, shape (N, n) [rad or m].
        time: Their times, which need not be even, shape (N,) [s].

    Returns:
        Shape (n,) [rad or m]; zero where there are too few samples to tell.
    """
    steps = np.abs(np.diff(q, axis=0))
    smallest = np.where(steps > 0.0, steps, np.inf).min(axis=0, initial=np.inf)
    rounding = np.where(np.isfinite(smallest), smallest, 0.0) / np.sqrt(12.0)
    if len(q) < 4:
        return rounding
    # Third divided differences: what no parabola through the times explains, in units of one sample's noise.
    times, values = ([x[k : len(x) - 3 + k] for k in range(4)] for x in (time, q))
    weight = np.array([1.0 / np.prod([t - s for s in times if s is not t], axis=0) for t in times])
    weight /= np.linalg.norm(weight, axis=0)
    third = sum((w[:, None] * x for w, x in zip(weight, values, strict=True)), start=np.zeros(()))
    return np.maximum(1.4826 * median(np.abs(third)), rounding)


def _significant(noise: Array, half: int, rate: float) -> Array:
    """Smallest speed over `half` samples on each side that is significant, shape (n,)."""
    return SURE * noise * np.sqrt(2.0 / half) / (half + 1) * rate


def _long_rests(q: Array, rate: float, noise: Array) -> NDArray[np.bool_]:
    """Mask of samples within rests of a joint of `HELD` and more, shape (N, n)."""
    flags = np.zeros(q.shape, dtype=np.bool_)
    half = min(max(NARROWEST, round(HELD * rate / 4)), (len(q) - 1) // 2 - 1)
    if half < 1:
        return flags
    speed = _speed(q, half, rate)
    # Nearer to the ends a speed depends on the first or last sample alone, whose noise no mean reduces.
    speed[:half], speed[-half:] = speed[half], speed[-half - 1]
    usual = np.sqrt(np.mean(speed**2, axis=0))
    limit = np.maximum(np.maximum(_significant(noise, half, rate), AT_REST * usual), STILL)
    for j in range(q.shape[1]):
        slow = np.concatenate([[False], speed[:, j] < limit[j], [False]])
        for begin, end in np.flatnonzero(np.diff(slow)).reshape(-1, 2):
            # A speed over a span sees the motion beside a rest from half a span off.
            first, last = (begin - half if begin else 0), (end + half if end < len(q) else len(q))
            beyond = (0 if begin else half) + (0 if end < len(q) else half)
            if last - first + 2 * beyond >= HELD * rate:
                flags[first:last, j] = True
    return flags


def _moments(speed: Array, limit: Array, rate: float) -> NDArray[np.bool_]:
    """Mask of moments at which all joints rest between motions, with the slow samples next to them, shape (N, m).

    Args:
        speed: Over the joints' RMS speeds, shape (N, m).
        limit: Speed below which a joint is slow, in the same units, shape (m,).
        rate: Samples a second [Hz].
    """
    flags = np.zeros(speed.shape, dtype=np.bool_)
    reach, at_rest = round(BESIDE * rate), np.maximum(limit, MOMENT)
    slow = np.concatenate([[False], (speed < at_rest).all(axis=1), [False]])
    for begin, end in np.flatnonzero(np.diff(slow)).reshape(-1, 2):
        if begin == 0 or end == len(speed) or end - begin >= LONG * rate:
            continue
        near = slice(max(0, begin - reach), end + reach)
        ends = [_around(speed[near, j], begin - near.start, end - near.start) for j in range(speed.shape[1])]
        lengths = [
            [last - first for first, last in (of(v), of(PASSES * v))] for of, v in zip(ends, at_rest, strict=True)
        ]
        if all(wide <= HURRIES * narrow for narrow, wide in lengths):
            for j, of in enumerate(ends):
                first, last = of(max(SLIDING, float(limit[j])))
                flags[near.start + first : near.start + last, j] = True
    return flags


def _around(speed: Array, begin: int, end: int) -> Callable[[float], tuple[int, int]]:
    """First sample and end of the surrounding stretch below a limit of speed."""

    def below(limit: float) -> tuple[int, int]:
        before, after = np.flatnonzero(speed[:begin] >= limit), np.flatnonzero(speed[end:] >= limit)
        return int(before[-1]) + 1 if len(before) else 0, end + int(after[0]) if len(after) else len(speed)

    return below


def _slow_stretches(speed: Array, shortest: int) -> tuple[NDArray[np.intp], Array]:
    """Stretches of speeds (N,) below 1, as first sample and end, (K, 2), and the speed near each."""
    slow = np.concatenate([[False], speed < 1.0, [False]])
    ends = np.flatnonzero(np.diff(slow)).reshape(-1, 2)
    ends = ends[ends[:, 1] - ends[:, 0] >= shortest]
    departure = np.zeros(len(ends))
    for k, (begin, end) in enumerate(ends):
        length = end - begin
        around = np.concatenate([speed[max(0, begin - length) : begin], speed[end : end + length]])
        departure[k] = around.max(initial=0.0)
    return ends, departure


def _speed(q: Array, half: int, rate: float) -> Array:
    """Speed from the means of a number of samples before and after each sample, shape (N, n)."""
    centred = q - q.mean(axis=0)
    whole = np.concatenate(
        [2 * centred[0] - centred[half:0:-1], centred, 2 * centred[-1] - centred[-2 : -half - 2 : -1]]
    )
    sums = np.concatenate([np.zeros((1, q.shape[1])), whole.cumsum(axis=0)])
    means = (sums[half:] - sums[:-half]) / half
    return np.abs(means[half + 1 :] - means[: -half - 1]) * rate / (half + 1)
