"""How uncertain an estimate is, from the factors alone.

Residuals of filtered recordings are correlated over many rows, and an interval made as if they were white covers a
third of what it says. Blocks of rows repair that: with s_k the gradient of the squared residual over block k,
cov = H⁻¹ (Σ_k s_k s_kᵀ) H⁻¹ holds whatever the correlation inside a block, and between joints [Liang1986].
"""

from __future__ import annotations

import numpy as np

from armid.information.information import Information
from armid.values import Array

__all__ = ["FEWEST_BLOCKS", "block_covariance", "intervals"]

FEWEST_BLOCKS = 8
"""With fewer blocks their scatter is too rough a measure; the white covariance is used instead."""


def block_covariance(
    information: Information, values: Array, weights: Array, inverse: Array
) -> tuple[Array, float] | None:
    """Covariance (b, b) from the scatter between blocks, and its degrees of freedom.

    Args:
        information: Factors, one set a block.
        values: Estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        inverse: H⁻¹ of the weighted normal equations, shape (b, b).

    Returns:
        `None` where there are too few blocks.
    """
    blocks = information.blocks
    if blocks < FEWEST_BLOCKS:
        return None
    gradients = np.zeros((blocks, len(values)))
    for weight, joint in zip(weights, information.joints, strict=True):
        A, y = joint.R[:, :, :-1], joint.R[:, :, -1]
        residual = y - A @ values[joint.parameters]
        gradients[:, joint.parameters] += weight**2 * np.einsum("kri,kr->ki", A, residual)
    scatter = gradients.T @ gradients * blocks / (blocks - 1)
    return inverse @ scatter @ inverse, float(blocks - 1)


def intervals(values: Array, covariance: Array, freedom: float, level: float = 0.95) -> Array:
    """Lower and upper ends (b, 2) of Student's intervals."""
    from scipy.special import stdtrit  # a third of a second to import

    half = stdtrit(freedom, 0.5 + 0.5 * level) * np.sqrt(np.diag(covariance))
    return np.stack([values - half, values + half], axis=1)
