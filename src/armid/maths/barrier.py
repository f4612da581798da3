"""Least squares with log-det terms over cones: a barrier method that carries its own certificate.

    minimise  ½ |A x - y|² + bᵀx + Σ_i w_i (c_iᵀx + d_i - log det X_i(x))    so that every cone holds

For each μ of a falling sequence Newton's method minimises the same with barriers of weight μ in place of the cones,
and with no w_i smaller than μ: from a start where the log-det terms are small, the path to the data is short. At the
minimum for μ the cones' multipliers μ / s are feasible for the dual, so that the gap is μ times the number of barrier
parameters; what the last Newton step left is added to it [Nesterov1994].
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from armid.errors import EstimationError, UnsolvedError
from armid.maths.cones import ACCEPTED, Cone, symmetric
from armid.values import Array

__all__ = ["LogDet", "Smooth", "SmoothSolution", "minimise"]

SHRINK = (0.01, 0.1)
"""Factors from one weight of the barriers to the next. The first saves a fifth of the time; data that no body
explains may lead it astray, and then the second is tried."""

GAP = 1e-9
"""Gap aimed at, over the size of the objective, at least one: a thousandth of what is accepted."""

STEPS = 200
"""Newton steps for one weight of the barriers before giving up; five to twenty are usual."""

LONGEST = 250
"""Newton steps in all after which no further weight is tried; twenty to a hundred are usual. Where more are needed
the minimum is so far from what the data say, or so flat, that no digits are left to prove it."""

LOST = 1e-3
"""Relative difference of two computations of the decrement above which normal equations are not trusted."""

ROUNDED = 1e-16
"""Step over the size of the unknowns that changes nothing."""

LINE = 40
"""Most evaluations along a step; three or four are usual."""

CENTRED = 1e-3
"""Squared Newton decrement over the barrier's weight at which μ may fall."""

SMALL = 0.5
"""Largest squared decrement over the barrier's weight for which it bounds the distance from the minimum."""

REMEDY = "look for a wrong sign or unit of torque or gravity: no body explains such data; or ask for another prior."
"""What to do where a search fails."""


@dataclass(frozen=True, eq=False, slots=True)
class LogDet:
    """A term weight · (cost · x + constant - log det X) of a symmetric matrix X = matrix · x + offset.

    Attributes:
        matrix: Shape (m, m, variables).
        offset: Shape (m, m).
        cost: Shape (variables,).
        constant: A number.
        weight: Positive.
    """

    matrix: Array
    offset: Array
    cost: Array
    constant: float
    weight: float


@dataclass(frozen=True, eq=False, slots=True)
class Smooth:
    """What is minimised.

    Attributes:
        A: Shape (rows, variables).
        y: Shape (rows,).
        terms: Log-det terms.
        cones: `nonnegative` and `semidefinite` ones.
        cost: b, shape (variables,).
    """

    A: Array
    y: Array
    terms: tuple[LogDet, ...]
    cones: tuple[Cone, ...]
    cost: Array

    def objective(self, x: Array) -> float:
        """Value at x; infinite where a matrix of a log-det term is not positive definite."""
        value = 0.5 * float(np.sum((self.A @ x - self.y) ** 2)) + float(self.cost @ x)
        for term in self.terms:
            eigenvalues = np.linalg.eigvalsh(term.matrix @ x + term.offset)
            if eigenvalues[0] <= 0.0:
                return float("inf")
            value += term.weight * (float(term.cost @ x) + term.constant - float(np.log(eigenvalues).sum()))
        return value


@dataclass(frozen=True, eq=False, slots=True)
class SmoothSolution:
    """Answer, checked.

    Attributes:
        x: The variables, strictly inside every cone.
        objective: Value there.
        gap: By how much the minimum may lie below, over the size of the objective, at least one.
        steps: Newton steps taken.
    """

    x: Array
    objective: float
    gap: float
    steps: int


