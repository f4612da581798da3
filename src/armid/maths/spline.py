"""Cubic splines through samples at uneven times: what SciPy's has, without the half second of its import."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from armid.values import Array

__all__ = ["spline", "spline_slopes"]

LEAST = 4
"""Samples below which the two conditions at the ends are one and the same: a parabola or a line goes through them."""


def spline_slopes(time: Array, x: Array) -> Array:
    """First derivative at the samples of the cubic spline through them, shape of `x` [1/s].

    Twice continuously differentiable, the third derivative continuous at the second and the last but one sample, too
    ("not a knot" [DeBoor1978]). Through three samples goes a parabola, through two a line.

    Args:
        time: Increasing, shape (N,), N ≥ 2 [s].
        x: Signals, shape (N, ...).
    """
    h, samples = np.diff(time), len(time)
    chord = np.diff(x.reshape(samples, -1), axis=0) / h[:, None]
    if samples < LEAST:
        return _short(h, chord).reshape(x.shape)
    # Rows of the tridiagonal system, as bands: above, on and below the diagonal.
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
    lapack: Any = import_module("scipy.linalg.lapack")  # a twentieth of a second
    slopes, info = lapack.dgtsv(below, diagonal, above, right)[3:]
    assert info == 0, "the system of a spline is regular for increasing times"
    return np.asarray(slopes, dtype=np.float64).reshape(x.shape)


def spline(time: Array, x: Array, at: Array) -> Array:
    """The cubic spline through samples, read at other times.

    Args:
        time: Increasing, shape (N,), N ≥ 2 [s].
        x: Signals, shape (N, ...).
        at: Times, shape (M,) [s]; beyond the ends the first and last cubic go on.

    Returns:
        Shape (M, ...).
    """
    slopes = spline_slopes(time, x)
    k = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    shape = (-1,) + (1,) * (x.ndim - 1)
    h = np.diff(time)[k].reshape(shape)
    s = (at - time[k]).reshape(shape) / h
    begin, end, first, last = x[k], x[k + 1], h * slopes[k], h * slopes[k + 1]
    rise = end - begin
    return begin + s * (first + s * (3.0 * rise - 2.0 * first - last + s * (first + last - 2.0 * rise)))


def _short(h: Array, chord: Array) -> Array:
    """Slopes through two or three samples."""
    if len(h) == 1:
        return np.repeat(chord, 2, axis=0)
    bend = (chord[1] - chord[0]) / (h[0] + h[1])
    return np.stack([chord[0] - h[0] * bend, chord[0] + h[0] * bend, chord[1] + h[1] * bend])
