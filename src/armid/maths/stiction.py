"""Dry friction over one time step: decision which joints slide and which stick, and their friction torque.

The friction torque f of a sliding joint is at its bound; that of a sticking joint has any value between the bounds:

    v = free - G f,   f = -lower if v < 0,   f = upper if v > 0,   -lower <= f <= upper if v = 0

Here v is the velocity at the end of the step, `free` is this velocity without dry friction, and G is the mobility,
the change of velocity in the step for unit torque, a symmetric positive definite matrix. These are the optimality
conditions of a convex program with bounds, so the solution is unique [Moreau1988].
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array

ROUNDS = 20
"""Largest number of changes of the active set (the sliding joints), after which Gauss-Seidel sweeps are used. For
arms, one to four changes are enough."""

SWEEPS = 400
"""Number of Gauss-Seidel sweeps, which are used if the active set does not converge; a few sweeps halve the error."""


def solve_stiction(mobility: Array, free: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Friction torques in a time step and velocities at the end of the step, for W arms at once.

    Args:
        mobility: Mobility G, shape (W, n, n) [rad/s/(N·m) or m/s/N].
        free: Velocity at the end of the step without dry friction, shape (W, n) [rad/s or m/s].
        lower: Largest friction torque against negative motion, shape (W, n), not negative [N·m or N].
        upper: Largest friction torque against positive motion, shape (W, n), not negative [N·m or N].

    Returns:
        Friction torque f, shape (W, n), and velocity v, shape (W, n), which is exactly zero if a joint sticks.
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
    """Friction torques (W, n) by Gauss-Seidel sweeps, which always converge, from an initial value f (W, n)."""
    f = f.copy()
    for _ in range(SWEEPS):
        for j in range(f.shape[1]):
            v = free[:, j] - (mobility[:, j] * f).sum(axis=1)
            f[:, j] = np.clip(f[:, j] + v / mobility[:, j, j], -lower[:, j], upper[:, j])
    return f
