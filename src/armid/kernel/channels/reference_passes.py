"""NumPy twin of the passes over channels: filters by Fourier transform, sums and differences as they are defined."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.maths.signals import zero_phase_filters
from armid.maths.signals.derivatives import central_difference


def zero_phase(
    filter: Array, x: Array, rate: float, orders: int, pad: int, least: tuple[float, float]
) -> tuple[Array, ...]:
    """Filtered signals and `orders` derivatives, shape (N, n) each; both ends are continued by `pad` samples.

    Values and first derivatives that are smaller than `least` become zero.
    """
    value = zero_phase_filters.zero_phase(filter, x, pad=pad)
    results = [value, *(central_difference(value, rate, order) for order in range(1, orders + 1))]
    for each, smallest in zip(results, least, strict=False):
        each[np.abs(each) < smallest] = 0.0
    return tuple(results)


def filter_columns(filter: Array, x: Array, first: int, step: int, pad: int) -> Array:
    """Filtered columns at every `step`-th sample from `first` on, (K, rows); ends are continued by `pad` samples."""
    return zero_phase_filters.zero_phase(filter, x, axis=1, pad=pad, first=first, step=step)


def speeds(q: Array, half: int, rate: float, begin: int, end: int) -> Array:
    """Absolute speeds, shape (n, end - begin), from the means of `half` samples before and after each sample."""
    centred = q - q.mean(axis=0)
    whole = np.concatenate(
        [2 * centred[0] - centred[half:0:-1], centred, 2 * centred[-1] - centred[-2 : -half - 2 : -1]]
    )
    sums = np.concatenate([np.zeros((1, q.shape[1])), whole.cumsum(axis=0)])
    means = (sums[half:] - sums[:-half]) / half
    every = np.abs(means[half + 1 :] - means[: -half - 1]) * rate / (half + 1)
    return np.ascontiguousarray(every[begin:end].T)


def third_differences(q: Array, time: Array, begin: int, end: int) -> tuple[Array, Array]:
    """Absolute third divided differences, shape (n, end - begin), and the smallest steps above zero, shape (n,)."""
    q, time = q[begin : end + 3], time[begin : end + 3]
    steps = np.abs(np.diff(q, axis=0))
    smallest = np.where(steps > 0.0, steps, np.inf).min(axis=0, initial=np.inf)
    # What no parabola through the times explains.
    times, values = ([x[k : len(x) - 3 + k] for k in range(4)] for x in (time, q))
    weight = np.array([1.0 / np.prod([t - s for s in times if s is not t], axis=0) for t in times])
    weight /= np.linalg.norm(weight, axis=0)
    third = sum((w[:, None] * x for w, x in zip(weight, values, strict=True)), start=np.zeros(()))
    return np.ascontiguousarray(np.abs(third).T), smallest


def decimate(x: Array, taps: Array, step: int, first: int, rows: int) -> Array:
    """Weighted sums of `len(taps)` samples from `first` on, one every `step` samples, shape (rows, n)."""
    windows = np.lib.stride_tricks.sliding_window_view(x[first:], len(taps), axis=0)[::step][:rows]
    return np.ascontiguousarray(windows @ taps)


def heights(padded: Array, length: int) -> tuple[Array, Array]:
    """Heights of runs of `length` samples and differences of the medians beside them, as in `passes.heights`."""
    a, b, c = padded[:-2], padded[1:-1], padded[2:]
    middle = np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))
    runs = len(padded) - length - 5
    before, behind = middle[:runs], middle[length + 3 : length + 3 + runs]
    windows = np.lib.stride_tricks.sliding_window_view(padded[3 : 2 + length + runs], length)
    low, high = windows.min(axis=1), windows.max(axis=1)
    height = np.maximum(np.maximum(low - np.maximum(before, behind), np.minimum(before, behind) - high), 0.0)
    last, following = padded[2 : 2 + runs], padded[length + 3 : length + 3 + runs]
    alone = np.maximum(np.abs(last - before), np.abs(following - behind)) <= height / 2
    return np.where(alone, height, 0.0), np.abs(before - behind)
