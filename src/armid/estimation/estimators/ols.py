"""Ordinary least squares, equations (3.50) and (3.51) of the thesis: the rows of all joints have equal weight.

    σ² = |ρ - W π|² / (m - b),        cov = σ² (WᵀW)⁻¹

for m rows and b parameters. These are equations (2.44) to (2.46) of the thesis, with the square that (2.44) lacks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from armid.estimation.fit_result import Fit
from armid.estimation.least_squares import fit_of, solve
from armid.estimation.problem import EstimationProblem
from armid.threads import one_blas_thread


@dataclass(frozen=True, slots=True)
class OrdinaryLeastSquares:
    """Ordinary least squares: minimises the sum of the squared residuals of all rows, unweighted."""

    name: ClassVar[str] = "ols"
    quick: ClassVar[bool] = True

    @one_blas_thread
    def solve(self, problem: EstimationProblem) -> Fit:
        """Estimates the base parameters, with standard deviations for white residuals.

        Raises:
            EstimationError: The data do not determine all base parameters.
        """
        information = problem.information
        weights = np.ones(information.n)
        solution = solve(information, weights)
        freedom = max(float(information.rows.sum()) - information.count, 1.0)
        variance = solution.squares.sum() / freedom
        return fit_of(solution, weights, variance * solution.inverse)
