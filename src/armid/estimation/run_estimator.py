"""Estimation in two steps: an estimator computes the values, then the covariance for the intervals is computed."""

from __future__ import annotations

from dataclasses import replace

from armid.estimation.catalogue import Estimator
from armid.estimation.estimators.wls import WeightedLeastSquares
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.covariance import estimate_covariance


def estimate(problem: EstimationProblem, method: Estimator | None = None) -> Fit:
    """Estimates the base parameters with their covariance and intervals.

    Args:
        problem: Information, and model and samples if the estimator needs them; see `build_problem`.
        method: Estimator with its options; if not given, weighted least squares.

    Raises:
        EstimationError: The data do not determine the parameters, or the problem lacks data that the estimator needs.
    """
    fit = (method or WeightedLeastSquares()).solve(problem)
    return replace(estimate_covariance(fit, problem), information=None, prior_excess=None)
