"""Estimation in two steps: an estimator computes the values, then the covariance for the intervals is computed."""

from __future__ import annotations

from dataclasses import replace

from armid.estimation.catalogue import Estimator
from armid.estimation.estimators.wls import WeightedLeastSquares
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.covariance import Uncertainty
from armid.threads import one_blas_thread


@one_blas_thread
def estimate(problem: EstimationProblem, method: Estimator | None = None, *, systematic_errors: bool = True) -> Fit:
    """Estimates the base parameters with their covariance and intervals.

    Args:
        problem: Information, and model and samples if the estimator needs them; see `build_problem`.
        method: Estimator with its options; if not given, weighted least squares.
        systematic_errors: True if the covariance contains the effect of systematic errors.

    Raises:
        EstimationError: The data do not determine the parameters, or the problem lacks data that the estimator needs.
    """
    own = Uncertainty((method or WeightedLeastSquares()).solve(problem), problem)
    fit = own.with_covariance(systematic_errors=systematic_errors)
    misfit = own.misfit_covariance * (fit.covariance_kind != "white")  # which does not contain it
    report = replace(fit.report, by_misfit=misfit, by_systematic=own.systematic_covariance)
    return replace(fit, information=None, prior_excess=None, report=report)
