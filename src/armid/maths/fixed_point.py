"""Fixed points x = g(x) of slowly converging iterations, by Anderson's extrapolation [Walker2011]."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array

MEMORY = 5
"""Largest number of earlier steps from which the next point is extrapolated."""

FARTHEST = 100.0
"""Largest distance of an extrapolated point from the last value of the function, over the last step. An iteration
whose steps shrink by 1 % needs a hundred steps; a farther point comes from rounding errors of parallel steps."""

PATIENCE = 6
"""Number of iterations without a step below half of the smallest one after which rounding errors count as the limit,
if the smallest step is small enough."""


@dataclass(frozen=True, eq=False, slots=True)
class FixedPoint:
    """Last point of an iteration.

    Attributes:
        x: The point, shape (n,).
        step: Largest absolute coordinate of g(x) - x.
        iterations: Number of evaluations of g.
        settled: True if the step is within the tolerance, or if rounding errors limit it and it is still small.
    """

    x: Array
    step: float
    iterations: int
    settled: bool


def fixed_point(
    g: Callable[[Array], Array],
    start: Array,
    tolerance: Callable[[Array], Array],
    most: int,
    limited: float = 0.0,
) -> FixedPoint:
    """Finds a fixed point of a function.

    The next point is the combination of the last values of g for which the same combination of the last steps
    g(x) - x is shortest. The plain iteration takes the last value of g alone.

    Args:
        g: Function of a point, shape (n,), with a value of the same shape.
        start: First point, shape (n,).
        tolerance: Largest absolute coordinates of a step at which the iteration ends, as a function of the point.
        most: Largest number of evaluations of g.
        limited: Largest absolute coordinate of a step that is accepted where rounding errors prevent shorter ones.

    Returns:
        The point. The last evaluation of g was at this point.
    """
    x = start
    values: list[Array] = []
    steps: list[Array] = []
    best, since, best_x = np.inf, 0, x
    size = np.inf
    for k in range(most):
        value = g(x)
        step, before = value - x, size
        size = float(np.abs(step).max(initial=0.0))
        if (np.abs(step) <= tolerance(x)).all():
            return FixedPoint(x, size, k + 1, True)
        since = 0 if size < 0.5 * best else since + 1
        if size < best:
            best, best_x = size, x
        if since >= PATIENCE and best <= limited:
            g(best_x)
            return FixedPoint(best_x, best, k + 2, True)
        if size > before:  # far from the fixed point, extrapolation leads astray
            values, steps = [], []
        values, steps = [*values[-MEMORY:], value], [*steps[-MEMORY:], step]
        x = _extrapolated(values, steps)
    return FixedPoint(x, size, most, False)


def _extrapolated(values: list[Array], steps: list[Array]) -> Array:
    """Next point, from the last values of the function and the last steps, the latest ones last."""
    if len(steps) < 2:
        return values[-1]
    by_step = np.diff(np.stack(steps, axis=1), axis=1)
    by_value = np.diff(np.stack(values, axis=1), axis=1)
    shares = np.linalg.lstsq(by_step, steps[-1], rcond=1e-10)[0]
    change = by_value @ shares
    far = float(np.abs(change).max()) > FARTHEST * float(np.abs(steps[-1]).max())
    return values[-1] if far or not np.isfinite(change).all() else values[-1] - change
