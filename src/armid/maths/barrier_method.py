"""Least squares with log-det terms over cones: a barrier method that carries its own certificate.

    minimise  ½ |A x - y|² + bᵀx + Σ_i w_i (c_iᵀx + d_i - log det X_i(x))    so that every cone holds

For each μ of a falling sequence Newton's method minimises the same with barriers of weight μ in place of the cones,
and with no w_i smaller than μ: from a start where the log-det terms are small, the path to the data is short. At the
minimum for μ the cones' multipliers μ / s are feasible for the dual, so that the gap is μ times the number of barrier
parameters; what the last Newton step left is added to it [Nesterov1994].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armid.errors import EstimationError, UnsolvedError
from armid.maths.barrier_function import Barriers, Smooth
from armid.maths.cones import ACCEPTED
from armid.values import Array

__all__ = ["SmoothSolution", "minimise"]

SHRINK = (0.01, 0.1)
"""Factors from one weight of the barriers to the next. The first saves a fifth of the time; data that no body
explains may lead it astray, and then the second is tried."""

GAP = 1e-9
"""Gap aimed at, over the size of the objective, at least one: a thousandth of what is accepted."""

STEPS = 200
"""Newton steps for one weight of the barriers before giving up; two to ten are usual."""

LONGEST = 250
"""Newton steps in all after which no further weight is tried; twenty to a hundred are usual. Where more are needed
the minimum is so far from what the data say, or so flat, that no digits are left to prove it."""

ROUNDED = 1e-16
"""Step over the size of the unknowns that changes nothing."""

CENTRED = 0.02
"""Squared Newton decrement over the barrier's weight from which one more step leaves less than a thousandth of that
weight: then μ may fall [Nesterov1994]."""

PROVED = 1e-3
"""The same where μ falls no more."""

SMALL = 0.5
"""Largest squared decrement over the barrier's weight for which it bounds the distance from the minimum."""

REMEDY = "look for a wrong sign or unit of torque or gravity: no body explains such data; or ask for another prior."
"""Remedy where a search fails."""


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


def minimise(
    problem: Smooth, start: Array, *, aim: float = GAP, near: bool = False, longest: int = LONGEST
) -> SmoothSolution:
    """Minimise, and prove how good the answer is.

    Args:
        problem: What is minimised; it must have a minimum.
        start: A point strictly inside every cone and log-det term, shape (variables,).
        aim: Gap aimed at.
        near: The start is near the minimum: the search begins with the weights of the log-det terms.
        longest: Newton steps after which no further weight is tried. A short search begins nearer to the
            weights of the log-det terms, and is not repeated.

    Raises:
        EstimationError: The start lies outside.
        UnsolvedError: No proof was reached.
    """
    barriers = Barriers(problem)
    x = np.array(start, dtype=np.float64)
    if not barriers.inside(x):
        raise EstimationError("The start of the search is no consistent body.", remedy="start from a consistent one.")
    mu = max(1.0, _finite(barriers, x) / max(barriers.orders, 1))
    if len(barriers.weights) and (near or longest < LONGEST):
        least = float(barriers.weights.min())
        mu = least if near else max(least, math.sqrt(least * mu))  # a shorter path that now and then leads nowhere
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


def _follow(barriers: Barriers, x: Array, mu: float, aim: float, shrink: float, longest: int) -> SmoothSolution:
    """Follow the centres from one weight of the barriers to where the gap is what is aimed at."""
    taken, before = 0, mu
    while True:
        absolute = aim * max(1.0, abs(_finite(barriers, x)))
        last = mu * barriers.parameters <= absolute and bool((mu <= barriers.weights).all())
        enough = min(PROVED * mu, 0.1 * absolute) if last else CENTRED * mu
        most = min(STEPS, longest if last else longest - taken + 1)
        x, decrement, steps = _centre(barriers, x, (before, mu), enough, most)
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


def _finite(barriers: Barriers, x: Array) -> float:
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
    barriers: Barriers, x: Array, weights: tuple[float, float], enough: float, most: int
) -> tuple[Array, float, int]:
    """Newton's method from the centre for one weight to that for another; its last squared decrement, the steps."""
    decrement, (left, mu) = float("inf"), weights
    for k in range(most):
        try:
            with np.errstate(over="raise", invalid="raise", divide="raise"):
                direction, decrement = barriers.step(x, mu, left if k == 0 else mu)
        except (FloatingPointError, np.linalg.LinAlgError):  # no digits are left; the gap tells how good x is
            return x, decrement, k
        settled = abs(decrement) <= enough and (k > 0 or left == mu)
        if decrement < 0.0 and not settled:  # a direction that is all rounding
            return x, float("inf"), k
        while not barriers.inside(x + direction):  # within rounding of the border
            direction = 0.5 * direction
            if not np.abs(direction).max() > ROUNDED * np.abs(x).max():
                return x, decrement, k
        x = x + direction
        if settled:
            return x, abs(decrement), k + 1
    return x, decrement, most
