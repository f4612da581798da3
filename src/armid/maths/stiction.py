"""Dry friction over one time step: the sliding and sticking joints with their friction torque.

A joint slides with the torque of its bound, or sticks with any torque between its two bounds:

    v = free - G f,   f = -lower where v < 0,   f = upper where v > 0,   -lower <= f <= upper where v = 0

with G the symmetric positive definite mobility (change of velocity in the step for unit torque). These are the
optimality conditions of a convex program with bounds, so the solution is unique [Moreau1988].
"""

from __future__ import annotations

import numpy as np

from armid.values import Array

ROUNDS = 20
"""Largest number of changes of the active set before Gauss-Seidel sweeps; on arms one to four are enough."""

SWEEPS = 400
"""Gauss-Seidel sweeps where the active set cycles; a few sweeps halve the error."""


def solve_stiction(mobility: Array, free: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Friction torque and velocity at the end of a step, for W arms at once.

    Args:
        mobility: G, shape (W, n, n) [rad/s/(N·m)].
        free: Velocity without this friction, shape (W, n) [rad/s or m/s].
        lower: Largest friction torque against negative motion, shape (W, n), not negative [N·m or N].
        upper: Largest friction torque against positive motion, shape (W, n), not negative [N·m or N].

    Returns:
        Torque f (W, n) and velocity (W, n), which is exactly zero where a joint sticks.
    """
    stiffness = 1.0 / np.einsum("wjj->wj", mobility)
    identity = np.eye(free.shape[1], dtype=bool)
    trial = stiffness * free
    slides: Array | None = None
    f, v = np.zeros_like(free), free
    for _ in range(ROUNDS):
        up, down = trial > upper, trial < -lower
        now = up * 1.0 - down
        if slides is not None and np.array_equal(now, slides):
            break
        slides = now
        sticks = ~(up | down)
        held = np.where(up, upper, np.where(down, -lower, free))
        matrix = np.where(sticks[:, :, None], mobility, identity)
        f = np.where(sticks, np.linalg.solve(matrix, held[:, :, None])[:, :, 0], held)
        v = np.where(sticks, 0.0, free - (mobility @ f[:, :, None])[:, :, 0])
        trial = f + stiffness * v
    else:
        f = _swept(mobility, free, np.clip(f, -lower, upper), lower, upper)
        v = free - (mobility @ f[:, :, None])[:, :, 0]
        v = np.where((f > -lower) & (f < upper), 0.0, v)
    return f, v


def _swept(mobility: Array, free: Array, f: Array, lower: Array, upper: Array) -> Array:
    """Solution by Gauss-Seidel, which always converges."""
    f = f.copy()
    for _ in range(SWEEPS):
        for j in range(f.shape[1]):
            v = free[:, j] - (mobility[:, j] * f).sum(axis=1)
            f[:, j] = np.clip(f[:, j] + v / mobility[:, j, j], -lower[:, j], upper[:, j])
    return f
