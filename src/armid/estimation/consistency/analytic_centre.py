"""Analytic centre of the set of consistent parameters, and the Hessian of the cost at this point.

A consistent estimate often lies on the boundary of the cone. There, its uncertainty does not follow from the Hessian
of the cost. Therefore the Hessian at the analytic centre, which lies inside the cone, is used. The analytic centre
minimises the cost of data and prior plus a barrier: -log det J for the pseudo-inertia J of each link and -log x for
each nonnegative parameter x, with the weight of one independent sample. The intervals are then enlarged by the
distance between estimate and centre [Nesterov1994].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.prior import MASS, Prior, relative_precision, size_of_bodies
from armid.estimation.problem import StandardParameters
from armid.estimation.standard_parameter_resolution import PriorUse
from armid.estimation.whitened_system import WhitenedSystem
from armid.maths.barrier_function import LogDet, Smooth
from armid.maths.barrier_method import minimise
from armid.maths.inertia import PSEUDO_INERTIA_OF, pseudo_inertia

AIM = 1e-6
"""Difference between the cost and its minimum at which the search for the centre ends. The Hessian needs the centre
only to a few hundredths of a standard deviation."""


@dataclass(frozen=True, eq=False, slots=True)
class AnalyticCentre:
    """Analytic centre with the Hessian of prior and barrier.

    Attributes:
        values: Standard parameters at the centre, shape (p,).
        precision: Hessian of prior and barrier at the centre, in units of the weighted normal equations, shape (p,
            p).
    """

    values: Array
    precision: Array


def find_centre(
    standard: StandardParameters,
    weighted: WhitenedSystem,
    belief: Prior,
    prior: PriorUse,
    values: Array,
    basis: Array,
) -> AnalyticCentre | None:
    """Computes the analytic centre; `None` if the search finds no centre or no start point inside the cone.

    Args:
        standard: The standard parameters.
        weighted: The whitened data.
        belief: The prior for weight 1.
        prior: Kind and weight of the prior in the estimate.
        values: The estimate, shape (p,).
        basis: Derivative of the parameters by the x unknowns, shape (p, x).
    """
    believed, mean = _rows(standard, belief, prior)
    root = np.sqrt(weighted.correlation * believed)
    moved = weighted.rows @ standard.regrouping
    used = root > 0.0
    problem = Smooth(
        np.concatenate([moved @ basis, (root[:, None] * basis)[used]]),
        np.concatenate([weighted.rows @ weighted.values - moved @ values, (root * (mean - values))[used]]),
        _terms(standard, belief, prior, weighted.correlation, values, basis),
        (),
        np.zeros(basis.shape[1]),
    )
    pull = moved.T @ (moved @ values - weighted.rows @ weighted.values) + root**2 * (values - mean)
    if prior.kind in ("mass", "none"):
        pull += weighted.correlation * _weight(prior) / MASS * size_of_bodies(standard)
    guess = belief.lifted(standard, values, pull, weighted.correlation, bodies=prior.kind != "log-det")
    for place, near in ((guess, True), (belief.inside(standard), False)):
        start = (basis.T @ (place - values)) / np.sum(basis**2, axis=0)
        try:
            found = values + basis @ minimise(problem, start, aim=AIM, near=near).x
        except EstimationError:
            continue
        return AnalyticCentre(found, weighted.correlation * _curvature(standard, belief, prior, found, basis))
    return None


def _weight(prior: PriorUse) -> float:
    """Weight of the prior of the links; 1 if the estimate has no prior."""
    return prior.weight if prior.weight > 0.0 else 1.0


def _rows(standard: StandardParameters, belief: Prior, prior: PriorUse) -> tuple[Array, Array]:
    """Quadratic terms of the prior: diagonal of the precision, shape (p,), and mean, shape (p,)."""
    precision = np.diag(belief.precision).copy()
    precision[standard.inertial] *= _weight(prior) if prior.kind == "euclidean" else 0.0
    return precision, belief.mean


def _terms(
    standard: StandardParameters, belief: Prior, prior: PriorUse, correlation: float, values: Array, basis: Array
) -> tuple[LogDet, ...]:
    """Barriers that keep pseudo-inertias definite and nonnegative parameters positive.

    They are functions of the change of the x unknowns from the estimate.

    Args:
        standard: The standard parameters.
        belief: The prior for weight 1.
        prior: Kind and weight of the prior in the estimate.
        correlation: Number of rows that count as one independent sample.
        values: The estimate, shape (p,).
        basis: Derivative of the parameters by the unknowns, shape (p, x).
    """
    terms: list[LogDet] = []
    if prior.kind == "log-det":
        terms.extend(belief.log_det(standard, values, basis, correlation * _weight(prior)))
    else:
        units = PSEUDO_INERTIA_OF.transpose(1, 2, 0)
        size = 0.0 if prior.kind == "euclidean" else _weight(prior) / MASS
        cost = size * size_of_bodies(standard)
        for own in standard.inertial:
            if basis[own].any():
                matrix, offset = units @ basis[own], pseudo_inertia(values[own])
                terms.append(LogDet(matrix, offset, cost[own] @ basis[own], 0.0, correlation))
    nothing = np.zeros(basis.shape[1])
    for k in np.flatnonzero(standard.nonnegative & basis.any(axis=1)):
        terms.append(LogDet(basis[k][None, None], values[[k]][:, None], nothing, 0.0, correlation))
    return tuple(terms)


def _curvature(standard: StandardParameters, belief: Prior, prior: PriorUse, values: Array, basis: Array) -> Array:
    """Hessian of prior and barrier at the centre, if each row of the data is one independent sample, shape (p, p).

    Args:
        standard: The standard parameters.
        belief: The prior for weight 1.
        prior: Kind and weight of the prior in the estimate.
        values: Standard parameters at the centre, shape (p,).
        basis: Derivative of the parameters by the x unknowns, shape (p, x).
    """
    result = belief.curvature(standard, values, _weight(prior))
    if prior.kind != "log-det":
        relative = relative_precision(pseudo_inertia(values[standard.inertial]))
        for own, precision in zip(standard.inertial, relative, strict=True):
            if basis[own].any():
                links = np.ix_(own, own)
                before = result[links] if prior.kind == "euclidean" else 0.0
                result[links] = before + precision
    bounded = np.flatnonzero(standard.nonnegative & basis.any(axis=1))
    result[bounded, bounded] += 1.0 / values[bounded] ** 2
    return result
