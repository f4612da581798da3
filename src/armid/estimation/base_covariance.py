"""Covariance of the base parameters by a prior of the standard parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.estimation.prior import Prior
from armid.estimation.problem import StandardParameters
from armid.maths.linalg import half_of, inverse_of


@dataclass(frozen=True, eq=False, slots=True)
class BaseCovariance:
    """Covariance of the b base parameters by a prior, in two parts, because a weight belongs to the bodies alone.

    Attributes:
        bodies: Part of the inertial parameters for weight 1, shape (b, b).
        others: Part of friction, offsets and rotor inertia, which keep weight 1, shape (b, b).
    """

    bodies: Array
    others: Array

    def weighted(self, weight: float) -> Array:
        """Covariance (b, b) for a positive weight of the bodies."""
        return self.bodies / weight + self.others

    def precision(self, weight: float) -> Array:
        """Inverse of the covariance, shape (b, b); zero for weight 0, which is no prior."""
        if weight == 0.0:
            return np.zeros_like(self.bodies)
        precision = inverse_of(self.weighted(weight))
        return 0.5 * (precision + precision.T)


def base_covariance(prior: Prior, standard: StandardParameters) -> BaseCovariance:
    """Covariance of the base parameters of some standard parameters by a prior."""
    inertial = np.zeros(len(standard.names), dtype=np.bool_)
    inertial[standard.inertial] = True
    bodies, others = (
        project_covariance(prior.precision[np.ix_(own, own)], standard.regrouping[:, own])
        for own in (inertial, ~inertial)
    )
    return BaseCovariance(bodies, others)


def project_covariance(precision: Array, regrouping: Array) -> Array:
    """Covariance of the base parameters by the prior, L P⁻¹ Lᵀ, shape (b, b).

    Args:
        precision: Precision P of the x unknowns, positive definite, shape (x, x).
        regrouping: Matrix L with base parameters = L · unknowns, shape (b, x).
    """
    shown = regrouping @ half_of(precision)
    return shown @ shown.T
