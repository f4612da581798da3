"""Birge ratio: scatter of measurements of one quantity compared with their standard deviations."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array


def birge_ratio(values: Array, deviations: Array) -> float:
    """Birge ratio of several measurements of one quantity, at least 1.

    It is the scatter of the values about their weighted mean, divided by the scatter that is expected from their
    standard deviations. For fewer than two measurements it is 1.

    Args:
        values: Measurements of one quantity, shape (k,).
        deviations: Standard deviations, shape (k,); measurements with a deviation of zero are left out.
    """
    known = deviations > 0.0
    if known.sum() < 2:
        return 1.0
    weight = deviations[known] ** -2.0
    mean = weight @ values[known] / weight.sum()
    return max(1.0, float(np.sqrt(weight @ (values[known] - mean) ** 2 / (known.sum() - 1))))