class _Barriers:
    """All log-det and cone terms, with the matrices of one order side by side."""

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
        self.groups: list[tuple[Array, Array, Array]] = []
        for order in sorted({len(offset) for _, offset, _ in found}):
            group = [each for each in found if len(each[1]) == order]
            flat = np.stack([matrix.reshape(order * order, variables) for matrix, _, _ in group])
            self.groups.append((flat, np.stack([o for _, o, _ in group]), np.array([w for *_, w in group])))
        self.parameters = bounds + sum(len(offset) for _, offset, weight in found if weight == 0.0)
        self.orders = len(self.offsets) + sum(len(offset) for _, offset, _ in found)
        self.costs = np.array([term.cost for term in problem.terms]).reshape(-1, variables)
        self.weights = np.array([term.weight for term in problem.terms])
        self.constant = sum(term.weight * term.constant for term in problem.terms)

    def objective(self, x: Array) -> float:
        """What is minimised, without the cones' barriers, at a point inside."""
        p = self.problem
        value = 0.5 * float(np.sum((p.A @ x - p.y) ** 2)) + float(p.cost @ x) + self.constant
        value += float(self.weights @ (self.costs @ x))
        counted = self.row_weights > 0.0
        value -= float(self.row_weights[counted] @ np.log(self.rows[counted] @ x + self.offsets[counted]))
        for matrix, (_, _, weight) in zip(self.matrices(x), self.groups, strict=True):
            if weight.any():
                value -= float(weight @ np.linalg.slogdet(matrix)[1])
        return value

    def matrices(self, x: Array) -> list[Array]:
        """Symmetric matrices (g, m, m) of each group at x."""
        return [(flat @ x).reshape(offset.shape) + offset for flat, offset, _ in self.groups]

    def inside(self, x: Array) -> bool:
        """Whether x lies strictly inside."""
        if not (np.isfinite(x).all() and (self.rows @ x + self.offsets > 0.0).all()):
            return False
        try:
            for matrix in self.matrices(x):
                np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError:
            return False
        return True

    def step(self, x: Array, mu: float, left: float) -> tuple[Array, float]:
        """Newton step, as far as it leads down, and the squared decrement of the whole of it.

        Args:
            x: A point inside.
            mu: Weight of the barriers.
            left: Weight whose curvature counts: the same, or that of which x is the centre. The step then follows
                the path of centres, along which the distance from a border shrinks with the weight; with the
                curvature of a smaller one it would run into the border and have to be cut.
        """
        p = self.problem
        gradient = p.A.T @ (p.A @ x - p.y) + p.cost + np.maximum(self.weights, mu) @ self.costs
        slack = self.rows @ x + self.offsets
        size = np.maximum(self.row_weights, mu)
        gradient -= self.rows.T @ (size / slack)
        parts = [p.A, (np.sqrt(np.maximum(self.row_weights, left)) / slack)[:, None] * self.rows]
        whitened: list[Array] = []
        for matrix, (flat, offset, weight) in zip(self.matrices(x), self.groups, strict=True):
            order = offset.shape[1]
            half = np.linalg.inv(np.linalg.cholesky(matrix))
            both = (half[:, :, None, :, None] * half[:, None, :, None, :]).reshape(len(half), order**2, order**2)
            white = both @ flat
            scale = np.maximum(weight, mu)
            gradient -= scale @ white[:, :: order + 1].sum(axis=1)
            parts.append((np.sqrt(np.maximum(weight, left))[:, None, None] * white).reshape(-1, len(x)))
            whitened.append(white)
        direction = _newton(np.concatenate(parts), gradient)
        moved = p.A @ direction
        rates, scales = [self.rows @ direction / slack], [size]
        for white, (_, offset, weight) in zip(whitened, self.groups, strict=True):
            spread = np.linalg.eigvalsh((white @ direction).reshape(offset.shape))
            rates.append(np.asarray(spread, dtype=np.float64).ravel())
            scales.append(np.repeat(np.maximum(weight, mu), offset.shape[1]))
        rate, scale = np.concatenate(rates), np.concatenate(scales)
        slope = float(gradient @ direction) + float(scale @ rate)  # without the logarithms
        return direction * _lowest(float(moved @ moved), slope, rate, scale), float(-gradient @ direction)


def _newton(root: Array, gradient: Array) -> Array:
    """The d with rootᵀ root d = -gradient; by QR where the product has lost what matters."""
    size = 1.0 / np.maximum(np.linalg.norm(root, axis=0), np.finfo(np.float64).tiny)
    scaled = root * size
    side = -size * gradient
    with contextlib.suppress(np.linalg.LinAlgError):
        found = np.linalg.solve(scaled.T @ scaled, side)
        curved, along = float(np.sum((scaled @ found) ** 2)), float(side @ found)
        if abs(curved - along) <= LOST * abs(along):
            return size * found
    R: Any = np.linalg.qr(scaled, mode="r")
    R[np.diag_indices(len(R))] += np.where(np.diag(R) == 0.0, np.finfo(np.float64).eps, 0.0)
    found = np.zeros_like(side)
    for _ in range(3):  # semi-normal equations, refined
        rest = side - scaled.T @ (scaled @ found)
        found += np.linalg.solve(R, np.linalg.solve(R.T, rest))
    return size * found


