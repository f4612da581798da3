"""Statistics of channels (N, n) in few passes: extremes, standard deviations, values at a few times.

NumPy reduces the first axis of an array with few columns slowly. Here many rows are seen as one long row; its entries
are reduced first, and then those of each channel.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array

ROWS = 512
"""Number of rows that are seen as one."""

TILE = 16384
"""Number of rows that are processed at a time."""


def extremes(x: Array) -> tuple[Array, Array]:
    """Smallest and largest value of each channel, shape (n,) each; NaN if a value is NaN."""
    parts = [(_reduced(np.minimum, part), _reduced(np.maximum, part)) for part in _tiles(x)]
    return np.min([low for low, _ in parts], axis=0), np.max([high for _, high in parts], axis=0)


def outside(x: Array, low: Array, high: Array) -> NDArray[np.int64]:
    """Number of values of each channel that are at most `low` or at least `high`, both of shape (n,); shape (n,)."""
    n = x.shape[1]
    wide_low, wide_high = np.tile(low, ROWS), np.tile(high, ROWS)
    found = np.zeros(n, dtype=np.int64)
    for part in _tiles(x):
        many = len(part) // ROWS * ROWS
        rows = np.ascontiguousarray(part[:many]).reshape(-1, ROWS * n)
        # Of most tiles, few values are counted or none.
        counted = np.flatnonzero((rows <= wide_low) | (rows >= wide_high)) % n
        rest = (part[many:] <= low) | (part[many:] >= high)
        found += np.bincount(counted, minlength=n) + rest.sum(axis=0)
    return found


def standard_deviation(x: Array) -> Array:
    """Standard deviation of each channel (population), shape (n,)."""
    n = x.shape[1]
    near = np.tile(x[0], ROWS)  # a value of each channel, less which sums of squares do not cancel
    total, squares = np.zeros((2, n))
    for part in _tiles(x):
        many = len(part) // ROWS * ROWS
        for rows in (np.ascontiguousarray(part[:many]).reshape(-1, ROWS * n), part[many:]):
            away = rows - near[: rows.shape[1]]
            total += away.sum(axis=0).reshape(-1, n).sum(axis=0)
            squares += np.einsum("ij,ij->j", away, away).reshape(-1, n).sum(axis=0)
    return np.sqrt(np.maximum(squares / len(x) - (total / len(x)) ** 2, 0.0))


def interpolated(wanted: Array, time: Array, x: Array) -> Array:
    """Linear interpolation of channels (N, n) at increasing wanted times inside the time of the channels."""
    before = np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, len(time) - 2)
    slope = (x[before + 1] - x[before]) / (time[before + 1] - time[before])[:, None]
    return x[before] + slope * (wanted - time[before])[:, None]


def _tiles(x: Array) -> Iterator[Array]:
    """Yields the rows of channels (N, n), tile by tile."""
    for begin in range(0, len(x), TILE):
        yield x[begin : begin + TILE]


def _reduced(reduce: np.ufunc, x: Array) -> Array:
    """Reduction of the first axis of a contiguous array (N, n)."""
    many = len(x) // ROWS * ROWS
    if not many or not x.flags.c_contiguous:
        return reduce.reduce(x, axis=0)
    wide = reduce.reduce(x[:many].reshape(-1, ROWS * x.shape[1]), axis=0).reshape(ROWS, -1)
    return reduce.reduce(np.concatenate([wide, x[many:]]), axis=0)
