"""Covariance of an estimate from uncertain scales of the joints' torques."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.information.information import Information, stack


def scale_covariance(whole: Information, weights: Array, inverse: Array) -> Array:
    """Covariance (b, b) from uncertain scales of the joints' torques, such as drive gains.

    If the torque of joint j is wrong by a factor 1 + δ_j, the estimate changes by δ_j H⁻¹ w_j² R_jᵀ ρ_j, with the
    normal matrix H, and weight w_j, factor R_j and right-hand side ρ_j of the joint. The δ_j are independent.
    """
    covariance = np.zeros_like(inverse)
    for j in np.flatnonzero(whole.scale_deviation):
        only = np.where(np.arange(whole.n) == j, weights, 0.0)
        A, y = stack(whole, only)
        change = inverse @ (A.T @ y)
        covariance += whole.scale_deviation[j] ** 2 * np.outer(change, change)
    return covariance