def _lowest(square: float, slope: float, rate: Array, scale: Array) -> float:
    """The α > 0 that minimises ½ square α² + slope α - Σ scale log(1 + rate α), convex: Newton within a bracket.

    A fixed share of the way to the border would bring eigenvalues there that are a long way from it at the minimum,
    and from there they come back by a factor of two each step.
    """
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


def minimise(
    problem: Smooth, start: Array, *, aim: float = GAP, near: bool = False, longest: int = LONGEST
) -> SmoothSolution:
    """Minimise, and prove how good the answer is.

    Args:
        problem: What is minimised; it must have a minimum.
        start: A point strictly inside every cone and log-det term, shape (variables,).
        aim: Gap aimed at.
        near: The start is near the minimum: the search begins with the weights of the log-det terms.
        longest: Newton steps after which no further weight is tried; a search that is to be short is not repeated.

    Raises:
        EstimationError: The start lies outside.
        UnsolvedError: No proof was reached.
    """
    barriers = _Barriers(problem)
    x = np.array(start, dtype=np.float64)
    if not barriers.inside(x):
        raise EstimationError("The start of the search is no consistent body.", remedy="start from a consistent one.")
    mu = max(1.0, _finite(barriers, x) / max(barriers.orders, 1))
    if near and len(barriers.weights):
        mu = float(barriers.weights.min())
    trouble = UnsolvedError(
        "The search for consistent parameters gave no answer.",
        remedy="loosen what is asked of the bodies, or identify with another method.",
    )
    for shrink in SHRINK[:1] if near or longest < LONGEST else SHRINK:
        try:
            return _follow(barriers, x, mu, aim, shrink, longest)
        except UnsolvedError as error:
            trouble = error
    raise trouble


def _follow(
    barriers: _Barriers, x: Array, mu: float, aim: float, shrink: float, longest: int
) -> SmoothSolution:
    """Follow the centres from one weight of the barriers to where the gap is what is aimed at."""
    taken, before = 0, mu
    while True:
        absolute = aim * max(1.0, abs(_finite(barriers, x)))
        last = mu * barriers.parameters <= absolute and bool((mu <= barriers.weights).all())
        enough = min(CENTRED * mu, 0.1 * absolute) if last else CENTRED * mu
        x, decrement, steps = _centre(barriers, x, (before, mu), enough, min(STEPS, longest))
        taken, before = taken + steps, mu
        if taken > longest and not last:
            raise UnsolvedError(
                f"The search for consistent parameters stood still after {taken} steps.", remedy=REMEDY
            )
        if not last:
            mu *= shrink
        elif not aim * max(1.0, abs(_finite(barriers, x))) < 0.5 * absolute:  # or else more can be asked
            break
    objective = _finite(barriers, x)
    # The decrement bounds what is left only where it is small against the barriers' weight [Nesterov1994].
    left = mu * barriers.parameters + decrement if decrement <= SMALL * mu else float("inf")
    gap = left / max(1.0, abs(objective))
    if not gap <= max(ACCEPTED, 2.0 * aim):
        raise UnsolvedError(
            f"The search for consistent parameters gave no answer (gap {gap:.1e} after {taken} steps).",
            remedy=REMEDY,
        )
    return SmoothSolution(x, barriers.problem.objective(x), gap, taken)


def _finite(barriers: _Barriers, x: Array) -> float:
    """The objective, unless the search has run away."""
    with np.errstate(over="ignore", invalid="ignore"):
        objective = barriers.objective(x)
    if not np.isfinite(objective):
        raise UnsolvedError(
            "The search for consistent parameters ran away and has no gap.",
            remedy=REMEDY,
        )
    return objective


def _centre(
    barriers: _Barriers, x: Array, weights: tuple[float, float], enough: float, most: int
) -> tuple[Array, float, int]:
    """Newton's method from the centre for one weight to that for another; its last squared decrement, the steps."""
    decrement, (left, mu) = float("inf"), weights
    for k in range(most):
        try:
            with np.errstate(over="raise", invalid="raise", divide="raise"):
                direction, decrement = barriers.step(x, mu, left if k == 0 else mu)
        except (FloatingPointError, np.linalg.LinAlgError):  # no digits are left; the gap tells how good x is
            return x, decrement, k
        if abs(decrement) <= enough and (k > 0 or left == mu):
            return x, abs(decrement), k
        if decrement < 0.0:  # a direction that is all rounding
            return x, float("inf"), k
        while not barriers.inside(x + direction):  # within rounding of the border
            direction = 0.5 * direction
            if not np.abs(direction).max() > ROUNDED * np.abs(x).max():
                return x, decrement, k
        x = x + direction
    return x, decrement, most
