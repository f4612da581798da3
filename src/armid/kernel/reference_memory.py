"""NumPy twin of the kernel's play operators along a contiguous run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.values import Array


def play(x: Array, column: NDArray[np.int32], width: Array) -> tuple[Array, NDArray[np.int64]]:
    """States (N, m) of z ← min(max(z, q - r), q + r), and the first sample at which each is known, shape (m,).

    The initial state lies between q - r and q + r; both are propagated, and the state is known where they agree.
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
