"""Median of samples.

The median of NumPy is not used, because it imports masked arrays, which takes longer than the computation of most
medians.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array


def median(x: ArrayLike) -> Array:
    """Medians along axis 0; NaN if a sample is NaN or if there are no samples.

    Args:
        x: Samples, shape (N, ...).

    Returns:
        Medians, shape (...).
    """
    samples = np.asarray(x)
    count = len(samples)
    if count == 0:
        return np.full(samples.shape[1:], np.nan)
    low, high = (count - 1) // 2, count // 2
    ordered = np.partition(samples, (low, high, count - 1), axis=0)  # NaN comes last
    return np.asarray(np.where(np.isnan(ordered[-1]), np.nan, (ordered[low] + ordered[high]) / 2.0), dtype=np.float64)
