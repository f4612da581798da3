"""How uncertain an estimate is, from the factors alone.

Residuals of filtered recordings are correlated over many rows, and an interval made as if they were white covers a
third of what it says. Blocks of rows repair that, whatever the correlation inside a block and between joints. The
estimate without block k differs from the estimate by

    Δ_k = (H - H_k)⁻¹ s_k,        s_k = Σ_j w_j² R_jkᵀ (ρ_jk - R_jk π),

and the jackknife cov = (B - 1) / B Σ_k (Δ_k - mean)(Δ_k - mean)ᵀ stays honest with few blocks and many parameters.
There the plain sandwich H⁻¹ Σ s_k s_kᵀ H⁻¹ is too small: a block pulls the estimate towards itself [Bell2002].
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.estimation.fit import Fit
from armid.information.information import Information, stack, total
from armid.maths.linalg import unit_columns
from armid.values import Array

__all__ = ["FEWEST_BLOCKS", "block_covariance", "cover", "scale_covariance"]

FEWEST_BLOCKS = 4
"""With fewer blocks their scatter says next to nothing (three degrees of freedom); the white covariance is used."""

RIDGE = 1e-12
"""Added to the diagonal of H - H_k, relative: a block that alone shows a direction then gives a huge variance."""

TOGETHER = 32
"""Blocks solved for at a time: a few megabytes."""


def cover(fit: Fit, information: Information) -> Fit:
    """The fit with a covariance whose intervals cover: from the scatter between blocks, where there are enough.

    Args:
        fit: As the estimator gave it.
        information: What it was made from, blocks apart.
    """
    whole = total(information)
    A, length = unit_columns(stack(whole, fit.weights)[0])
    inverse = np.linalg.inv(A.T @ A) / np.outer(length, length)
    found = block_covariance(information, fit.values, fit.weights, inverse)
    if found is None:
        return fit
    covariance = found[0] + scale_covariance(whole, fit.weights, inverse)
    return replace(fit, covariance=covariance, covariance_kind="block", freedom=found[1])


def block_covariance(
    information: Information, values: Array, weights: Array, inverse: Array
) -> tuple[Array, float] | None:
    """Jackknife covariance (b, b) over blocks, and its degrees of freedom.

    Args:
        information: Factors, one set a block.
        values: Estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        inverse: H⁻¹ of the weighted normal equations, shape (b, b).

    Returns:
        `None` where there are too few blocks with rows that count.
    """
    used = np.flatnonzero(information.rows.any(axis=1))
    if len(used) < FEWEST_BLOCKS:
        return None
    scale = 1.0 / np.sqrt(np.diag(inverse))  # of the size of the columns, whatever their units
    whole = np.asarray(np.linalg.inv(inverse * np.outer(scale, scale)), dtype=np.float64)
    whole[np.diag_indices(len(values))] *= 1.0 + RIDGE
    parts = [used[k : k + TOGETHER] for k in range(0, len(used), TOGETHER)]
    change = np.concatenate([_without(information, part, values, weights, whole, scale) for part in parts])
    change -= change.mean(axis=0)
    blocks = len(used)
    return change.T @ change * (blocks - 1) / blocks, float(blocks - 1)


def _without(
    information: Information,
    blocks: NDArray[np.intp],
    values: Array,
    weights: Array,
    whole: Array,
    scale: Array,
) -> Array:
    """How the estimate changes where each of some blocks is left out, shape (blocks, b)."""
    left = np.repeat(whole[None], len(blocks), axis=0)
    gradient = np.zeros((len(blocks), len(values)))
    for weight, joint in zip(weights, information.joints, strict=True):
        own = joint.parameters
        R = joint.R[blocks]
        residual = weight * (R[:, :, -1] - R[:, :, :-1] @ values[own])
        scaled = np.ascontiguousarray((weight * R[:, :, :-1] / scale[own]).transpose(0, 2, 1))
        left[:, own[:, None], own] -= scaled @ scaled.transpose(0, 2, 1)
        gradient[:, own] += (scaled @ residual[:, :, None])[:, :, 0]
    return np.linalg.solve(left, gradient[:, :, None])[:, :, 0] / scale


def scale_covariance(whole: Information, weights: Array, inverse: Array) -> Array:
    """What uncertain scales of the joints' torques, such as drive gains, add to the covariance (b, b).

    With torque j off by a factor 1 + δ_j, the estimate moves by δ_j H⁻¹ w_j² R_jᵀ ρ_j; the δ_j are independent.
    """
    covariance = np.zeros_like(inverse)
    for j in np.flatnonzero(whole.scale_deviation):
        only = np.where(np.arange(whole.n) == j, weights, 0.0)
        A, y = stack(whole, only)
        move = inverse @ (A.T @ y)
        covariance += whole.scale_deviation[j] ** 2 * np.outer(move, move)
    return covariance
