"""Weighted least squares with one weight a joint, found by iteration.

Each joint's rows are divided by the standard deviation of its own residual, which the next solution sharpens, until
the deviations stand still [Gautier1997]. It is the maximum-likelihood estimate where joints differ in noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from armid.errors import EstimationError
from armid.estimation.fit import Fit
from armid.estimation.least_squares import fit_of, residual_deviation, solve
from armid.estimation.problem import EstimationProblem
from armid.information.information import total
from armid.threads import one_blas_thread

__all__ = ["WeightedLeastSquares"]

STANDSTILL = 1e-9
"""Largest relative change of a deviation that ends the iteration: far below any effect on the estimate."""

RESOLUTION = 1e-13
"""Smallest residual over torque that arithmetic resolves. Without it noise-free data would get infinite weights, and
weights of data that were only rounded would change for ever."""


@dataclass(frozen=True, slots=True)
class WeightedLeastSquares:
    """The estimate that minimises each joint's squared residual over its own variance.

    Attributes:
        iterations: Most solutions before giving up.
    """

    iterations: int = 1000
    name: ClassVar[str] = "wls"
    quick: ClassVar[bool] = True

    @one_blas_thread
    def estimate(self, problem: EstimationProblem) -> Fit:
        """Estimate the base parameters.

        Raises:
            EstimationError: The data do not determine them, or the weights do not settle.
        """
        whole = total(problem.information)
        torque = np.array([np.linalg.norm(joint.R[0, :, -1]) for joint in whole.joints])
        floor = RESOLUTION * torque / np.sqrt(np.maximum(whole.rows[0], 1))
        floor[torque == 0.0] = 1.0  # a joint of which no row counts; any weight will do
        deviation = np.ones(whole.n)
        for _ in range(self.iterations):
            weights = 1.0 / deviation
            solution = solve(whole, weights)
            updated = np.maximum(residual_deviation(solution, whole), floor)
            settled = bool((np.abs(updated - deviation) <= STANDSTILL * deviation + floor).all())
            deviation = updated
            if settled:
                return fit_of(solution, weights, solution.inverse)
        raise EstimationError(
            f"The weights of the joints did not settle in {self.iterations} iterations.",
            possible="ols, or more iterations",
            remedy='use method = "ols" and look at the residual of each joint.',
        )
