"""Noise of positions, from their third differences; the exact median without an array of all differences."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.kernel.channels.passes import third_differences
from armid.maths.median import median

TILE = 16384
"""Number of samples whose differences are in memory at a time: 1 MB for a seven-joint arm."""

SAMPLED, PIECE = 512, 64
"""Number of pieces, spread evenly over a recording, and their length [samples], from which the interval is estimated
that contains the median."""

AROUND = (0.42, 0.58)
"""Quantiles of the sampled differences between which the median of all is searched. If it lies outside, which
recordings with noise in few places can cause, all differences are sorted."""

NORMAL = 1.4826
"""Ratio of the standard deviation to the median of the absolute values of a normal distribution."""


def position_noise(q: Array, time: Array) -> Array:
    """Standard deviation of the noise of the positions of each joint, including rounding.

    Args:
        q: Positions as they were logged, shape (N, n) [rad or m].
        time: Times of the positions, which need not be uniform, shape (N,) [s].

    Returns:
        Standard deviations, shape (n,) [rad or m]; zero if there are too few samples for an estimate.
    """
    if len(q) < 4:
        return _rounding(np.abs(np.diff(q, axis=0)).T)
    count = len(q) - 3
    if count <= 2 * SAMPLED * PIECE:
        size, smallest = third_differences(q, time, 0, count)
        return np.maximum(NORMAL * median(size.T), _rounding(smallest[:, None]))
    low, high = _interval(q, time)
    below = np.zeros(q.shape[1], dtype=np.int64)
    smallest = np.full(q.shape[1], np.inf)
    inside: list[list[Array]] = [[] for _ in low]
    for begin in range(0, count, TILE):
        size, least = third_differences(q, time, begin, min(begin + TILE, count))
        smallest = np.minimum(smallest, least)
        for j, values in enumerate(size):
            first = values < low[j]
            below[j] += np.count_nonzero(first)
            inside[j].append(values[(values <= high[j]) ^ first])  # those below `low` are below `high`, too
    return np.maximum(NORMAL * _median(q, time, below, inside), _rounding(smallest[:, None]))


def _interval(q: Array, time: Array) -> tuple[Array, Array]:
    """Interval that probably contains the median of the third differences of each channel, shape (n,) each."""
    starts = np.linspace(0, len(q) - 3 - PIECE, SAMPLED).astype(np.int64).tolist()
    sampled = np.concatenate([third_differences(q, time, a, a + PIECE)[0] for a in starts], axis=1)
    low, high = (int(share * sampled.shape[1]) for share in AROUND)
    ordered = np.partition(sampled, (low, high), axis=1)
    return ordered[:, low], ordered[:, high]


def _median(q: Array, time: Array, below: np.ndarray, inside: list[list[Array]]) -> Array:
    """Medians of the absolute third differences, shape (n,).

    Args:
        q: Positions, shape (N, n).
        time: Times, shape (N,).
        below: Number of differences below the interval, shape (n,).
        inside: For each channel, the differences inside the interval.
    """
    count = len(q) - 3
    low, high = (count - 1) // 2, count // 2
    result = np.empty(len(below))
    for j, parts in enumerate(inside):
        values = np.concatenate(parts)
        first, last = low - int(below[j]), high - int(below[j])
        if first < 0 or last >= len(values):
            column = np.ascontiguousarray(q[:, j : j + 1])
            values, first, last = third_differences(column, time, 0, count)[0][0], low, high
        ordered = np.partition(values, (first, last))
        result[j] = (ordered[first] + ordered[last]) / 2.0
    return result


def _rounding(steps: Array) -> Array:
    """Standard deviation of the rounding of positions, from their steps (n, k); zero if no step is above zero."""
    smallest = np.where(steps > 0.0, steps, np.inf).min(axis=1, initial=np.inf)
    return np.where(np.isfinite(smallest), smallest, 0.0) / np.sqrt(12.0)
