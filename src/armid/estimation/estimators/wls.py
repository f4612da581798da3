"""Weighted least squares with one weight for each joint, found by iteration.

The rows of each joint are divided by the standard deviation of the residual of this joint. This is repeated with the
new residuals until the standard deviations converge [Gautier1997]. The result is the maximum-likelihood estimate for
joints with different noise. The iteration converges slowly where joints share most of their parameters, so its points
are extrapolated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.fit_result import Fit
from armid.estimation.least_squares import Solution, fit_of, require_rank, residual_deviation
from armid.estimation.problem import EstimationProblem
from armid.information.information import total
from armid.maths.fixed_point import fixed_point
from armid.remedy import Remedy, setting
from armid.threads import one_blas_thread

STANDSTILL = 1e-12
"""Largest relative change of a standard deviation at which the iteration ends: far below any effect on the
estimate."""

LIMITED = 1e-6
"""Relative change of a standard deviation that is accepted where rounding errors prevent smaller ones, as with badly
conditioned parameters: still far below the uncertainty of a standard deviation."""

RESOLUTION = 1e-13
"""Lower limit of the ratio of residual to torque, which double precision resolves. Without this limit, noise-free
data would get infinite weights, and the weights of data with rounding errors only would never converge."""


@dataclass(frozen=True, slots=True)
class WeightedLeastSquares:
    """Weighted least squares: the squared residuals of each joint are divided by the noise variance of the joint.

    Attributes:
        iterations: Largest number of iterations.
    """

    iterations: int = 1000
    name: ClassVar[str] = "wls"
    quick: ClassVar[bool] = True

    @one_blas_thread
    def solve(self, problem: EstimationProblem) -> Fit:
        """Estimates the base parameters, with standard deviations for white residuals.

        Raises:
            EstimationError: The data do not determine the parameters, or the weights do not converge.
        """
        whole = total(problem.information)
        torque = np.array([np.linalg.norm(joint.R[0, :, -1]) for joint in whole.joints])
        floor = RESOLUTION * torque / np.sqrt(np.maximum(whole.rows[0], 1))
        floor[torque == 0.0] = 1.0  # a joint without rows in use may have any weight
        require_rank(whole)
        solution = None

        def updated(logarithms: Array) -> Array:
            nonlocal solution
            solution = Solution(whole, np.exp(-logarithms))
            return np.log(np.maximum(residual_deviation(solution, whole), floor))

        def tolerance(logarithms: Array) -> Array:
            return STANDSTILL + floor * np.exp(-logarithms)

        found = fixed_point(updated, np.zeros(whole.n), tolerance, self.iterations, LIMITED)
        if found.settled and solution is not None:
            return fit_of(solution, np.exp(-found.x), solution.inverse)
        raise EstimationError(
            f"The weights of the joints did not converge in {self.iterations} iterations.",
            possible="ols, or more iterations",
            remedy=Remedy("use ", setting("method", "ols"), " and inspect the residual of each joint."),
        )
