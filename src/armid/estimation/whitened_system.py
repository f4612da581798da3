"""Data as one block of whitened rows, which exists even if the data do not determine all parameters.

The weight of each joint is that of weighted least squares without constraints: one divided by the standard deviation
of its residual. Constraints and priors increase the residual of some joints. If the weights were computed from this
larger residual, the increase would count as noise and reduce the weight of these joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.information.information import Information, stack, total
from armid.maths.linalg import RANK_TOLERANCE, orthonormal, unit_columns
from armid.remedy import Remedy, setting

ITERATIONS = 1000
STANDSTILL = 1e-6
"""Largest relative change of a standard deviation at which the iteration ends; it changes any parameter by about 1e-5
standard deviations."""

RESOLUTION = 1e-7
"""Lower limit of the ratio of noise to torque: half of the digits of double precision."""


@dataclass(frozen=True, eq=False, slots=True)
class WhitenedSystem:
    """Data as whitened rows: the cost of parameters π is larger than the minimum by ½ |rows · (π - values)|².

    Attributes:
        whole: The information, all blocks merged into one.
        weights: Weight of each joint's rows, one divided by the standard deviation of its residual, shape (n,).
        rows: Triangular factor of the weighted rows, shape (k, b) with k at most b.
        values: Least-squares parameters, shape (b,). If they are not unique, the ones with the smallest norm are
            given; for this norm each parameter is multiplied by the length of its weighted column.
        inverse: Pseudo-inverse of rowsᵀ rows, shape (b, b).
        unseen: Directions of the parameters that do not change the residual, shape (m, b); m is 0 at full rank.
        squares: Sum of the squared residuals of each joint at `values`, unweighted, shape (n,).
        effective_dof: Sum of the leverages of the rows of each joint, shape (n,): number of degrees of freedom that
            the fit uses.
        correlation: Number of consecutive rows that contain as much information as one independent row, from the
            scatter between blocks; at least 1.
    """

    whole: Information
    weights: Array
    rows: Array
    values: Array
    inverse: Array
    unseen: Array
    squares: Array
    effective_dof: Array
    correlation: float

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the residuals.

        With the converged weights, the weighted sum of squared residuals has the same value except for rounding.
        """
        return max(float(self.whole.rows[0].sum() - self.effective_dof.sum()), 1.0)


def whiten(
    information: Information,
    *,
    plain: bool = False,
    resolution: float = RESOLUTION,
    noise: Sequence[float] | None = None,
) -> WhitenedSystem:
    """Whitens data with the weights of weighted least squares, which are iterated until they converge.

    Args:
        information: Any number of blocks.
        plain: True to give all joints the same weight, computed from the residual of all rows, as in ordinary least
            squares.
        resolution: Lower limit of the ratio of noise to torque.
        noise: Standard deviation of each joint's noise, from which the weights are computed without iteration.

    Raises:
        EstimationError: No row is in use, the weights do not converge, or `noise` is not one number for each joint.
    """
    whole = total(information)
    rows = whole.rows[0]
    if not rows.any():
        raise EstimationError(
            "No row of the recordings is used.",
            remedy="leave out fewer rows (keys `trim`, `exclude` and `standstill`).",
        )
    torque = np.array([np.linalg.norm(joint.R[0, :, -1]) for joint in whole.joints])
    floor = resolution * torque / np.sqrt(np.maximum(rows, 1))
    floor[torque == 0.0] = 1.0  # a joint of which no row counts, or that never carried torque; any weight will do
    deviation = np.maximum(_given(noise, whole.n) if noise else torque / np.sqrt(np.maximum(rows, 1)), floor)
    A, y = stack(whole)
    joint = np.concatenate([np.full(len(each.R[0]), j) for j, each in enumerate(whole.joints)])
    for _ in range(ITERATIONS):
        weight = (1.0 / deviation)[joint]
        values, half, unseen = minimum_norm_solution(weight[:, None] * A, weight * y)
        left = np.bincount(joint, (y - A @ values) ** 2, whole.n).astype(np.float64)
        spent = np.bincount(joint, np.sum((weight[:, None] * (A @ half)) ** 2, axis=1), whole.n).astype(np.float64)
        updated = np.maximum(np.sqrt(left / np.maximum(rows - spent, 1.0)), floor)
        if plain:
            updated = np.full(
                whole.n, max(np.sqrt(left.sum() / max(rows.sum() - spent.sum(), 1.0)), floor[rows > 0].min())
            )
        settled = bool(noise) or bool((np.abs(updated - deviation) <= STANDSTILL * deviation + floor).all())
        if settled:
            triangle: Any = np.linalg.qr(weight[:, None] * A, mode="r")
            inverse = half @ half.T
            correlation = _correlation(information, 1.0 / deviation, values, half)
            return WhitenedSystem(whole, 1.0 / deviation, triangle, values, inverse, unseen, left, spent, correlation)
        deviation = updated
    raise EstimationError(
        f"The weights of the joints did not converge in {ITERATIONS} iterations.",
        remedy=Remedy("use ", setting("method", "ols"), " and inspect the residual of each joint."),
    )


