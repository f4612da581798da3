"""Interior-point descent that does not leave the limits, for problems with collision constraints.

Inside an obstacle the gradient of the distance may point further into the obstacle. A sequential quadratic method
that steps into a body may therefore not leave it again. The first stage of a short descent therefore minimises

    f(x) - μ Σ log(1 - u_k(x)),

where f is the criterion, u_k are the soft maxima of the utilisations of all limits, and μ is a decreasing weight. The
quasi-Newton method shortens every step that would leave the limits [Nocedal2006, chapters 7 and 19]. The result is
close to the limits and has nearly the final shape of the motion, so it is a good start for the stages of
`armid.excitation.design.sqp`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from armid.checked_array import Array
from armid.excitation.design.sqp import DescentProblem, Stage, about_start, max_utilisation, shrink_to_feasible
from armid.excitation.limits.constraint_channels import ConstraintChannel, States, soft_maximum

WEIGHTS = ((0.1, 60), (0.01, 60), (0.004, 50))
"""Weights μ of the barrier in order of use, each with its largest number of iterations."""

ROOM = 0.9
"""Utilisation of the limits to which the starting point is scaled, less than 1, because the barrier is infinite at a
limit."""

REMEMBERED = 20
"""Number of past steps from which the quasi-Newton method estimates the curvature."""

SHORTENED = (0.5, 0.3)
"""Factors by which a step is shortened: if it decreases the value too little, and if it leaves the limits."""

TRIALS = 14
"""Largest number of times that one step is shortened."""

DECREASE = 1e-4
"""Smallest accepted decrease of the function value, divided by the decrease that the slope predicts (Armijo
condition)."""

SETTLED = 1e-6
"""Relative decrease of the function value in a step below which the iteration ends."""

FIRST = 0.1
"""Largest Euclidean length of the first step in the space of the unknowns [rad/s or m/s]."""

Function = Callable[[Array], tuple[float, Array]]


def descend_inside(problem: DescentProblem, x: Array, stage: Stage, deadline: float = np.inf) -> Array:
    """Minimises the criterion plus a logarithmic barrier of the limits, without leaving the limits.

    Args:
        problem: Criterion, unknowns and limits.
        x: Starting point, shape (n k,), with k unknowns of each joint. Its amplitudes are reduced until it keeps the
            limits.
        stage: Stage of the descent, with the grid and the smoothing of criterion and limits.
        deadline: Time on the clock of `time.time` [s] at which the descent ends; the point reached by then is
            returned.

    Returns:
        Unknowns (n k,); `x` itself if the start pose violates a limit.
    """
    interior = shrink_to_feasible(problem, problem.fine, x, ROOM)
    if interior is None:  # the start pose itself is closer to a limit
        still = max_utilisation(problem, problem.fine, about_start(problem.basis, x, 0.0))
        interior = shrink_to_feasible(problem, problem.fine, x, 0.5 * (1.0 + still)) if still < 1.0 else None
    if interior is None:
        return x
    x = interior
    objective, sharpness = problem.objective(stage), stage.limit_sharpness
    for weight, iterations in WEIGHTS:
        states, between = States(objective, x), States(problem.fine, x)
        channels = problem.near(between)
        excess = [
            soft_maximum(channel.values(states), sharpness)[0] - channel.values(between).max(axis=0)
            for channel in channels
        ]

        def barrier(
            x: Array,
            weight: float = weight,
            channels: list[ConstraintChannel] = channels,
            excess: list[Array] = excess,
        ) -> tuple[float, Array]:
            if time.time() > deadline:
                return math.inf, np.zeros_like(x)
            states = States(objective, x)
            parts: list[tuple[Array, Array]] = []
            for channel, offset in zip(channels, excess, strict=True):
                soft, weights = soft_maximum(channel.values(states), sharpness)
                margin = 1.0 - (soft - offset)
                if not (margin > 0.0).all():
                    return math.inf, np.zeros_like(x)
                parts.append((margin, weights))
            value, gradient = objective(x)
            filled = States(objective, x, filled=True)
            filled.nearest, filled.hulls = states.nearest, states.hulls
            for channel, (margin, weights) in zip(channels, parts, strict=True):
                value -= weight * float(np.log(margin).sum())
                gradient = gradient + weight * channel.pullback(filled, weights / margin).sum(axis=0)
            return value, gradient

        x = quasi_newton(barrier, x, iterations)
        if channels != list(problem.channels):  # a pair of bodies that was far apart may now be close
            inside = shrink_to_feasible(problem, problem.fine, x)
            x = x if inside is None else inside
    return x


def quasi_newton(function: Function, x: Array, iterations: int) -> Array:
    """Minimises a function that is infinite outside its domain, with limited-memory BFGS and backtracking.

    Args:
        function: Function that returns value and gradient (d,); the gradient is ignored if the value is infinite.
        x: Starting point, shape (d,).
        iterations: Largest number of iterations.

    Returns:
        Point that is reached, shape (d,).
    """
    value, gradient = function(x)
    steps: list[Array] = []
    changes: list[Array] = []
    for _ in range(iterations):
        if not math.isfinite(value):
            break
        direction = _direction(gradient, steps, changes)
        slope = float(gradient @ direction)
        if not slope < 0.0:
            break
        length, reached = 1.0, function(x + direction)
        for _ in range(TRIALS):
            if reached[0] <= value + DECREASE * length * slope:
                break
            length *= SHORTENED[not math.isfinite(reached[0])]
            reached = function(x + length * direction)
        else:
            break
        step, change = length * direction, reached[1] - gradient
        if step @ change > 1e-10 * math.sqrt(float(step @ step) * float(change @ change)):
            steps, changes = [*steps[1 - REMEMBERED :], step], [*changes[1 - REMEMBERED :], change]
        gain = value - reached[0]
        x, value, gradient = x + step, *reached
        if gain < SETTLED * abs(value):
            break
    return x


def _direction(gradient: Array, steps: list[Array], changes: list[Array]) -> Array:
    """Quasi-Newton direction by the two-loop recursion, from past steps and the changes of the gradient in them."""
    result = -gradient
    if not steps:
        return result * (FIRST / max(float(np.linalg.norm(gradient)), FIRST))
    shares: list[float] = []
    for step, change in zip(reversed(steps), reversed(changes), strict=True):
        shares.append(float(step @ result / (step @ change)))
        result = result - shares[-1] * change
    result = result * float((steps[-1] @ changes[-1]) / (changes[-1] @ changes[-1]))
    for step, change, share in zip(steps, changes, reversed(shares), strict=True):
        result = result + (share - float(change @ result / (step @ change))) * step
    return result
