"""The consistent estimate as cvxpy has it: the program stated in its language, built and solved from factors."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.estimation.prior import LENGTH, MASS, make_prior
from armid.estimation.problem import EstimationProblem
from armid.estimation.whitened_system import whiten
from armid.maths.inertia import PSEUDO_INERTIA_OF, pseudo_inertia

__all__ = ["modelled_fit"]

EPSILON = 1e-6


def modelled_fit(problem: EstimationProblem, kind: str, solver: str) -> Array:
    """Standard parameters (p,) of real bodies with a prior of weight 1, by cvxpy and a solver of its choice.

    Args:
        problem: Factors and standard parameters.
        kind: `mass`, `euclidean` or `log-det`.
        solver: As cvxpy names it.
    """
    cp: Any = import_module("cvxpy")
    standard = problem.require_standard("physical")
    weighted = whiten(problem.information)
    belief = make_prior(kind, standard, weighted)
    correlation = weighted.correlation
    theta = cp.Variable(len(standard.names))
    is_link = np.isin(np.arange(len(standard.names)), standard.inertial)
    believed = np.where(is_link & (kind != "euclidean"), 0.0, np.diag(belief.precision))
    cost = 0.5 * cp.sum_squares(weighted.rows @ (standard.regrouping @ theta - weighted.values))
    cost += 0.5 * cp.sum_squares(cp.multiply(np.sqrt(correlation * believed), theta - belief.mean))
    kept = [theta[np.flatnonzero(standard.nonnegative)] >= 0.0]
    for link, own in enumerate(standard.inertial):
        J: Any = sum(theta[k] * PSEUDO_INERTIA_OF[i] for i, k in enumerate(own))
        kept.append(J >> EPSILON * np.eye(4))
        if kind == "mass":
            cost += correlation / MASS * (J[3, 3] + (J[0, 0] + J[1, 1] + J[2, 2]) / LENGTH**2)
        if kind == "log-det":
            nominal = pseudo_inertia(belief.mean[standard.inertial[link]])
            cost += correlation * (cp.trace(np.linalg.inv(nominal) @ J) - cp.log_det(J))
    cp.Problem(cp.Minimize(cost), kept).solve(solver=solver)
    return np.asarray(theta.value, dtype=np.float64)
