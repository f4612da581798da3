"""Weighted least squares on the factors: solution, deviations, residuals, rank.

minimise Σ_j w_j² |ρ_j - R_j π|²,        cov = (Σ_j w_j² R_jᵀ R_j)⁻¹
"""

from __future__ import annotations

import numpy as np

from armid.errors import EstimationError
from armid.estimation.fit import Fit
from armid.estimation.uncertainty import block_covariance
from armid.information.information import Information, stack, total
from armid.maths.linalg import condition, null_directions, scaled_condition, unit_columns
from armid.values import Array

__all__ = ["Solution", "fit_of", "residual_deviation", "solve"]

NAMED = 4
"""Parameters named for each direction that the data do not see."""


class Solution:
    """Least-squares solution for one set of weights.

    Attributes:
        values: Estimate, shape (b,).
        inverse: Inverse of the weighted normal equations, shape (b, b).
        squares: Sum of squared residuals of each joint, unweighted, shape (n,).
        spent: Degrees of freedom that each joint's rows spent, summing to b, shape (n,).
        rows: Weighted rows (r, b) of the problem.
    """

    def __init__(self, whole: Information, weights: Array) -> None:
        A, y = stack(whole, weights)
        scaled, length = unit_columns(A)
        self.rows = A
        Q, R = np.linalg.qr(scaled)
        self.values = np.linalg.solve(R, Q.T @ y) / length
        half = np.linalg.inv(R) / length[:, None]
        self.inverse = half @ half.T
        self.squares = np.empty(whole.n)
        self.spent = np.empty(whole.n)
        for j, joint in enumerate(whole.joints):
            rows, side = joint.R[0, :, :-1], joint.R[0, :, -1]
            self.squares[j] = np.sum((side - rows @ self.values[joint.parameters]) ** 2)
            inner = self.inverse[np.ix_(joint.parameters, joint.parameters)]
            self.spent[j] = weights[j] ** 2 * np.einsum("ri,ij,rj->", rows, inner, rows)


def solve(information: Information, weights: Array) -> Solution:
    """Solve, after making sure that the data see every parameter.

    Args:
        information: Any number of blocks.
        weights: Weight of each joint's rows, shape (n,).

    Raises:
        EstimationError: Fewer rows than parameters, or directions that the data do not see; both named.
    """
    whole = total(information)
    _require_rank(whole)
    return Solution(whole, weights)


def residual_deviation(solution: Solution, information: Information) -> Array:
    """Standard deviation of each joint's residual, degrees of freedom paid, shape (n,)."""
    rows = information.rows.sum(axis=0)
    free = np.maximum(rows - solution.spent, 1.0)
    return np.sqrt(solution.squares / free)


def fit_of(information: Information, solution: Solution, weights: Array, white: Array) -> Fit:
    """The estimate with its deviations and covariance.

    Args:
        information: Any number of blocks.
        solution: Solution for these weights.
        weights: Weight of each joint's rows, shape (n,).
        white: Covariance as if residuals were white, shape (b, b).
    """
    rows = information.rows.sum(axis=0)
    blocks = block_covariance(information, solution.values, weights, solution.inverse)
    unweighted = stack(total(information))[0]
    if blocks is None:
        covariance, kind, freedom = white, "white", max(float(rows.sum()) - len(solution.values), 1.0)
    else:
        (covariance, freedom), kind = blocks, "block"
    return Fit(
        information.names,
        solution.values,
        np.sqrt(np.diag(white)),
        covariance,
        kind,
        freedom,
        np.sqrt(solution.squares / np.maximum(rows, 1)),
        rows,
        condition(unweighted),
        scaled_condition(unweighted),
    )


def _require_rank(whole: Information) -> None:
    """Refuse data that leave directions of the parameters unseen, and name these."""
    A = stack(whole)[0]
    rows = int(whole.rows.sum())
    if rows < whole.count:
        raise EstimationError(
            f"{rows} rows cannot determine {whole.count} base parameters.",
            remedy="record longer, trim or mask less, or leave torque terms out.",
        )
    directions = null_directions(A)
    if not len(directions):
        return
    texts: list[str] = []
    for direction in directions[:NAMED]:
        largest = np.argsort(-np.abs(direction))[:NAMED]
        parts = [whole.names[k] for k in largest if abs(direction[k]) > 0.1 * abs(direction[largest[0]])]
        texts.append(" with ".join(parts))
    more = f" and {len(directions) - NAMED} more" if len(directions) > NAMED else ""
    raise EstimationError(
        f"The data determine {whole.count - len(directions)} of {whole.count} base parameters; they do not see "
        f"{'; '.join(texts)}{more}.",
        remedy="record a motion that moves the joints of these parameters, or lock joints or leave terms out.",
    )
