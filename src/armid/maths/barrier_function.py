"""Least squares with log-det terms and cone barriers: value, derivatives and Newton step.

Each matrix of a log-det term depends only on the few variables of its own body, so its contribution to the Hessian is
a small block. The contribution of the least-squares part is constant. A square root of the Hessian is computed only
if the normal equations are inaccurate.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.conic_solver import Cone, symmetric

LOST = 1e-3
"""Largest relative difference between two computations of the Newton decrement for which the solution of the normal
equations is accepted; above it, QR is used."""

WHOLE = 0.01
"""Largest relative change of an eigenvalue along a Newton step for which the whole step is taken without line search.
The whole step is then within a hundredth of the best step, and rounding would make a line search meaningless."""

LINE = 40
"""Largest number of function evaluations in one line search; three or four are usual."""


@dataclass(frozen=True, eq=False, slots=True)
class LogDet:
    """Log-det term: weight · (cost · x + constant - log det X) with the symmetric matrix X = matrix · x + offset.

    Attributes:
        matrix: Coefficients of the variables in X, shape (m, m, variables).
        offset: Constant part of X, shape (m, m).
        cost: Linear cost, shape (variables,).
        constant: Constant of the term, a number.
        weight: Weight of the term, positive.
    """

    matrix: Array
    offset: Array
    cost: Array
    constant: float
    weight: float


@dataclass(frozen=True, eq=False, slots=True)
class Smooth:
    """Problem: the objective ½ |A x - y|² + bᵀx + log-det terms, and the cones that constrain x.

    Attributes:
        A: Matrix of the least-squares part, shape (rows, variables).
        y: Right-hand side of the least-squares part, shape (rows,).
        terms: Log-det terms that are added to the objective.
        cones: Cones that constrain x, of the kinds `nonnegative` and `semidefinite`.
        cost: Linear cost b, shape (variables,).
    """

    A: Array
    y: Array
    terms: tuple[LogDet, ...]
    cones: tuple[Cone, ...]
    cost: Array

    def objective(self, x: Array) -> float:
        """Objective at x; infinite if a matrix of a log-det term is not positive definite."""
        value = 0.5 * float(np.sum((self.A @ x - self.y) ** 2)) + float(self.cost @ x)
        for term in self.terms:
            eigenvalues = np.linalg.eigvalsh(term.matrix @ x + term.offset)
            if eigenvalues[0] <= 0.0:
                return float("inf")
            value += term.weight * (float(term.cost @ x) + term.constant - float(np.log(eigenvalues).sum()))
        return value


@dataclass(frozen=True, eq=False, slots=True)
class _Group:
    """Group of g matrices X of the same order m, each an affine function of only a few of the variables.

    Attributes:
        flat: Derivatives of the m² entries of each matrix with respect to its s variables, shape (g, m², s).
        columns: Indices of the s variables of each matrix, shape (g, s).
        offsets: Constant parts of the matrices, shape (g, m, m).
        weights: Weights of the log-determinants, zero for cones, shape (g,).
        variables: Number of all variables.
    """

    flat: Array
    columns: NDArray[np.intp]
    offsets: Array
    weights: Array
    variables: int

    @classmethod
    def of(cls, found: Sequence[tuple[Array, Array, float]], variables: int) -> _Group:
        """Creates the group from matrices of coefficients (m, m, variables) with offsets (m, m) and weights."""
        flat = np.stack([matrix.reshape(-1, variables) for matrix, _, _ in found])
        moves = flat.any(axis=1)
        most = int(moves.sum(axis=1).max())
        columns = np.argsort(~moves, axis=1, kind="stable")[:, :most]
        offsets, weights = np.stack([o for _, o, _ in found]), np.array([w for *_, w in found])
        return cls(np.take_along_axis(flat, columns[:, None], 2), columns, offsets, weights, variables)

    def matrices(self, x: Array) -> Array:
        """Values of the symmetric matrices of the group, shape (g, m, m), for the variables x."""
        return self.along(self.flat, x).reshape(self.offsets.shape) + self.offsets

    def along(self, entries: Array, d: Array) -> Array:
        """Change of the matrix entries, shape (g, m²), along a direction d of the variables.

        `entries` are the derivatives of the matrix entries with respect to the variables of each matrix, shape (g,
        m², s).
        """
        return (entries @ d[self.columns][:, :, None])[:, :, 0]

    def whitened(self, x: Array) -> Array:
        """Derivatives of the matrix entries (g, m², s) in coordinates in which the matrices at x are identities."""
        half = np.linalg.inv(np.linalg.cholesky(self.matrices(x)))
        both = half[:, :, None, :, None] * half[:, None, :, None, :]
        return both.reshape(len(half), *2 * self.flat.shape[1:2]) @ self.flat

    def gradient(self, white: Array, weights: Array) -> Array:
        """Gradient of the weighted log-determinants, shape (variables,)."""
        traces = white[:, :: self.offsets.shape[1] + 1].sum(axis=1)
        return self._summed(self.columns, weights[:, None] * traces, self.variables)

    def hessian(self, white: Array, weights: Array) -> Array:
        """Negative Hessian of the weighted log-determinants, shape (variables, variables)."""
        squares = weights[:, None, None] * (white.swapaxes(1, 2) @ white)
        places = self.columns[:, :, None] * self.variables + self.columns[:, None]
        return self._summed(places, squares, self.variables**2).reshape(self.variables, self.variables)

    @staticmethod
    def _summed(places: NDArray[np.intp], parts: Array, size: int) -> Array:
        """Sums the numbers `parts` in the entries of the result that `places` gives for them, shape (size,)."""
        return np.bincount(places.ravel(), parts.ravel(), size).astype(np.float64)

    def root(self, white: Array, weights: Array) -> Array:
        """Square root of the negative Hessian of the weighted log-determinants, shape (g m², variables)."""
        dense = np.zeros((*white.shape[:2], self.variables))
        np.put_along_axis(dense, self.columns[:, None], np.sqrt(weights)[:, None, None] * white, 2)
        return dense.reshape(-1, self.variables)


class Barriers:
    """Log-det terms and cone barriers of a problem, grouped by the order of their matrices."""

    def __init__(self, problem: Smooth) -> None:
        self.problem = problem
        variables = problem.A.shape[1]
        rows = [cone for cone in problem.cones if cone.kind == "nonnegative"]
        single = [term for term in problem.terms if len(term.offset) == 1]  # a logarithm needs no eigenvalues
        self.rows = np.concatenate(
            [np.zeros((0, variables)), *(cone.matrix for cone in rows), *(term.matrix[0] for term in single)]
        )
        self.offsets = np.concatenate(
            [np.zeros(0), *(cone.offset for cone in rows), *(term.offset[0] for term in single)]
        )
        bounds = sum(len(cone.offset) for cone in rows)
        self.row_weights = np.concatenate([np.zeros(bounds), [term.weight for term in single]])
        found = [(term.matrix, term.offset, term.weight) for term in problem.terms if len(term.offset) > 1]
        found += [
            (np.moveaxis(symmetric(cone.matrix.T), 0, 2), symmetric(cone.offset), 0.0)
            for cone in problem.cones
            if cone.kind == "semidefinite"
        ]
        self.groups = [
            _Group.of([each for each in found if len(each[1]) == order], variables)
            for order in sorted({len(offset) for _, offset, _ in found})
        ]
        self.gram: Array = problem.A.T @ problem.A
        self.parameters = bounds + sum(len(offset) for _, offset, weight in found if weight == 0.0)
        self.orders = len(self.offsets) + sum(len(offset) for _, offset, _ in found)
        self.costs = np.array([term.cost for term in problem.terms]).reshape(-1, variables)
        self.weights = np.array([term.weight for term in problem.terms])

    def objective(self, x: Array) -> float:
        """Objective at a point strictly inside all cones, without the barriers of the cones."""
        p = self.problem
        constant = sum(term.weight * term.constant for term in p.terms)
        value = 0.5 * float(np.sum((p.A @ x - p.y) ** 2)) + float(p.cost @ x) + constant
        value += float(self.weights @ (self.costs @ x))
        counted = self.row_weights > 0.0
        value -= float(self.row_weights[counted] @ np.log(self.rows[counted] @ x + self.offsets[counted]))
        for group in self.groups:
            if group.weights.any():
                value -= float(group.weights @ np.linalg.slogdet(group.matrices(x))[1])
        return value

    def inside(self, x: Array) -> bool:
        """Checks whether x lies strictly inside all cones and log-det terms (positive definite matrices)."""
        if not (np.isfinite(x).all() and (self.rows @ x + self.offsets > 0.0).all()):
            return False
        try:
            for group in self.groups:
                np.linalg.cholesky(group.matrices(x))
        except np.linalg.LinAlgError:
            return False
        return True

    def step(self, x: Array, mu: float, centred: float) -> tuple[Array, float]:
        """Newton step after a line search, and the squared Newton decrement of the full step.

        Args:
            x: Point strictly inside all cones, shape (variables,).
            mu: Weight μ of the barriers.
            centred: Weight of the barriers in the Hessian: `mu`, or the larger weight for which x is the minimum.
                With this larger weight, the step follows the central path, on which the distance from the boundary
                decreases with the weight. With `mu` in the Hessian, the first step after a decrease of `mu` would
                reach the boundary.
        """
        p = self.problem
        slack = self.rows @ x + self.offsets
        size = np.maximum(self.row_weights, mu)
        gradient = p.A.T @ (p.A @ x - p.y) + p.cost + np.maximum(self.weights, mu) @ self.costs
        gradient -= self.rows.T @ (size / slack)
        bounded = (np.sqrt(np.maximum(self.row_weights, centred)) / slack)[:, None] * self.rows
        whitened = [group.whitened(x) for group in self.groups]
        hessian = self.gram + bounded.T @ bounded
        for group, white in zip(self.groups, whitened, strict=True):
            gradient -= group.gradient(white, np.maximum(group.weights, mu))
            hessian += group.hessian(white, np.maximum(group.weights, centred))

        def root() -> Array:
            parts = [
                group.root(white, np.maximum(group.weights, centred))
                for group, white in zip(self.groups, whitened, strict=True)
            ]
            return np.concatenate([p.A, bounded, *parts])

        def curvature(d: Array) -> float:
            squares = float(np.sum((p.A @ d) ** 2) + np.sum((bounded @ d) ** 2))
            for group, white in zip(self.groups, whitened, strict=True):
                squares += float(np.maximum(group.weights, centred) @ np.sum(group.along(white, d) ** 2, axis=1))
            return squares

        direction = _newton(hessian, gradient, curvature, root)
        moved = p.A @ direction
        rates, scales = [self.rows @ direction / slack], [size]
        for group, white in zip(self.groups, whitened, strict=True):
            spread = np.linalg.eigvalsh(group.along(white, direction).reshape(group.offsets.shape))
            rates.append(np.asarray(spread, dtype=np.float64).ravel())
            scales.append(np.repeat(np.maximum(group.weights, mu), group.offsets.shape[1]))
        rate, scale = np.concatenate(rates), np.concatenate(scales)
        slope = float(gradient @ direction) + float(scale @ rate)  # without the logarithms
        return direction * _lowest(float(moved @ moved), slope, rate, scale), float(-gradient @ direction)


def _newton(hessian: Array, gradient: Array, curvature: Callable[[Array], float], root: Callable[[], Array]) -> Array:
    """Solves hessian · d = -gradient; if the normal equations are inaccurate, by QR of the square root.

    Args:
        hessian: Product rootᵀ root, shape (variables, variables).
        gradient: Gradient of the objective, shape (variables,).
        curvature: Function that returns |root · d|² for a direction d.
        root: Function that returns the square root of the Hessian, shape (rows, variables).
    """
    size = 1.0 / np.sqrt(np.maximum(np.diag(hessian), np.finfo(np.float64).tiny))
    side = -size * gradient
    with contextlib.suppress(np.linalg.LinAlgError):
        found = size * np.linalg.solve(size[:, None] * hessian * size, side)
        along = float(-gradient @ found)
        if abs(curvature(found) - along) <= LOST * abs(along):
            return found
    scaled = root() * size
    R: Any = np.linalg.qr(scaled, mode="r")
    R[np.diag_indices(len(R))] += np.where(np.diag(R) == 0.0, np.finfo(np.float64).eps, 0.0)
    found = np.zeros_like(side)
    for _ in range(3):  # semi-normal equations, refined
        rest = side - scaled.T @ (scaled @ found)
        found += np.linalg.solve(R, np.linalg.solve(R.T, rest))
    return size * found


def _lowest(square: float, slope: float, rate: Array, scale: Array) -> float:
    """Step length α > 0 that minimises the convex function ½ square α² + slope α - Σ scale log(1 + rate α).

    It is found by Newton's method within a bracket. A step of a fixed share of the distance to the boundary, without
    line search, could make eigenvalues very small although they are large at the minimum. These eigenvalues would
    then grow only by a factor of two in each step.
    """
    if np.abs(rate).max(initial=0.0) <= WHOLE:
        return 1.0
    low, high = 0.0, 1.0 / max(-float(rate.min(initial=0.0)), 1e-300)
    alpha = min(1.0, 0.5 * high)
    for _ in range(LINE):
        part = rate / (1.0 + rate * alpha)
        first = square * alpha + slope - float(scale @ part)
        if first > 0.0:
            high = alpha
        else:
            low = alpha
        move = first / (square + float(scale @ part**2))
        alpha -= move
        if not low < alpha < high:
            alpha = 0.5 * (low + high) if high < 1e299 else 2.0 * low
        if abs(move) <= 0.01 * alpha:
            break
    return alpha
