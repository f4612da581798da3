"""Weighted least squares computed from triangular factors: solution, standard deviations, residuals, rank.

minimise Σ_j w_j² |ρ_j - R_j π|²,        cov = (Σ_j w_j² R_jᵀ R_j)⁻¹

Here w_j is the weight of joint j, R_j its triangular factor, ρ_j the right-hand side and π the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.fit_result import Fit
from armid.estimation.uncertainty.scale_covariance import scale_covariance
from armid.information.information import Information, stack, total
from armid.maths.linalg import condition, null_directions, scaled_condition, unit_columns

NAMED = 0.01
"""Entry of an undetermined direction, divided by the largest entry of this direction, above which the error message
names the parameter of the entry. The parameters are scaled to columns of unit length."""


class Solution:
    """Least-squares solution for one set of weights.

    Attributes:
        values: Estimate, shape (b,).
        inverse: Inverse of the weighted normal matrix, shape (b, b).
        squares: Sum of squared residuals of each joint, unweighted, shape (n,).
        effective_dof: Sum of the leverages of the rows of each joint, shape (n,): number of degrees of freedom that
            the fit uses. The sum over all joints is b.
        whole: The information, all blocks merged into one.
    """

    def __init__(self, whole: Information, weights: Array) -> None:
        A, y = stack(whole, weights)
        scaled, length = unit_columns(A)
        self.whole = whole
        factor = kernel.factor_columns(np.column_stack([scaled, y]).T)[0]
        R, side = factor[:-1, :-1], factor[:-1, -1]
        self.values = np.linalg.solve(R, side) / length
        half = np.linalg.inv(R) / length[:, None]
        self.inverse = half @ half.T
        self.squares = np.empty(whole.n)
        self.effective_dof = np.empty(whole.n)
        for j, joint in enumerate(whole.joints):
            rows, side = joint.R[0, :, :-1], joint.R[0, :, -1]
            self.squares[j] = np.sum((side - rows @ self.values[joint.parameters]) ** 2)
            inner = self.inverse[np.ix_(joint.parameters, joint.parameters)]
            self.effective_dof[j] = weights[j] ** 2 * np.sum((rows @ inner) * rows)


def solve(information: Information, weights: Array) -> Solution:
    """Solves the least-squares problem if the data determine every parameter.

    Args:
        information: Factors, in any number of blocks.
        weights: Weight of the rows of each joint, shape (n,).

    Raises:
        EstimationError: There are fewer rows than parameters, or the data do not determine some parameters.
    """
    whole = total(information)
    require_rank(whole)
    return Solution(whole, weights)


def residual_deviation(solution: Solution, information: Information) -> Array:
    """Standard deviation of each joint's residual, corrected for the degrees of freedom, shape (n,)."""
    rows = information.rows.sum(axis=0)
    free = np.maximum(rows - solution.effective_dof, 1.0)
    return np.sqrt(solution.squares / free)


def fit_of(solution: Solution, weights: Array, white: Array) -> Fit:
    """Makes the fit of a solution, with the standard deviations for white residuals.

    Args:
        solution: Solution for these weights.
        weights: Weight of each joint's rows, shape (n,).
        white: Covariance for white residuals, shape (b, b).
    """
    whole = solution.whole
    rows = whole.rows[0]
    unweighted = stack(whole)[0]
    return Fit(
        whole.names,
        solution.values,
        np.sqrt(np.diag(white)),
        white + scale_covariance(whole, weights, solution.inverse),
        "white",
        max(float(rows.sum()) - len(solution.values), 1.0),
        np.sqrt(solution.squares / np.maximum(rows, 1)),
        rows,
        condition(unweighted),
        scaled_condition(unweighted),
        weights,
    )


def require_rank(whole: Information) -> None:
    """Raises an error that names undetermined parameters, if the data do not determine all parameters.

    Args:
        whole: Information, all blocks merged into one.

    Raises:
        EstimationError: There are fewer rows than parameters, or the data do not determine some parameters.
    """
    A = stack(whole)[0]
    rows = int(whole.rows.sum())
    if rows < whole.count:
        raise EstimationError(
            f"The recordings have {rows} usable rows, which cannot determine {whole.count} base parameters.",
            remedy="record a longer motion, leave out fewer rows (keys `trim` and `exclude`), or use fewer torque "
            "terms (key `terms`).",
        )
    directions = null_directions(A)
    if not len(directions):
        return
    raise EstimationError(
        f"The data determine only {whole.count - len(directions)} of {whole.count} base parameters; they do not "
        f"determine {'; '.join(_named(directions, whole.names))}.",
        remedy="record a motion that moves the joints of these parameters, lock these joints (--lock), or use "
        "fewer torque terms (key `terms`).",
    )


def _named(directions: Array, names: Sequence[str]) -> list[str]:
    """Texts that name the parameters of k undetermined directions (k, b).

    Single parameters come first, then groups of parameters that the data cannot separate.
    """
    touched = sorted(np.flatnonzero(row).tolist() for row in _reduced(directions))
    parts = [[names[k] for k in part] for part in touched]
    alone = [part[0] for part in parts if len(part) == 1]
    joined = [f"{', '.join(part[:-1])} and {part[-1]} separately" for part in parts if len(part) > 1]
    return [", ".join(alone), *joined] if alone else joined


def _reduced(directions: Array) -> Array:
    """Row echelon form of `directions` (k, b): it spans the same space and has few nonzero entries."""
    rows = directions.copy()
    done = 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        pivot = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[pivot, column]) <= NAMED:
            continue
        rows[[done, pivot]] = rows[[pivot, done]]
        rows[done] /= rows[done, column]
        others = np.arange(len(rows)) != done
        rows[others] -= np.outer(rows[others, column], rows[done])
        done += 1
    return np.where(np.abs(rows) > NAMED * np.abs(rows).max(axis=1, keepdims=True), rows, 0.0)
