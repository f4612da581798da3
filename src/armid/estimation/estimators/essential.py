"""Essential parameters: those left when one after another is dropped that the data hardly need.

Dropping parameter k of a least-squares estimate π with inverse normal matrix G, that is holding it at zero, gives

    π - G_k π_k / G_kk,        G - G_k G_kᵀ / G_kk,        cost + π_k² / G_kk,

so that a whole elimination is some b small updates of what one factorisation gave. Two rules say which and how long:

- `pham-gautier` drops the parameter with the largest relative deviation until that is less than `ratio` times the
  smallest [Pham1991];
- `bic` drops the parameter that costs least while that is less than the logarithm of the number of rows
  [Schwarz1978]. Residuals are correlated, and rows count as many as their scatter between blocks says.

A parameter chosen by the same data is no surer than it was before the choice: deviations and covariance stay those of
the estimate with all parameters, so that a parameter held at zero has an interval about zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from armid.errors import EstimationError, Finding
from armid.estimation.crossvalidation import held_out_squares
from armid.estimation.estimators.wls import WeightedLeastSquares
from armid.estimation.fit import Fit
from armid.estimation.least_squares import Solution
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.covariance import block_covariance
from armid.information.information import Information, restrict, stack, total
from armid.maths.linalg import condition, scaled_condition
from armid.threads import one_blas_thread
from armid.values import Array

__all__ = ["EssentialParameters"]


@dataclass(frozen=True, slots=True)
class EssentialParameters:
    """Weighted least squares with the parameters held at zero that the data hardly need.

    Attributes:
        criterion: `pham-gautier` or `bic`.
        ratio: Largest over smallest relative deviation at which the elimination ends, usually 10 to 30.
        price: Most that all dropped parameters together may add to the weighted residual, relative. The relative
            deviation of a small parameter is large however sure it is, and the ratio alone would drop it.
    """

    criterion: Literal["pham-gautier", "bic"] = "pham-gautier"
    ratio: float = 30.0
    price: float = 0.003
    name: ClassVar[str] = "essential"
    quick: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.criterion not in ("pham-gautier", "bic"):
            raise EstimationError(f"Unknown criterion {self.criterion!r}.", possible="pham-gautier, bic")
        if not self.ratio >= 1.0:
            raise EstimationError(f"ratio must be at least 1; found {self.ratio!r}.", possible="10 to 30")
        if not self.price >= 0.0:
            raise EstimationError(f"price must be at least 0; found {self.price!r}.", possible="0.003, inf")

    @one_blas_thread
    def estimate(self, problem: EstimationProblem) -> Fit:
        """Estimate the base parameters.

        Raises:
            EstimationError: The data do not determine all of them, from which the elimination sets out.
        """
        full = WeightedLeastSquares().estimate(problem)
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
"""Parameter to drop, from the estimates and their variances of those left, or `None` to end."""


def _eliminate(values: Array, inverse: Array, choose: Choose) -> NDArray[np.intp]:
    """Parameters that are left, shape (k,)."""
    left = np.arange(len(values))
    scale = np.sqrt(np.diag(inverse))
    pi, G = values / scale, inverse / np.outer(scale, scale)
    while len(left) > 1:
        k = choose(pi, np.diag(G))
        if k is None:
            break
        stay = np.arange(len(left)) != k
        column = G[stay, k] / G[k, k]
        pi = pi[stay] - column * pi[k]
        G = G[np.ix_(stay, stay)] - column[:, None] * G[k, stay]
        left = left[stay]
    return left


def _least_sure(ratio: float, most: float) -> Choose:
    """The rule of relative deviations, as long as the sum of squares has not risen by more than `most`."""
    spent = 0.0

    def choose(pi: Array, variance: Array) -> int | None:
        nonlocal spent
        sure = np.abs(pi) / np.sqrt(variance)  # one over the relative deviation
        k = int(np.argmin(sure))
        spent += sure[k] ** 2
        return k if sure.max() > ratio * sure[k] and spent <= most else None

    return choose


def _cheapest(most: float) -> Choose:
    """The parameter that costs least, if that is less than `most`."""

    def choose(pi: Array, variance: Array) -> int | None:
        rise = pi**2 / variance
        k = int(np.argmin(rise))
        return k if rise[k] < most else None

    return choose


def _correlation(information: Information, full: Fit, inverse: Array) -> float:
    """Tell how many rows say as much as one: variance by the scatter between blocks over that of white residuals."""
    found = block_covariance(information, full.values, full.weights, inverse)
    if found is None:
        return 1.0
    return max(1.0, float(np.median(np.diag(found[0]) / np.diag(inverse))))


def _fit(full: Fit, whole: Information, kept: NDArray[np.intp], cost: float) -> Fit:
    """The estimate of the parameters left, the others zero."""
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
    """Finding about the dropped parameters and the increase of the error."""
    names = f": {', '.join(dropped)}" if dropped else ""
    return Finding(
        "parameters-dropped",
        "info",
        "",
        f"{len(dropped)} of {count} base parameters are held at zero{names}. The weighted residual grows by "
        f"{100.0 * rise:.2g} %; the largest relative deviation is {ratio:.3g} times the smallest.",
    )
