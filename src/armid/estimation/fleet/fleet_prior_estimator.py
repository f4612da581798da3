"""Estimator of one unit whose prior is its fleet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from armid.estimation.crossvalidation import held_out_squares
from armid.estimation.fit_result import Fit
from armid.estimation.fleet.unit_update import FleetPrior
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.scale_covariance import scale_covariance
from armid.information.information import stack, total
from armid.maths.linalg import condition, inverse_of, root_of, scaled_condition, triangular_factor
from armid.threads import one_blas_thread


@dataclass(frozen=True, eq=False, slots=True)
class FleetPriorEstimator:
    """Weighted least squares with a fleet as Gaussian prior; the weights are those of the fleet.

    Weighted rows count as independent samples, so the precision of the prior is the inverse of its covariance.

    Attributes:
        prior: What the fleet says about the parameters.
    """

    prior: FleetPrior
    name: ClassVar[str] = "fleet"
    quick: ClassVar[bool] = True

    @one_blas_thread
    def solve(self, problem: EstimationProblem) -> Fit:
        """Estimates the base parameters, with standard deviations that are valid for white residuals.

        Raises:
            EstimationError: The problem has other parameters than the fleet.
        """
        prior, whole = self.prior, total(problem.information)
        prior.require_names(whole)
        weights, b = prior.weights, whole.count
        rows, side = stack(whole, weights)
        root = root_of(prior.covariance)
        wide = np.concatenate([np.column_stack([rows @ root, side - rows @ prior.mean]), np.eye(b, b + 1)])
        R = triangular_factor(wide)
        inner = np.linalg.inv(R[:b, :b])
        half = root @ inner
        white, values = half @ half.T, prior.mean + half @ R[:b, -1]
        counted = whole.rows[0]
        unweighted = stack(whole)[0]
        return Fit(
            whole.names,
            values,
            np.sqrt(np.diag(white)),
            white + scale_covariance(whole, weights, white),
            "white",
            max(float(counted.sum()) - b, 1.0),
            np.sqrt(held_out_squares(whole, values) / np.maximum(counted, 1)),
            counted,
            condition(unweighted),
            scaled_condition(unweighted),
            weights,
            prior_precision=inverse_of(prior.covariance),
        )
