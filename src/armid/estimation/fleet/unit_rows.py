"""Rows of one unit of a fleet, made from its triangular factors: own unknowns first, then the shared parameters.

The torque of joint j of a unit is κ_j (R_j π) + noise, with the torque scale κ_j of the unit, the triangular factor
R_j and the base parameters π, of which a part is common to all units. At given π and κ, the rows are linear in all
unknowns: the columns of π are multiplied by κ_j, and the column of the scale is the predicted torque R_j π.
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.estimation.fleet.layout import FleetLayout
from armid.information.information import Information
from armid.maths.linalg import triangular_factor

SMALLEST = 1e-10
"""Ratio of a singular value to the largest one, for columns of unit length, below which rows say nothing about a
direction: rounding errors of factors are 1e-15."""


def unit_rows(whole: Information, layout: FleetLayout, weights: Array, values: Array, scale: Array) -> Array:
    """Triangular factor of the weighted rows of a unit, linearised at given values, shape (m + a + 1, m + a + 1).

    The columns are the m own unknowns, the a shared parameters, and the right-hand side.

    Args:
        whole: Information of the unit, all blocks merged.
        layout: Order of the unknowns.
        weights: Weight of the rows of each joint, shape (n,).
        values: Base parameters, shape (b,).
        scale: Torque scale of each joint, shape (n,).
    """
    d, m = len(layout.own), layout.count
    place = np.empty(whole.count, dtype=np.intp)
    place[layout.own] = np.arange(d)
    place[layout.shared] = m + np.arange(len(layout.shared))
    parts: list[Array] = []
    for j, joint in enumerate(whole.joints):
        R, side = joint.R[0, :, :-1], joint.R[0, :, -1]
        predicted = R @ values[joint.parameters]
        rows = np.zeros((len(R), m + len(layout.shared) + 1))
        rows[:, place[joint.parameters]] = scale[j] * R
        rows[:, d + j] = predicted
        rows[:, -1] = side + (scale[j] - 1.0) * predicted
        parts.append(weights[j] * rows)
    stacked = np.concatenate([*parts, np.zeros((m + len(layout.shared) + 1, m + len(layout.shared) + 1))])
    return triangular_factor(stacked)


def residual_squares(information: Information, values: Array, scale: Array) -> Array:
    """Sum of squared residuals of each joint, shape (n,) [(N·m)² or N²].

    Args:
        information: Information of the unit, in any number of blocks.
        values: Base parameters, shape (b,).
        scale: Torque scale of each joint, shape (n,).
    """
    return np.array(
        [
            np.sum((joint.R[:, :, -1] - factor * (joint.R[:, :, :-1] @ values[joint.parameters])) ** 2)
            for joint, factor in zip(information.joints, scale, strict=True)
        ]
    )


def torque_squares(information: Information) -> Array:
    """Sum of the squared torque of each joint, shape (n,) [(N·m)² or N²]."""
    return np.array([np.sum(joint.R[:, :, -1] ** 2) for joint in information.joints])


def score_squares(information: Information, values: Array, scale: Array) -> tuple[Array, Array]:
    """Squares of the gradients of the blocks of each joint, and their number, shape (n,) each.

    In the orthonormal basis of the columns, the gradient of a block has the expected square σ² r_k, if residuals are
    uncorrelated with the variance σ² and r_k is the share of the block in the rank r. The sum of both results over
    the units of a fleet gives the number of rows that count as one independent sample. The squares are corrected for
    the fit, which makes the sum of the gradients zero.

    Args:
        information: Blocks of the unit, in the order of time.
        values: Base parameters, shape (b,).
        scale: Torque scale of each joint, shape (n,).
    """
    squares, ranks = np.zeros(information.n), np.zeros(information.n)
    used = np.flatnonzero(information.rows.any(axis=1))
    blocks = len(used)
    if blocks < 2:
        return squares, ranks
    for j, (joint, factor) in enumerate(zip(information.joints, scale, strict=True)):
        R = joint.R[used]
        residual = R[:, :, -1] - factor * (R[:, :, :-1] @ values[joint.parameters])
        columns = R[:, :, :-1].reshape(-1, R.shape[2] - 1)
        length = np.linalg.norm(columns, axis=0)
        U, size, _ = np.linalg.svd(columns / np.where(length > 0.0, length, 1.0), full_matrices=False)
        U = U[:, size > SMALLEST * max(float(size.max(initial=0.0)), 1.0)]
        gradients = np.einsum("brk,br->bk", U.reshape(blocks, R.shape[1], -1), residual)
        squares[j] = np.sum(gradients**2) * blocks / (blocks - 1)
        ranks[j] = U.shape[1]
    return squares, ranks
