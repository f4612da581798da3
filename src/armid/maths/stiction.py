"""Dry friction over one step of time: which joints slide, which stick, and with what torque.

A joint slides at the torque of its bound or sticks at any torque between its two bounds:

    v = free - G f,   f = -lower where v < 0,   f = upper where v > 0,   -lower <= f <= upper where v = 0

with G the symmetric positive definite mobility (velocity gained in the step for each unit of torque). That is the
optimum of a small convex program with bounds, so there is one answer, whatever the guess [Moreau1988].
"""

from __future__ import annotations

import numpy as np

from armid.values import Array

__all__ = ["solve_stiction"]

ROUNDS = 20
"""Changes of the active set before sweeping: it settles in one to four on arms."""

SWEEPS = 400
"""Sweeps of Gauss-Seidel where the active set cycles; errors fall at least by half in a few."""


def solve_stiction(mobility: Array, free: Array, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Friction and velocity at the end of a step, for W arms at once.

    Args:
        mobility: G, shape (W, n, n) [rad/s/(N·m)].
        free: Velocity without this friction, shape (W, n) [rad/s or m/s].
        lower: Largest torque against negative motion, shape (W, n), not negative [N·m or N].
        upper: Largest torque against positive motion, shape (W, n), not negative [N·m or N].

    Returns:
        Torque f (W, n) and velocity (W, n), which is exactly zero where a joint sticks.
    """
    stiffness = 1.0 / np.einsum("wjj->wj", mobility)
    identity = np.eye(free.shape[1], dtype=bool)
    wish = stiffness * free
    slides: Array | None = None
    f, v = np.zeros_like(free), free
    for _ in range(ROUNDS):
        up, down = wish > upper, wish < -lower
        now = up * 1.0 - down
        if slides is not None and np.array_equal(now, slides):
            break
        slides = now
        sticks = ~(up | down)
        held = np.where(up, upper, np.where(down, -lower, free))
        matrix = np.where(sticks[:, :, None], mobility, identity)
        f = np.where(sticks, np.linalg.solve(matrix, held[:, :, None])[:, :, 0], held)
        v = np.where(sticks, 0.0, free - (mobility @ f[:, :, None])[:, :, 0])
        wish = f + stiffness * v
    else:
        f = _swept(mobility, free, np.clip(f, -lower, upper), lower, upper)
        v = free - (mobility @ f[:, :, None])[:, :, 0]
        v = np.where((f > -lower) & (f < upper), 0.0, v)
    return f, v


def _swept(mobility: Array, free: Array, f: Array, lower: Array, upper: Array) -> Array:
    """The same by Gauss-Seidel, which always converges."""
    f = f.copy()
    for _ in range(SWEEPS):
        for j in range(f.shape[1]):
            v = free[:, j] - (mobility[:, j] * f).sum(axis=1)
            f[:, j] = np.clip(f[:, j] + v / mobility[:, j, j], -lower[:, j], upper[:, j])
    return f
