"""Stretches in which a joint stands still between motion, where dry friction takes any value up to its bound.

A joint that turns round passes through rest in a moment: with acceleration a it is slower than v for 2 v / a. A joint
that sticks stays there, and is fast soon after. So a stretch of slow samples is standstill where a stretch as long
before or behind it holds a speed that no smooth passage leads to. A joint that is seen to stand in one place may do
so wherever its velocity lingers about zero: passages that acceleration does not hurry through then count as well.

Where all joints stand at once, the arm rests. It does so before and after a motion and between poses, not by
sticking; what it was moved by says on which side friction holds it, and its weight is to be seen. Such stretches are
no standstill, unless a single joint moves at all. In long ones a joint may creep meanwhile.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.values import Array

__all__ = ["position_noise", "standing"]

SPAN = 0.024
"""Time over which a speed is measured [s]: an encoder's noise of 1e-5 rad at 1 kHz is 3e-4 rad/s then, and what a
joint that sticks for a twentieth of a second does is seen between its edges."""

NARROWEST = 2
"""Samples on each side of one whose speed is measured, at least, at low rates."""

SURE = 4.0
"""Standard deviations of a measured speed below which it is none."""

SLOW = 0.005
"""Share of a joint's own RMS speed below which it is slow, where noise does not decide that: at 1 rad/s² it passes
this in some milliseconds."""

BLIND = 0.1
"""The same share from which on noise hides standstill altogether."""

SHORTEST = 0.04
"""Shortest standstill that counts [s]; what is shorter moves an estimate by less than its deviation."""

LEAST = 3
"""Samples of it at low rates."""

STANDS = 25.0
"""Speed, in limits of slowness, that is reached within the length of a slow stretch before or after it, from which on
the joint stood: at constant acceleration that is 3, where the velocity touches zero 9, and where it just crosses it
and comes back 17, or some more when the stretch is a few samples."""

LINGERS = 6.0
"""The same from which on a joint that stands elsewhere may have stood, too: twice what constant acceleration does."""

RESTING = 0.5
"""Share of a slow stretch in which all joints are slow, from which on it is the arm that rests."""

LONG = 1.0
"""Seconds of a slow stretch from which on joints that but linger rest, too. In shorter ones they do not: where a
motion begins anew, joints that stick come to rest one after another, within a quarter of a second."""


def standing(q: Array, rate: float, noise: Array | None = None) -> NDArray[np.bool_]:
    """Samples at which a joint stands still among others that move, though it moves before or after.

    A joint that never moves has none, nor one whose noise hides whether it does.

    Args:
        q: Positions at an even rate, not filtered, shape (N, n) [rad or m].
        rate: Samples a second [Hz].
        noise: Of the positions as they were logged, shape (n,) [rad or m]; that of `q` where none is given. Moved
            to an even grid, positions that were rounded seem to have none.

    Returns:
        Flags (N, n).
    """
    flags = np.zeros(q.shape, dtype=np.bool_)
    half = max(NARROWEST, round(SPAN * rate / 2))
    if len(q) <= 2 * half:
        return flags
    speed = _speed(q, half, rate)
    usual = np.sqrt(np.mean(speed**2, axis=0))
    noise = position_noise(q, np.arange(len(q)) / rate) if noise is None else noise
    limit = np.maximum(SURE * noise * np.sqrt(2.0 / half) / (half + 1) * rate, SLOW * usual)
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
    return flags


def position_noise(q: Array, time: Array) -> Array:
    """Standard deviation of each position's noise, or what rounding makes of it.

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
    return np.maximum(1.4826 * np.median(np.abs(third), axis=0), rounding)


def _slow_stretches(speed: Array, shortest: int) -> tuple[NDArray[np.intp], Array]:
    """Stretches of speeds (N,) below 1, first sample and the one after the last, (K, 2), and the speed near each."""
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
    """Size of the velocity between the means of so many samples before and after each, shape (N, n)."""
    centred = q - q.mean(axis=0)
    whole = np.concatenate(
        [2 * centred[0] - centred[half:0:-1], centred, 2 * centred[-1] - centred[-2 : -half - 2 : -1]]
    )
    sums = np.concatenate([np.zeros((1, q.shape[1])), whole.cumsum(axis=0)])
    means = (sums[half:] - sums[:-half]) / half
    return np.abs(means[half + 1 :] - means[: -half - 1]) * rate / (half + 1)
