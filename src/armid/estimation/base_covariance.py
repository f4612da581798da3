"""Covariance of the base parameters that follows from a prior of the standard parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.estimation.prior import Prior
from armid.estimation.problem import StandardParameters
from armid.maths.linalg import half_of, inverse_of


@dataclass(frozen=True, eq=False, slots=True)
class BaseCovariance:
    """Covariance of the b base parameters that follows from a prior, in two parts.

    The weight of the prior applies only to the part of the bodies.

    Attributes:
        bodies: Part of the inertial parameters for weight 1, shape (b, b).
        others: Part of friction, offsets and rotor inertia, which always have weight 1, shape (b, b).
    """

    bodies: Array
    others: Array

    def weighted(self, weight: float) -> Array:
        """Covariance for a positive weight of the prior of the bodies, shape (b, b)."""
        return self.bodies / weight + self.others

    def precision(self, weight: float) -> Array:
        """Inverse of the covariance for a weight of the prior of the bodies, shape (b, b); zero matrix for weight 0.

        Weight 0 means that there is no prior.
        """
        if weight == 0.0:
            return np.zeros_like(self.bodies)
        precision = inverse_of(self.weighted(weight))
        return 0.5 * (precision + precision.T)


def base_covariance(prior: Prior, standard: StandardParameters) -> BaseCovariance:
    """Covariance of the base parameters that follows from a prior of the standard parameters."""
    inertial = np.zeros(len(standard.names), dtype=np.bool_)
    inertial[standard.inertial] = True
    bodies, others = (
        project_covariance(prior.precision[np.ix_(own, own)], standard.regrouping[:, own])
        for own in (inertial, ~inertial)
    )
    return BaseCovariance(bodies, others)


def project_covariance(precision: Array, regrouping: Array) -> Array:
    """Covariance L P⁻¹ Lᵀ of the base parameters that follows from the precision P of a prior, shape (b, b).

    Args:
        precision: Precision P of the x unknowns, positive definite, shape (x, x).
        regrouping: Matrix L with base parameters = L · unknowns, shape (b, x).
    """
    shown = regrouping @ half_of(precision)
    return shown @ shown.T
