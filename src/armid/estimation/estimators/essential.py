"""Essential parameters by backward elimination: parameters that hardly reduce the residual are set to zero.

Let π be a least-squares estimate and G the inverse of its normal matrix, with the columns G_k. If parameter k is set
to zero, the new values are

    π - G_k π_k / G_kk,        G - G_k G_kᵀ / G_kk,        cost + π_k² / G_kk,

so that the whole elimination is at most b small updates after one factorisation. Two rules choose the parameters:

- `pham-gautier` drops the parameter with the largest relative deviation, until the largest is less than `ratio` times
  the smallest [Pham1991];
- `bic` drops the parameter whose removal increases the cost least, as long as this increase is below the logarithm of
  the number of rows [Schwarz1978]. Residuals are correlated; the number of independent rows is computed from the
  scatter between blocks.

The same data are used for selection and estimate, so the selection does not make the parameters more accurate.
Therefore the deviations and the covariance of the estimate with all parameters are kept, and a parameter that is set
to zero has an interval around zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError, Finding, did_you_mean
from armid.estimation.crossvalidation import held_out_squares
from armid.estimation.estimators.wls import WeightedLeastSquares
from armid.estimation.fit_result import Fit
from armid.estimation.least_squares import Solution
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.jackknife import block_covariance
from armid.information.information import Information, restrict, stack, total
from armid.maths.linalg import condition, scaled_condition
from armid.maths.median import median
from armid.threads import one_blas_thread


@dataclass(frozen=True, slots=True)
class EssentialParameters:
    """Weighted least squares in which parameters that hardly reduce the residual are set to zero.

    Attributes:
        criterion: `pham-gautier` or `bic`.
        ratio: Ratio of the largest to the smallest relative deviation at which the elimination ends, usually 10 to
            30.
        price: Largest relative increase of the weighted residual by all dropped parameters together. Without this
            limit, `ratio` alone would also drop small parameters that the data determine well, because their relative
            deviation is large.
    """

    criterion: Literal["pham-gautier", "bic"] = "pham-gautier"
    ratio: float = 30.0
    price: float = 0.003
    name: ClassVar[str] = "essential"
    quick: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.criterion not in ("pham-gautier", "bic"):
            raise EstimationError(
                f"The option `criterion` has the unknown value {self.criterion!r}.",
                possible="pham-gautier, bic",
                remedy=did_you_mean(self.criterion, ("pham-gautier", "bic")),
            )
        if not self.ratio >= 1.0:
            raise EstimationError(
                f"The option `ratio` must be at least 1; found {self.ratio!r}.",
                possible="1 or more",
                remedy="use a value from 10 to 30.",
            )
        if not self.price >= 0.0:
            raise EstimationError(
                f"The option `price` must be at least 0; found {self.price!r}.",
                possible="0 or more, inf",
                remedy="use 0.003, or leave the option out.",
            )

    @one_blas_thread
    def solve(self, problem: EstimationProblem) -> Fit:
        """Estimates the base parameters, with standard deviations for white residuals.

        Raises:
            EstimationError: The data do not determine all base parameters; the elimination begins with all of them.
        """
        full = WeightedLeastSquares().solve(problem)
        whole = total(problem.information)
        weights = full.weights
        cost = float(weights**2 @ held_out_squares(whole, full.values))
        solution = Solution(whole, weights)
        inverse = solution.inverse
        if self.criterion == "bic":
            excess = _correlation(problem.information, full, inverse)
            most = excess * max(1.0, math.log(max(float(whole.rows.sum()) / excess, 1.0)))
            kept = _eliminate(full.values, inverse, _cheapest(most))
        else:
            most = cost * ((1.0 + self.price) ** 2 - 1.0)
            kept = _eliminate(full.values, inverse, _least_sure(self.ratio, most))
        return _fit(full, whole, kept, cost)


Choose = Callable[[Array, Array], int | None]
"""Function that chooses the parameter to drop, from values and variances of the remaining parameters. It returns
the index among the remaining parameters, or `None` to end the elimination."""


def _eliminate(values: Array, inverse: Array, choose: Choose) -> NDArray[np.intp]:
    """Drops parameters until the rule `choose` ends the elimination.

    Args:
        values: Estimate with all parameters, shape (b,).
        inverse: Inverse of the normal matrix, shape (b, b).
        choose: Rule that chooses the parameter to drop.

    Returns:
        Indices of the k remaining parameters, shape (k,).
    """
    remaining = np.arange(len(values))
    scale = np.sqrt(np.diag(inverse))
    pi, G = values / scale, inverse / np.outer(scale, scale)
    while len(remaining) > 1:
        k = choose(pi, np.diag(G))
        if k is None:
            break
        stay = np.arange(len(remaining)) != k
        column = G[stay, k] / G[k, k]
        pi = pi[stay] - column * pi[k]
        G = G[np.ix_(stay, stay)] - column[:, None] * G[k, stay]
        remaining = remaining[stay]
    return remaining


def _least_sure(ratio: float, most: float) -> Choose:
    """Rule `pham-gautier`: drops the parameter with the largest relative deviation.

    The elimination ends when the largest relative deviation is less than `ratio` times the smallest one, or when
    the squared residual would increase by more than `most`.
    """
    total = 0.0

    def choose(pi: Array, variance: Array) -> int | None:
        nonlocal total
        sure = np.abs(pi) / np.sqrt(variance)  # one over the relative deviation
        k = int(np.argmin(sure))
        total += sure[k] ** 2
        return k if sure.max() > ratio * sure[k] and total <= most else None

    return choose


def _cheapest(most: float) -> Choose:
    """Rule `bic`: drops the parameter whose removal increases the cost least.

    The elimination ends when dropping any further parameter would increase the cost by `most` or more.
    """

    def choose(pi: Array, variance: Array) -> int | None:
        rise = pi**2 / variance
        k = int(np.argmin(rise))
        return k if rise[k] < most else None

    return choose


def _correlation(information: Information, full: Fit, inverse: Array) -> float:
    """Number of rows that count as one independent row.

    It is the variance of the estimate from the scatter between blocks, divided by the variance for white residuals.
    """
    found = block_covariance(information, full.values, full.weights, inverse)
    if found is None:
        return 1.0
    return max(1.0, float(median(np.diag(found[0]) / np.diag(inverse))))


def _fit(full: Fit, whole: Information, kept: NDArray[np.intp], cost: float) -> Fit:
    """Makes the fit in which only some parameters differ from zero.

    Args:
        full: Fit of all parameters.
        whole: Factors of all rows, one block.
        kept: Indices of the parameters that differ from zero, shape (k,).
        cost: Weighted sum of squared residuals of the fit of all parameters.
    """
    reduced = restrict(whole, kept)
    solution = Solution(reduced, full.weights)
    values = np.zeros(whole.count)
    values[kept] = solution.values
    rows = stack(reduced)[0]
    dropped = tuple(name for k, name in enumerate(whole.names) if k not in set(kept.tolist()))
    squares = held_out_squares(whole, values)
    sure = np.abs(solution.values) / np.sqrt(np.diag(solution.inverse))
    rise = np.sqrt(float(full.weights**2 @ squares) / cost) - 1.0 if cost else 0.0
    return replace(
        full,
        values=values,
        residual_rms=np.sqrt(squares / np.maximum(whole.rows[0], 1)),
        condition=condition(rows),
        scaled_condition=scaled_condition(rows),
        dropped=dropped,
        findings=(*full.findings, _finding(dropped, whole.count, rise, float(sure.max() / sure.min()))),
    )


def _finding(dropped: tuple[str, ...], count: int, rise: float, ratio: float) -> Finding:
    """Finding that names the dropped parameters and the increase of the residual.

    Args:
        dropped: Names of the dropped parameters.
        count: Number of all parameters.
        rise: Relative increase of the weighted residual.
        ratio: Ratio of the largest to the smallest relative deviation of the remaining parameters.
    """
    names = f": {', '.join(dropped)}" if dropped else ""
    return Finding(
        "parameters-dropped",
        "info",
        "",
        f"{len(dropped)} of {count} base parameters are set to zero{names}. This increases the weighted residual by "
        f"{100.0 * rise:.2g} %. Among the remaining parameters, the largest relative standard deviation is "
        f"{ratio:.3g} times the smallest.",
    )
