"""Steps of a signal from row to row that differ from their neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.median import median
from armid.measurement.recording import Recording

NEAR = 4
"""Number of rows on either side of a jump that are not compared with it, because it changes their neighbours."""

EVEN = 1.5
"""Largest time between two rows, in usual steps, across which rows are compared."""


def step_excess(signal: Array) -> Array:
    """Differences of the steps of a signal (N, n) from the median of their four neighbours, shape (N - 1, n)."""
    steps = np.diff(signal, axis=0)
    usual = np.stack([steps[:-4], steps[1:-3], steps[3:-1], steps[4:]])
    excess = np.zeros_like(steps)
    excess[2:-2] = steps[2:-2] - np.median(usual, axis=0)
    return excess


def regular_steps(recording: Recording) -> NDArray[np.bool_]:
    """Mask of the steps between rows that are valid and follow each other in time, shape (N - 1,)."""
    valid = np.atleast_1d(recording.valid if recording.valid.ndim == 1 else recording.valid.all(axis=1))
    used = valid[1:] & valid[:-1]
    if recording.time is None:
        return used
    step = np.diff(recording.time)
    return used & (step < EVEN * float(median(step)))


def largest_apart(size: Array, most: int) -> NDArray[np.intp]:
    """Rows of the largest values (M,), none near a larger one, in decreasing order."""
    found: list[int] = []
    free = np.ones(len(size), dtype=np.bool_)
    for row in np.argsort(-size, kind="stable"):
        if len(found) == most:
            break
        if free[row]:
            found.append(int(row))
            free[max(row - NEAR, 0) : row + NEAR + 1] = False
    return np.array(found, dtype=np.intp)
