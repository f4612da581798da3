"""Isolated samples: up to three successive samples of a signal that lie far from the samples on both sides.

Such a group of successive samples is called a run here. The height of a run is the distance of its samples from the
interval between two medians: the median of the three samples before the run, and that of the three samples after it.
At a step, or in a steady motion, this height is zero, because the samples lie between the two medians. For a run that
is only a part of a longer group of outliers it is set to zero, because the samples directly beside the run are then
far from the medians.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.kernel.channels.passes import heights as run_heights

SIDE = 3
"""Number of samples on each side of a run from which a median is computed; one of them may be an outlier itself."""

FEWEST = 30
"""Smallest number of samples that a signal must have for the search for isolated samples."""

WINDOW = 20
"""Number of differences between successive samples on each side of a run from which the local noise is estimated."""

LOCAL = 30.0
"""Smallest height of an isolated run, divided by the median difference between successive samples near it: about 30
standard deviations of white noise."""

USUAL, QUANTILE = 15.0, 0.99
"""Smallest height of a brief isolated run, divided by a quantile of the heights of single samples of the same
channel, and the probability of this quantile. This condition is needed because jerks, impacts and sticking cause
short peaks, too. Samples at which the channel does not change are not counted, since otherwise the quantile would be
zero for an arm that rests most of the time. If motion is so smooth that the quantile is zero nevertheless, a quantile
of the second differences is used instead."""

OUTLYING, BULK = 10.0, 0.025
"""Largest height that counts for the quantile of heights, divided by a range of the channel; and the share of the
smallest and of the largest samples that this range leaves out. If one sample in a hundred is far off, the quantile
would otherwise be the height of the outliers themselves."""

BENT_QUANTILE = 1.0 - 3.0 * (1.0 - QUANTILE)
"""Probability of the quantile of the second differences that replaces the quantile of the heights if that is zero; an
isolated sample changes three second differences."""

BRIEF = 2.5e-3
"""Duration of a run above which the required height increases in proportion to the duration [s]. If an arm stops
abruptly, the torque has a peak of 10 ms: one sample at 100 Hz. In a recording of a UR10e, the height of such a peak
is 20 times the quantile; this rule requires 60 times."""

COUNTED = 50_000
"""Number of samples of a long signal, evenly spread, from which quantiles are computed."""

LOST, USUAL_LOST, LOCAL_LOST = 1e-12, 5.0, 10.0
"""Largest absolute value, relative to that of the channel, of a sample that counts as zero; and smallest height of an
isolated run of zeros, divided by the same quantile, for any duration, and by the local median. Such a run is a lost
sample and not a peak of the motion, which would not end at zero."""

RETURNS = 3.0
"""Smallest height of an isolated run, divided by the difference between the medians on its two sides. When an arm
stops, its velocity overshoots by 1 to 2 times this difference."""

LONGEST = 3
"""Largest number of samples of an isolated run."""

ROUGH = 10.0
"""Ratio of the largest to the mean absolute second difference of a channel up to which none of its samples counts as
isolated; for white noise the ratio is 6."""


def heights(x: Array, length: int, *, ends: bool = False) -> tuple[Array, Array]:
    """Heights of all runs of `length` successive samples, and for each run the difference of two medians.

    The medians are those of the three samples before the run and of the three samples after it. The height of a run
    is the distance of its samples from the interval between the two medians.

    Args:
        x: Samples, shape (N,).
        length: Number of samples of a run.
        ends: If true, runs at the ends of the signal have a height, too: the samples that are missing beyond an end
            are replaced by the median of the seven samples next to it. A step near an end then also counts as a run.
            If false, the first or the last sample is repeated.

    Returns:
        Heights and differences of the runs that begin at each sample, shape (N - length + 1,) each.
    """
    parts = (x[: 2 * SIDE + 1], x[-2 * SIDE - 1 :]) if ends else (x[:1], x[-1:])
    first, end = (np.full(SIDE, np.sort(part)[len(part) // 2]) for part in parts)
    padded = np.concatenate([first, x, end])
    return run_heights(padded, length)


def marked(starts: NDArray[np.bool_], length: int, into: NDArray[np.bool_]) -> None:
    """Marks the samples of runs in the mask `into`.

    Args:
        starts: Mask of the samples at which the runs begin, shape (N - length + 1,).
        length: Number of samples of a run.
        into: Mask of samples, shape (N,); the samples of the runs are set to true in place.
    """
    for k in range(length):
        into[k : k + len(starts)] |= starts


def smallest_step(steps: Array) -> float:
    """Smallest nonzero difference of successive samples, an estimate of the resolution of a channel.

    `steps` are the absolute differences; if all are zero, the result is 0.
    """
    changes = steps[steps > 0.0]
    return float(changes.min()) if len(changes) else 0.0


def isolated_samples(x: Array, seconds: float) -> NDArray[np.bool_]:
    """Finds the isolated samples of each channel from their heights alone.

    Args:
        x: Samples, shape (N, n).
        seconds: Time from sample to sample [s].

    Returns:
        Mask of the isolated samples, shape (N, n).
    """
    found = np.zeros(x.shape, dtype=np.bool_)
    if len(x) < FEWEST:
        return found
    for j in range(x.shape[1]):  # one channel after the other: sums along rows of a few numbers are slow
        channel = np.ascontiguousarray(x[:, j])
        bent = np.abs(channel[2:] - 2.0 * channel[1:-1] + channel[:-2])
        if bent.max() > ROUGH * bent.mean():
            _mark_isolated(channel, seconds, found[:, j])
    return found


def _mark_isolated(x: Array, seconds: float, found: NDArray[np.bool_]) -> None:
    """Marks the isolated samples of one channel (N,) that is not constant, in the mask `found` (N,).

    No sample is marked if the usual height of single samples is not known. `seconds` is the time between samples [s].
    """
    steps = np.abs(np.diff(x))
    resolution = smallest_step(steps)
    usual = _usual_height(x, steps > 0.0)
    if usual == 0.0:
        return
    zero = np.abs(x) <= LOST * np.abs(x).max()
    has_zeros = bool(zero.any())
    for length in range(1, LONGEST + 1):
        height, difference = heights(x, length)
        required = USUAL * max(1.0, length * seconds / BRIEF)
        candidates = np.flatnonzero(height > (min(USUAL_LOST, required) if has_zeros else required) * usual)
        lost = np.logical_and.reduce([zero[candidates + k] for k in range(length)])
        least = np.where(lost, USUAL_LOST, required) * usual
        far = height[candidates] > np.maximum(least, RETURNS * difference[candidates])
        candidates, lost = candidates[far], lost[far]
        away = np.concatenate([np.arange(-WINDOW, 1 - SIDE), np.arange(SIDE - 1, WINDOW) + length])
        rows = np.abs(candidates[:, None] + away)  # mirrored at the ends
        near = np.sort(steps[len(steps) - 1 - np.abs(len(steps) - 1 - rows)], axis=1)
        local = np.maximum(near[:, len(away) // 2], resolution / 2)
        starts = np.zeros(len(height), dtype=np.bool_)
        least_local = np.where(lost, LOCAL_LOST, LOCAL) * local
        starts[candidates[height[candidates] > least_local]] = True
        marked(starts, length, found)


def _usual_height(x: Array, changes: NDArray[np.bool_]) -> float:
    """Quantile of the heights of single samples of a channel that differ from a neighbour; 0 if it is not known.

    Args:
        x: Samples, shape (N,).
        changes: True for the steps that are not zero, shape (N - 1,); at least one.
    """
    beside = np.concatenate([changes[:1], changes[1:] | changes[:-1], changes[-1:]])
    every = max(1, len(x) // COUNTED)
    single = heights(x, 1)[0][beside][::every]
    low, high = np.quantile(x[::every], (BULK, 1.0 - BULK))
    if high > low:
        single = single[single <= OUTLYING * (high - low)]
    usual = float(np.quantile(single, QUANTILE)) if len(single) else 0.0
    if usual == 0.0:
        bent = np.abs(np.diff(x, 2))[beside[1:-1]]
        usual = float(np.quantile(bent, BENT_QUANTILE)) if len(bent) else 0.0
    return usual
