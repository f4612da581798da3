"""Search for local minima of a smooth function within a box, from many start points at once.

The method is a projected quasi-Newton method [Bertsekas1982]. A variable at a bound is not moved if a descent step
would take it out of the box. For the other variables, a step with an approximate second derivative is computed and
projected on the box. All start points are evaluated together, which takes little more time than one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array

STEPS = 200
"""Largest number of steps; smooth functions of about ten variables need 10 to 60."""

FLAT = 1e-10
"""Largest absolute entry of the projected gradient at which a point counts as a minimum."""

NEAR = 1e-8
"""Largest absolute entry of the projected gradient at which a point counts as a minimum if the value of the function
no longer decreases. Gradients from finite differences are not more accurate."""

SETTLED = 1e-14
"""Decrease of the function value in one step, divided by the value or by 1, whichever is larger, up to which a search
has converged."""

ARMIJO = 1e-4
"""Smallest accepted ratio of the decrease of the function value to the decrease that the gradient predicts for a
step."""

HALVINGS = 40
"""Largest number of step lengths that a line search tries, each half as long as the one before."""

CURVED = 1e-12
"""Smallest scalar product of the step and the change of the gradient, divided by the product of their lengths, for
which the approximate second derivative is updated."""

Function = Callable[[Array], tuple[Array, Array]]
"""Function that returns its values (K,) and gradients (K, n) at K points (K, n)."""


def descend_in_box(function: Function, start: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Finds a local minimum from each start point.

    Args:
        function: Function to minimise; it is called with the points that have not converged.
        start: Start points, shape (K, n).
        low: Lower bounds, shape (n,).
        high: Upper bounds, shape (n,).

    Returns:
        Minima, shape (K, n), and the values of the function there, shape (K,).
    """
    x = np.clip(start, low, high)
    value, gradient = function(x)
    value, gradient = value.copy(), gradient.copy()
    identity = np.eye(x.shape[1])
    curvature = np.maximum(np.linalg.norm(gradient, axis=1), np.finfo(float).tiny)[:, None, None] * identity
    plain = np.ones(len(x), dtype=bool)  # no second derivative has been learned yet
    going = np.arange(len(x))
    for _ in range(STEPS):
        move = np.clip(x[going] - gradient[going], low, high) - x[going]
        slope = np.abs(move).max(axis=1)
        going, slope = going[slope > FLAT], slope[slope > FLAT]
        if not len(going):
            break
        step = _step(x[going], gradient[going], curvature[going], low, high)
        new, new_value, new_gradient, moved = _searched(
            function, x[going], value[going], gradient[going], step, low, high
        )
        s, y = new - x[going], new_gradient - gradient[going]
        settled = value[going] - new_value <= SETTLED * np.maximum(np.abs(value[going]), 1.0)
        curvature[going] = _updated(curvature[going], s, y, plain[going])
        x[going], value[going], gradient[going] = new, new_value, new_gradient
        # Where the second derivative no longer helps, it is forgotten once.
        done = ~moved | settled
        lost = going[done]
        size = np.maximum(np.linalg.norm(gradient[lost], axis=1), np.finfo(float).tiny)
        curvature[lost] = size[:, None, None] * identity
        stays = ~(done & (plain[going] | (slope < NEAR)))
        plain[going] = done
        going = going[stays]
    return x, value


def _step(x: Array, gradient: Array, curvature: Array, low: Array, high: Array) -> Array:
    """Quasi-Newton steps, shape (K, n); a variable at a bound gets no step if the step would leave the box."""
    held = ((x <= low) & (gradient > 0.0)) | ((x >= high) & (gradient < 0.0))
    free = ~held
    matrix = curvature * (free[:, :, None] & free[:, None, :])
    matrix += held[:, :, None] * np.eye(x.shape[1])
    return np.asarray(np.linalg.solve(matrix, -(gradient * free)[..., None])[..., 0], dtype=np.float64)


def _searched(
    function: Function, x: Array, value: Array, gradient: Array, step: Array, low: Array, high: Array
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Line search: halves each projected step until the function value decreases enough.

    Returns the points (K, n), their values (K,) and gradients (K, n), and a mask (K,) of the searches that found such
    a point; the other points are the given ones.
    """
    found = np.zeros(len(x), dtype=bool)
    best, best_value, best_gradient = x.copy(), value.copy(), gradient.copy()
    share = 1.0
    for _ in range(HALVINGS):
        open_ = np.flatnonzero(~found)
        trial = np.clip(x[open_] + share * step[open_], low, high)
        trial_value, trial_gradient = function(trial)
        predicted = np.einsum("kn,kn->k", gradient[open_], trial - x[open_])
        good = (predicted < 0.0) & (trial_value <= value[open_] + ARMIJO * predicted)
        taken = open_[good]
        best[taken], best_value[taken], best_gradient[taken] = trial[good], trial_value[good], trial_gradient[good]
        found[taken] = True
        if found.all():
            break
        share *= 0.5
    return best, best_value, best_gradient, found


def _updated(curvature: Array, s: Array, y: Array, plain: NDArray[np.bool_]) -> Array:
    """Updates the approximate second derivatives (K, n, n) by the BFGS formula.

    `s` are the steps (K, n), `y` the changes of the gradient (K, n). `plain` is the mask of the searches without an
    earlier update (K,).
    """
    along = np.einsum("kn,kn->k", s, y)
    size = np.linalg.norm(s, axis=1) * np.linalg.norm(y, axis=1)
    known = along > CURVED * np.maximum(size, np.finfo(float).tiny)
    along = np.where(known, along, 1.0)
    first = np.where(known & plain, np.einsum("kn,kn->k", y, y) / along, 1.0)  # scale of the first approximation
    scaled = np.where((known & plain)[:, None, None], first[:, None, None] * np.eye(s.shape[1]), curvature)
    Bs = np.einsum("kij,kj->ki", scaled, s)
    sBs = np.where(known, np.einsum("ki,ki->k", s, Bs), 1.0)
    new = (
        scaled
        + y[:, :, None] * y[:, None, :] / along[:, None, None]
        - Bs[:, :, None] * Bs[:, None, :] / sBs[:, None, None]
    )
    return np.where(known[:, None, None], new, curvature)
