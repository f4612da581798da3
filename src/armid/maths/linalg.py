"""Condition numbers, rank and covariance from tall or triangular matrices."""

from __future__ import annotations

import contextlib

import numpy as np

from armid.values import Array

LEAST = 1e-15
"""Ratio of an eigenvalue to the largest one, rows and columns scaled, below which it is rounding."""

FAR_FROM_LEAST = 1e5
"""Largest entry of the inverse Cholesky factor for which all eigenvalues are well above `LEAST`."""

CLEAR = 1e6
"""Largest entry of the inverse of a triangular factor with columns of unit length for which the rank is full."""

RANK_TOLERANCE = 1e-10
"""Ratio of singular values of unit columns below which the rank counts as deficient. Rounding of the factors is
1e-15; with ratios between the two, no digit of the estimate would be right."""


def unit_columns(A: Array) -> tuple[Array, Array]:
    """Columns scaled to unit length, and the lengths (b,); zero columns stay zero with length one."""
    length = np.linalg.norm(A, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    return A / length, length


def condition(A: Array) -> float:
    """Condition number: ratio of the largest to the smallest singular value; infinite where the smallest is zero."""
    values = np.linalg.svd(A, compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0.0 and A.shape[0] >= A.shape[1] else float("inf")


def scaled_condition(A: Array) -> float:
    """Condition number with columns scaled to unit length, independent of the units."""
    return condition(unit_columns(A)[0])


def null_directions(A: Array, tolerance: float = RANK_TOLERANCE) -> Array:
    """Null space of A in coordinates scaled to unit columns: directions (k, b) of unit length."""
    scaled, _ = unit_columns(A)
    rows = max(scaled.shape)
    padded = np.zeros((rows, scaled.shape[1]))
    padded[: len(scaled)] = scaled
    values = np.linalg.svd(padded, compute_uv=False)
    unseen = values <= tolerance * max(values[0], 1.0)
    if not unseen.any():  # the usual case; directions take twice the time of the values
        return np.zeros((0, scaled.shape[1]))
    return np.linalg.svd(padded, full_matrices=False)[2][unseen]


def orthonormal(A: Array) -> tuple[Array, Array, Array] | None:
    """Factors Q (rows, b), R (b, b) and R⁻¹ of unit columns A = Q R; `None` unless all are clearly independent.

    This is much faster than singular values, which are needed only in the other case.
    """
    if len(A) < A.shape[1]:
        return None
    Q, R = np.linalg.qr(A)
    # The diagonal of R bounds the rank from above, which is a fast first test.
    if np.abs(np.diag(R)).min(initial=1.0) <= 1.0 / CLEAR:
        return None
    inverse = np.linalg.inv(R)
    return (Q, R, inverse) if np.abs(inverse).max(initial=0.0) < CLEAR else None


def inverse_of(matrix: Array) -> Array:
    """Inverse of a positive definite matrix; rounding of the matrix leaves it symmetric and positive definite."""
    half = half_of(matrix)
    return half @ half.T


def half_of(matrix: Array) -> Array:
    """Square root h of the inverse of a positive definite matrix, h hᵀ = matrix⁻¹."""
    size = 1.0 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(np.float64).tiny))
    scaled = size[:, None] * (0.5 * (matrix + matrix.T)) * size
    with contextlib.suppress(np.linalg.LinAlgError):
        half = np.linalg.inv(np.linalg.cholesky(scaled)).T
        if np.abs(half).max(initial=0.0) < FAR_FROM_LEAST:
            return size[:, None] * half
    values, vectors = np.linalg.eigh(scaled)
    return size[:, None] * vectors / np.sqrt(np.maximum(values, LEAST * values[-1]))


def root_of(covariance: Array) -> Array:
    """Factor r (b, b) of a covariance r rᵀ, from its correlations; negative eigenvalues are set to zero."""
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    return size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
