"""Cubic splines through samples at uneven times.

The splines of SciPy are not used, because their import takes half a second.
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array

LEAST = 4
"""Smallest number of samples for a cubic spline; fewer samples are interpolated by a parabola or a line."""


def spline_slopes(time: Array, x: Array) -> Array:
    """First derivative of the cubic spline through samples, at these samples, in the shape of `x` [unit of `x` / s].

    The spline is twice continuously differentiable. Its third derivative is continuous at the second and at the
    second to last sample ("not a knot" condition [DeBoor1978]). Three samples give a parabola, two samples a line.

    Args:
        time: Sample times, increasing, shape (N,), N ≥ 2 [s].
        x: Signals, shape (N, ...).
    """
    h, samples = np.diff(time), len(time)
    chord = np.diff(x.reshape(samples, -1), axis=0) / h[:, None]
    if samples < LEAST:
        return _short(h, chord).reshape(x.shape)
    # Bands of the tridiagonal system: above, on and below the diagonal.
    above, diagonal, below = np.empty(samples - 1), np.empty(samples), np.empty(samples - 1)
    right = np.empty_like(chord, shape=(samples, chord.shape[1]))
    above[1:], below[:-1] = h[:-1], h[1:]
    diagonal[1:-1] = 2.0 * (h[:-1] + h[1:])
    right[1:-1] = 3.0 * (h[1:, None] * chord[:-1] + h[:-1, None] * chord[1:])
    for row, end, near, far in ((0, 0, 0, 1), (-1, -1, -1, -2)):
        both = h[near] + h[far]
        diagonal[row] = h[far]
        (above if row == 0 else below)[end] = both
        right[row] = ((h[near] + 2.0 * both) * h[far] * chord[near] + h[near] ** 2 * chord[far]) / both
    # With the first and last row eliminated, the matrix is diagonally dominant.
    first, last = below[0] / diagonal[0], above[-1] / diagonal[-1]
    diagonal[1] -= first * above[0]
    right[1] -= first * right[0]
    diagonal[-2] -= last * below[-1]
    right[-2] -= last * right[-1]
    slopes = np.empty_like(right)
    inside = slice(1, -1)
    slopes[inside] = _tridiagonal(
        np.append(0.0, below[1:-1]), diagonal[inside], np.append(above[1:-1], 0.0), right[inside]
    )
    slopes[0] = (right[0] - above[0] * slopes[1]) / diagonal[0]
    slopes[-1] = (right[-1] - below[-1] * slopes[-2]) / diagonal[-1]
    return slopes.reshape(x.shape)


def _tridiagonal(below: Array, diagonal: Array, above: Array, right: Array) -> Array:
    """Solution of a diagonally dominant tridiagonal system by cyclic reduction [Hockney1965].

    Every second row is eliminated, and this is repeated until one row remains.

    Args:
        below: Entries left of the diagonal, zero in the first row, shape (N,).
        diagonal: Diagonal, shape (N,).
        above: Entries right of the diagonal, zero in the last row, shape (N,).
        right: Right-hand sides, shape (N, k).
    """
    count = len(diagonal)
    if count == 1:
        return right / diagonal[:, None]
    if count % 2 == 0:  # every remaining row needs an eliminated row on each side
        below, diagonal, above = np.append(below, 0.0), np.append(diagonal, 1.0), np.append(above, 0.0)
        right = np.concatenate([right, np.zeros((1, right.shape[1]))])
    first, second, stays, goes = slice(0, -1, 2), slice(2, None, 2), slice(1, None, 2), slice(0, None, 2)
    before, after = below[stays] / diagonal[first], above[stays] / diagonal[second]
    result = np.empty_like(right)
    result[stays] = _tridiagonal(
        -before * below[first],
        diagonal[stays] - before * above[first] - after * below[second],
        -after * above[second],
        right[stays] - before[:, None] * right[first] - after[:, None] * right[second],
    )
    rest = right[goes].copy()
    rest[1:] -= below[second, None] * result[stays]
    rest[:-1] -= above[first, None] * result[stays]
    result[goes] = rest / diagonal[goes, None]
    return result[:count]


def spline(time: Array, x: Array, at: Array) -> Array:
    """Values, at given times, of the cubic spline through samples.

    Args:
        time: Sample times, increasing, shape (N,), N ≥ 2 [s].
        x: Signals, shape (N, ...).
        at: Times of the values, shape (M,) [s]. Outside the sample times, the first or the last cubic is
            extrapolated.

    Returns:
        Values, shape (M, ...).
    """
    slopes = spline_slopes(time, x)
    k = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    shape = (-1,) + (1,) * (x.ndim - 1)
    h = np.diff(time)[k].reshape(shape)
    s = (at - time[k]).reshape(shape) / h
    begin, end = np.take(x, k, axis=0), np.take(x, k + 1, axis=0)
    first, last = h * np.take(slopes, k, axis=0), h * np.take(slopes, k + 1, axis=0)
    rise = end - begin
    return begin + s * (first + s * (3.0 * rise - 2.0 * first - last + s * (first + last - 2.0 * rise)))


def _short(h: Array, chord: Array) -> Array:
    """Slopes at the samples of the line through two samples, or of the parabola through three samples."""
    if len(h) == 1:
        return np.repeat(chord, 2, axis=0)
    bend = (chord[1] - chord[0]) / (h[0] + h[1])
    return np.stack([chord[0] - h[0] * bend, chord[0] + h[0] * bend, chord[1] + h[1] * bend])