def _given(noise: Sequence[float], joints: int) -> Array:
    """Checks standard deviations of the joints' noise that a user or a friction selection gives; shape (n,)."""
    if len(noise) != joints:
        raise EstimationError(
            f"The option `noise` needs one standard deviation for each of the {joints} joints; found {len(noise)}.",
            remedy="give a number for each joint, or leave the option out.",
        )
    return np.array(noise, dtype=np.float64)


def noise_option(noise: Sequence[float]) -> tuple[float, ...]:
    """Checks the option `noise` of an estimator and returns it as a tuple.

    Raises:
        EstimationError: The option is no list of positive numbers.
    """
    if not isinstance(noise, list | tuple) or not all(0.0 < each < np.inf for each in noise):
        raise EstimationError(
            f"The option `noise` must list positive standard deviations, one for each joint; found {noise!r}.",
            remedy="give a list of numbers in N·m, or leave the option out.",
        )
    return tuple(float(each) for each in noise)


def rows_of(information: Information, weights: Array) -> tuple[Array, Array]:
    """Triangular whitened rows (k, b) of all blocks of `information`, and their right-hand side (k,)."""
    A, y = stack(total(information), weights)
    R: Any = np.linalg.qr(np.column_stack([A, y]), mode="r")[: A.shape[1]]
    return R[:, :-1], R[:, -1]


def minimum_norm_solution(A: Array, y: Array) -> tuple[Array, Array, Array]:
    """Least-squares solution of A x = y with the smallest norm.

    Returns:
        Solution (b,), square root (b, k) of the pseudo-inverse of AᵀA, and the m undetermined directions (m, b).
    """
    scaled, length = unit_columns(A)
    clear = orthonormal(scaled)
    if clear is not None:
        Q, _, half = clear
        return half @ (Q.T @ y) / length, half / length[:, None], np.zeros((0, A.shape[1]))
    U, s, V = np.linalg.svd(scaled, full_matrices=True)
    seen = int(np.count_nonzero(s > RANK_TOLERANCE * max(float(s[0]), 1.0)))
    half = V[:seen].T / s[:seen]
    return half @ (U[:, :seen].T @ y) / length, half / length[:, None], V[seen:] / length


def _correlation(information: Information, weights: Array, values: Array, half: Array) -> float:
    """Variance of the gradients of the blocks, divided by their variance for white residuals.

    The result is 1 if there are too few blocks.

    Residuals that are correlated over many rows increase the variance of the gradients. The number of blocks is
    small, and the estimate was computed from the same blocks, so the result is more often too small than too large.
    It is used only as the unit of the weight of a prior.

    Args:
        information: Factors of the blocks.
        weights: Weight of each joint's rows, shape (n,).
        values: Estimate, shape (b,).
        half: Square root of the pseudo-inverse of the normal matrix, shape (b, k).
    """
    used = np.flatnonzero(information.rows.any(axis=1))
    if len(used) < 4:
        return 1.0
    pull = np.zeros((len(used), len(values)))
    for weight, joint in zip(weights, information.joints, strict=True):
        R = weight * joint.R[used]
        residual = R[:, :, -1] - R[:, :, :-1] @ values[joint.parameters]
        pull[:, joint.parameters] += (residual[:, None] @ R[:, :, :-1])[:, 0]
    return max(float(np.sum((pull @ half) ** 2)) / max(half.shape[1], 1), 1.0)
