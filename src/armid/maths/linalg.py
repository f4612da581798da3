"""Condition number, null space, inverse and square root of matrices."""

from __future__ import annotations

import contextlib

import numpy as np

from armid.checked_array import Array

LEAST = 1e-15
"""Ratio of an eigenvalue to the largest eigenvalue below which it is a rounding error, after scaling of the matrix to
unit diagonal."""

FAR_FROM_LEAST = 1e5
"""Largest absolute entry of the inverse Cholesky factor of a matrix with unit diagonal for which all its eigenvalues
are certainly above `LEAST`."""

CLEAR = 1e6
"""Largest absolute entry of the inverse of a triangular factor, whose columns have unit length, for which the rank is
certainly full."""

RANK_TOLERANCE = 1e-10
"""Ratio of the smallest to the largest singular value of a matrix with columns of unit length below which its rank
counts as deficient. Rounding errors of the factors are 1e-15. For ratios between 1e-15 and this limit, no digit of
the estimate would be correct."""


def unit_columns(A: Array) -> tuple[Array, Array]:
    """Matrix with its columns scaled to unit length, and the lengths before the scaling, shape (b,).

    A zero column is not changed; its length is given as 1.
    """
    length = np.linalg.norm(A, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    return A / length, length


def condition(A: Array) -> float:
    """Condition number: ratio of the largest to the smallest singular value; infinite if the rank is deficient."""
    values = np.linalg.svd(A, compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0.0 and A.shape[0] >= A.shape[1] else float("inf")


def scaled_condition(A: Array) -> float:
    """Condition number of A with columns scaled to unit length; it does not depend on the units of the columns."""
    return condition(unit_columns(A)[0])


def null_directions(A: Array, tolerance: float = RANK_TOLERANCE) -> Array:
    """Orthonormal basis, shape (k, b), of the null space of A with its b columns scaled to unit length.

    A direction belongs to the null space if its singular value is at most `tolerance` times the largest one or 1,
    whichever is larger.
    """
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
    """QR factors Q (rows, b), R (b, b), and R⁻¹, of a matrix A; `None` unless its columns are clearly independent.

    The columns of A must have unit length. The QR factorisation is much faster than a singular value decomposition,
    which the caller needs only if the result is `None`.
    """
    if len(A) < A.shape[1]:
        return None
    Q, R = np.linalg.qr(A)
    # The diagonal of R bounds the rank from above, which is a fast first test.
    if np.abs(np.diag(R)).min(initial=1.0) <= 1.0 / CLEAR:
        return None
    inverse = np.linalg.inv(R)
    return (Q, R, inverse) if np.abs(inverse).max(initial=0.0) < CLEAR else None


def triangular_factor(A: Array) -> Array:
    """Triangular factor R of the QR factorisation A = Q R of a matrix A (rows, b), shape (min(rows, b), b)."""
    return np.asarray(np.linalg.qr(A, mode="r"), dtype=np.float64)


def inverse_of(matrix: Array) -> Array:
    """Inverse of a positive definite matrix; it is symmetric and positive definite in spite of rounding errors."""
    half = half_of(matrix)
    return half @ half.T


def half_of(matrix: Array) -> Array:
    """Square root h of the inverse of a positive definite matrix: h hᵀ = matrix⁻¹."""
    size = 1.0 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(np.float64).tiny))
    scaled = size[:, None] * (0.5 * (matrix + matrix.T)) * size
    with contextlib.suppress(np.linalg.LinAlgError):
        half = np.linalg.inv(np.linalg.cholesky(scaled)).T
        if np.abs(half).max(initial=0.0) < FAR_FROM_LEAST:
            return size[:, None] * half
    values, vectors = np.linalg.eigh(scaled)
    return size[:, None] * vectors / np.sqrt(np.maximum(values, LEAST * values[-1]))


def root_of(covariance: Array) -> Array:
    """Square root r, shape (b, b), of a covariance matrix: covariance = r rᵀ.

    It is computed from the correlation matrix, whose negative eigenvalues are set to zero.
    """
    size = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    return size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
