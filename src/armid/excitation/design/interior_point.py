"""A descent that never leaves the limits, for problems where leaving them is the end of it.

Where bodies may meet, a step that goes through a floor or a forearm leads to places from which distances point
further in, and a sequential quadratic method does not come back. So a scout first goes down

    f(x) - μ Σ log(1 - u_k(x)),

u the soft maxima of all channels, with μ falling, by a quasi-Newton method whose line search takes no step outside
[Nocedal2006, chapters 7 and 19]. It ends near the limits with the shape of the motion settled, which is what
the stages of `armid.excitation.design.sqp` need.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from armid.excitation.design.sqp import DescentProblem, Stage, about_start, max_utilisation, shrink_to_feasible
from armid.excitation.limits.constraints import ConstraintChannel, States, soft_maximum
from armid.values import Array

__all__ = ["descend_inside", "quasi_newton"]

WEIGHTS = ((0.1, 60), (0.01, 60), (0.004, 50))
"""Weight μ of the barrier, and iterations with it."""

ROOM = 0.9
"""Share of its limits that the motion begins with: at a limit the barrier is infinite."""

REMEMBERED = 20
"""Steps from which the curvature is known."""

SHORTENED = (0.5, 0.3)
"""A step that gains too little, or that leaves the limits, is shortened to this share."""

TRIALS = 14
"""Shortenings of one step."""

DECREASE = 1e-4
"""Share of the slope along a step that the value has to fall."""

SETTLED = 1e-6
"""Relative gain of a step that is not worth another."""

FIRST = 0.1
"""Length of the very first step, root sum of squares of the unknowns [rad/s or m/s]."""

Function = Callable[[Array], tuple[float, Array]]


def descend_inside(problem: DescentProblem, x: Array, stage: Stage, deadline: float = np.inf) -> Array:
    """Go down without leaving the limits on the grid of a stage.

    Args:
        problem: What is asked.
        x: Where to begin, shape (n k,); it is drawn together into the limits.
        stage: How smooth everything is.
        deadline: Of `time.time` [s]; what is reached by then is returned.
    """
    begun = shrink_to_feasible(problem, problem.fine, x, ROOM)
    if begun is None:  # the start pose itself is nearer to a limit than that
        still = max_utilisation(problem, problem.fine, about_start(problem.basis, x, 0.0))
        begun = shrink_to_feasible(problem, problem.fine, x, 0.5 * (1.0 + still)) if still < 1.0 else None
    if begun is None:
        return x
    x = begun
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
            for channel, more in zip(channels, excess, strict=True):
                soft, weights = soft_maximum(channel.values(states), sharpness)
                room = 1.0 - (soft - more)
                if not (room > 0.0).all():
                    return math.inf, np.zeros_like(x)
                parts.append((room, weights))
            value, gradient = objective(x)
            filled = States(objective, x, filled=True)
            filled.nearest, filled.hulls = states.nearest, states.hulls
            for channel, (room, weights) in zip(channels, parts, strict=True):
                value -= weight * float(np.log(room).sum())
                gradient = gradient + weight * channel.pull(filled, weights / room).sum(axis=0)
            return value, gradient

        x = quasi_newton(barrier, x, iterations)
        if channels != list(problem.channels):  # a pair that was far away may have come near
            inside = shrink_to_feasible(problem, problem.fine, x)
            x = x if inside is None else inside
    return x


def quasi_newton(function: Function, x: Array, iterations: int) -> Array:
    """Make a function small that is infinite outside its domain, by its value and gradient.

    Args:
        function: Value and gradient (d,); the gradient is not looked at where the value is infinite.
        x: Where to begin, shape (d,).
        iterations: At most.
    """
    value, gradient = function(x)
    steps: list[Array] = []
    turns: list[Array] = []
    for _ in range(iterations):
        if not math.isfinite(value):
            break
        direction = _direction(gradient, steps, turns)
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
        step, turn = length * direction, reached[1] - gradient
        if step @ turn > 1e-10 * math.sqrt(float(step @ step) * float(turn @ turn)):
            steps, turns = [*steps[1 - REMEMBERED :], step], [*turns[1 - REMEMBERED :], turn]
        gain = value - reached[0]
        x, value, gradient = x + step, *reached
        if gain < SETTLED * abs(value):
            break
    return x


def _direction(gradient: Array, steps: list[Array], turns: list[Array]) -> Array:
    """Two loops over the remembered steps and the turns of the gradient along them."""
    result = -gradient
    if not steps:
        return result * (FIRST / max(float(np.linalg.norm(gradient)), FIRST))
    shares: list[float] = []
    for step, turn in zip(reversed(steps), reversed(turns), strict=True):
        shares.append(float(step @ result / (step @ turn)))
        result = result - shares[-1] * turn
    result = result * float((steps[-1] @ turns[-1]) / (turns[-1] @ turns[-1]))
    for step, turn, share in zip(steps, turns, reversed(shares), strict=True):
        result = result + (share - float(turn @ result / (step @ turn))) * step
    return result
