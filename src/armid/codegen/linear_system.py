"""Symbolic solution of a linear system with a symmetric matrix, by the factorisation L D Lᵀ without square roots."""

from __future__ import annotations

from collections.abc import Sequence

from armid.codegen.graph import Node, Scalar, call


def is_regular(matrix: Sequence[Sequence[Scalar]]) -> bool:
    """True if no diagonal element of a symmetric matrix is identically zero."""
    return all(isinstance(row[i], Node) for i, row in enumerate(matrix))


def solve_symmetric(matrix: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> tuple[list[Scalar], list[Scalar]]:
    """Solution x of A x = b for a symmetric positive definite matrix A, and the n pivots of its factorisation.

    All pivots are positive if and only if A is positive definite.

    Rows are not exchanged, so the solution is exact to rounding only where A is positive definite.

    Args:
        matrix: The matrix A, n rows of n scalars, with diagonal elements that are not always zero; the upper triangle
            is not read.
        right: The vector b, n scalars.
    """
    n = len(right)
    lower: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
    diagonal, inverse = list[Scalar](), list[Scalar]()
    for j in range(n):
        scaled = [lower[j][k] * diagonal[k] for k in range(j)]
        diagonal.append(_reduced(matrix[j][j], lower[j], scaled))
        inverse.append(call("pow", diagonal[j], -1.0))
        for i in range(j + 1, n):
            lower[i][j] = _reduced(matrix[i][j], lower[i], scaled) * inverse[j]
    x = list[Scalar]()
    for i in range(n):
        x.append(_reduced(right[i], lower[i], x))
    x = [value * factor for value, factor in zip(x, inverse, strict=True)]
    for i in reversed(range(n)):
        below = [lower[k][i] for k in range(i + 1, n)]
        x[i] = _reduced(x[i], below, x[i + 1 :])
    return x, diagonal


def _reduced(start: Scalar, row: Sequence[Scalar], values: Sequence[Scalar]) -> Scalar:
    """Scalar `start` minus the product of the given values with as many first elements of a row."""
    for a, b in zip(row, values, strict=False):
        start = start - a * b
    return start
