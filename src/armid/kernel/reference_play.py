"""NumPy twin of the kernel's play operators (hysteresis elements), evaluated along a contiguous run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array


def play(x: Array, column: NDArray[np.int32], width: Array) -> tuple[Array, NDArray[np.int64]]:
    """States z of play operators, shape (N, m), and the first sample at which each state is known, shape (m,).

    From sample to sample, z ← min(max(z, q - r), q + r), with the half-width r and the coordinate q of the operator.
    The unknown initial state lies between q - r and q + r. The states are computed from both ends of this range; z is
    known from the first sample at which the two results are equal.
    """
    states = np.empty((len(x), len(column)))
    known = np.full(len(column), len(x), dtype=np.int64)
    if len(x) == 0:
        return states, known
    low, high = x[0, column] - width, x[0, column] + width
    for s, q in enumerate(x[:, column]):
        low = np.minimum(np.maximum(low, q - width), q + width)
        high = np.minimum(np.maximum(high, q - width), q + width)
        states[s] = 0.5 * (low + high)
        known[(low == high) & (known == len(x))] = s
    return states, known
