"""Barrier method for least squares with log-det terms over cones, with a duality gap as certificate.

    minimise  ½ |A x - y|² + bᵀx + Σ_i w_i (c_iᵀx + d_i - log det X_i(x))    so that every cone holds

For each μ of a decreasing sequence, Newton's method minimises the objective. The cones are replaced by barriers of
weight μ, and weights w_i smaller than μ are raised to μ. At the minimum for μ, the multipliers μ / s of the cones (s:
slack) are dual feasible. The duality gap is therefore μ times the number of barrier parameters. A bound of the error
of the last Newton step is added to it [Nesterov1994].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError, UnsolvedError
from armid.maths.barrier_function import Barriers, Smooth
from armid.maths.conic_solver import ACCEPTED

SHRINK = (0.01, 0.1)
"""Ratios of successive weights of the barriers. The search with the first ratio takes a fifth less time. If it fails,
mostly for data that no physical body explains, the search is repeated with the second ratio."""

GAP = 1e-9
"""Duality gap at which the search ends, divided by the objective or by 1, whichever is larger. It is a thousandth of
the accepted gap."""

STEPS = 200
"""Largest number of Newton steps for one weight of the barriers; two to ten are usual."""

LONGEST = 250
"""Total number of Newton steps after which the weight of the barriers is no longer decreased; 20 to 100 are usual. If
more steps are needed, the residual is so large, or the minimum so flat, that rounding errors dominate."""

ROUNDED = 1e-16
"""Ratio of a step to the largest unknown below which the step is only a rounding error."""

CENTRED = 0.02
"""Largest squared Newton decrement, divided by the weight μ of the barriers, for which μ may be decreased. One more
step makes this ratio less than 0.001 [Nesterov1994]."""

PROVED = 1e-3
"""Largest squared Newton decrement, divided by the weight of the barriers, with which the search at the last weight
ends."""

SMALL = 0.5
"""Largest squared Newton decrement, divided by the weight of the barriers, for which the decrement is an upper bound
of the difference between the objective and its minimum."""

REMEDY = "look for a wrong sign or unit of torque or gravity, since no body explains such data, or use another prior."
"""Remedy in the messages of errors about a failed search."""


@dataclass(frozen=True, eq=False, slots=True)
class SmoothSolution:
    """Solution with a bound of its duality gap.

    Attributes:
        x: The variables, strictly inside every cone.
        objective: Objective at x.
        gap: Upper bound of the difference between `objective` and the minimum, divided by the objective or by 1,
            whichever is larger.
        steps: Number of Newton steps.
    """

    x: Array
    objective: float
    gap: float
    steps: int


def minimise(
    problem: Smooth, start: Array, *, aim: float = GAP, near: bool = False, longest: int = LONGEST
) -> SmoothSolution:
    """Minimises the objective of a problem and computes a bound of the remaining duality gap.

    Args:
        problem: Objective and cones; a minimum must exist.
        start: Point strictly inside every cone and log-det term, shape (variables,).
        aim: Relative duality gap at which the search ends, as defined for `GAP`.
        near: True if the start is near the minimum. The search then begins with a barrier weight μ equal to the
            smallest weight of a log-det term.
        longest: Number of Newton steps after which μ is no longer decreased. If this is less than the default, the
            search begins with μ nearer to the weights of the log-det terms, and is not repeated if it fails.

    Raises:
        EstimationError: The start is not strictly feasible.
        UnsolvedError: The search diverged, or the gap remained too large.
    """
    barriers = Barriers(problem)
    x = np.array(start, dtype=np.float64)
    if not barriers.inside(x):
        raise EstimationError(
            "The search must start from physically consistent bodies.", remedy="give consistent bodies as the start."
        )
    mu = max(1.0, _finite(barriers, x) / max(barriers.orders, 1))
    if len(barriers.weights) and (near or longest < LONGEST):
        least = float(barriers.weights.min())
        mu = least if near else max(least, math.sqrt(least * mu))  # a shorter path, which fails now and then
    trouble = UnsolvedError(
        "The search for physically consistent parameters found no solution.",
        remedy="relax the requirements on the bodies, or identify with another method.",
    )
    for shrink in SHRINK[:1] if near or longest < LONGEST else SHRINK:
        try:
            return _follow(barriers, x, mu, aim, shrink, longest)
        except UnsolvedError as error:
            trouble = error
    raise trouble


def _follow(barriers: Barriers, x: Array, mu: float, aim: float, shrink: float, longest: int) -> SmoothSolution:
    """Decreases the weight of the barriers from `mu` by the factor `shrink`, until the target gap is reached."""
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
                f"The search for consistent parameters was stopped after {taken} steps, without a solution.",
                remedy=REMEDY,
            )
        if not last:
            mu *= shrink
        elif not aim * max(1.0, abs(_finite(barriers, x))) < 0.5 * absolute:  # else a smaller gap can be reached
            break
    objective = _finite(barriers, x)
    # The decrement bounds the remaining error only where it is small against the barriers' weight [Nesterov1994].
    bound = mu * barriers.parameters + decrement if decrement <= SMALL * mu else float("inf")
    gap = bound / max(1.0, abs(objective))
    if not gap <= max(ACCEPTED, 2.0 * aim):
        raise UnsolvedError(
            f"The search for physically consistent parameters did not converge (gap {gap:.1e} after {taken} steps).",
            remedy=REMEDY,
        )
    return SmoothSolution(x, barriers.problem.objective(x), gap, taken)


def _finite(barriers: Barriers, x: Array) -> float:
    """Returns the objective at x; raises an error if it is not finite, because the search has then diverged."""
    with np.errstate(over="ignore", invalid="ignore"):
        objective = barriers.objective(x)
    if not np.isfinite(objective):
        raise UnsolvedError(
            "The search for physically consistent parameters diverged.",
            remedy=REMEDY,
        )
    return objective


def _centre(
    barriers: Barriers, x: Array, weights: tuple[float, float], enough: float, most: int
) -> tuple[Array, float, int]:
    """Minimises the objective for a fixed weight of the barriers, by Newton's method.

    The tuple `weights` contains the weight of the barriers for which x is a minimum, and the new weight μ. The
    iteration ends if the squared Newton decrement is at most `enough`, or after `most` steps.

    Returns the minimum, the last squared Newton decrement and the number of steps.
    """
    decrement, (centred, mu) = float("inf"), weights
    for k in range(most):
        try:
            with np.errstate(over="raise", invalid="raise", divide="raise"):
                direction, decrement = barriers.step(x, mu, centred if k == 0 else mu)
        except (FloatingPointError, np.linalg.LinAlgError):  # rounding; the gap bounds the error of x
            return x, decrement, k
        settled = abs(decrement) <= enough and (k > 0 or centred == mu)
        if decrement < 0.0 and not settled:  # the direction is rounding only
            return x, float("inf"), k
        while not barriers.inside(x + direction):  # within rounding of the border
            direction = 0.5 * direction
            if not np.abs(direction).max() > ROUNDED * np.abs(x).max():
                return x, decrement, k
        x = x + direction
        if settled:
            return x, abs(decrement), k + 1
    return x, decrement, most
