"""Estimate of a problem by a method, with the covariance that its intervals need."""

from __future__ import annotations

from dataclasses import replace

from armid.estimation.catalogue import Estimator
from armid.estimation.estimators import WeightedLeastSquares
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.covariance import estimate_covariance


def estimate(problem: EstimationProblem, method: Estimator | None = None) -> Fit:
    """Estimates the base parameters with their covariance and intervals.

    Args:
        problem: Information, and as far as the method needs them model and samples; see `build_problem`.
        method: Estimator with its options; weighted least squares where none is given.

    Raises:
        EstimationError: The data do not determine the parameters, or the problem lacks what the method needs.
    """
    fit = (method or WeightedLeastSquares()).solve(problem)
    return replace(estimate_covariance(fit, problem), information=None)
