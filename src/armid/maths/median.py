"""Median of samples.

The median of NumPy is not used, because it imports masked arrays, which takes longer than the computation of most
medians.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.checked_array import Array

LARGE, SAMPLED = 50_000, 4096
"""Number of samples above which the median is searched in an interval, and number of samples that give it."""

AROUND = (0.45, 0.55)
"""Quantiles of these samples between which the median of all is searched; otherwise, all samples are partitioned."""


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
    if samples.ndim == 1 and count > LARGE:
        return np.asarray(_median_of_many(samples), dtype=np.float64)
    low, high = (count - 1) // 2, count // 2
    ordered = np.partition(samples, (low, high, count - 1), axis=0)  # NaN comes last
    return np.asarray(np.where(np.isnan(ordered[-1]), np.nan, (ordered[low] + ordered[high]) / 2.0), dtype=np.float64)


def _median_of_many(x: NDArray[Any]) -> float:
    """Median of many samples (N,); only those in an interval that some of them give are partitioned."""
    if np.isnan(x.min()):
        return float("nan")
    low, high = (len(x) - 1) // 2, len(x) // 2
    few = x[:: len(x) // SAMPLED]
    a, b = (int(share * len(few)) for share in AROUND)
    ordered = np.partition(few, (a, b))
    below, to_end = x < ordered[a], x <= ordered[b]
    before = int(np.count_nonzero(below))
    inside = x[below ^ to_end]  # what is below the interval is below its end, too
    if not before <= low <= high < before + len(inside):
        inside, before = x, 0
    elif ordered[a] == ordered[b]:
        return float(ordered[a])
    ordered = np.partition(inside, (low - before, high - before))
    return float((ordered[low - before] + ordered[high - before]) / 2.0)
