"""Torque limits of the joints as a constraint channel, for given base parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.excitation.limits.constraints import States
from armid.excitation.limits.torque_curvature import ORDERS, torque_curvature
from armid.values import Array


@dataclass(frozen=True, eq=False, slots=True)
class Torque:
    """Joint torques for given base parameters, divided by their limits.

    Attributes:
        name: Name of the quantity.
        joints: Indices of the joints with a limit.
        labels: Names of these joints.
        base: Base parameters (of the description or identified), shape (b,).
        limit: Torque limits, reduced by the margin, shape (m,) [N·m or N].
    """

    name: str
    joints: tuple[int, ...]
    labels: tuple[str, ...]
    base: Array
    limit: Array

    def values(self, states: States) -> Array:
        """Absolute values of the torques divided by their limits, shape (N, m)."""
        return np.abs(states.torque(self.base)[:, self.joints]) / self.limit

    def pullback(self, states: States, weights: Array) -> Array:
        """Gradients (m, n k), computed with one pass of the kernel's adjoint for each joint."""
        torque = states.torque(self.base)
        objective = states.objective
        rows: list[Array] = []
        for k, joint in enumerate(self.joints):
            slopes = weights[:, k] * np.sign(torque[:, joint]) / self.limit[k]
            rows.append(objective.pullback(objective.columns.torque_gradient(self.base, joint, slopes)))
        return np.array(rows)

    def between(self, states: States, step: float) -> Array:
        """Bound of the rise of the utilisation between points of a grid, shape (m,).

        The torque of the rigid links rises by at most step²/8 times the bound of its second derivative. Friction may
        jump when a joint reverses. Therefore the largest difference of friction between neighbouring points is added;
        this is a margin, but not a proven bound.
        """
        goal, basis = states.objective.goal, states.basis
        bodies = np.isin(goal.base.kept, goal.model.inertial_columns)
        standard = np.zeros(len(goal.model.parameters))
        standard[goal.base.kept[bodies]] = self.base[bodies]
        positions = np.abs(states.coefficients[:, -1]) + basis.peaks_between(states.x, 0)
        bounds = [positions, *(basis.peaks_between(states.x, order) for order in range(1, ORDERS + 1))]
        inertial = standard[goal.model.inertial_columns].reshape(-1, 10)
        rise = np.zeros(basis.n)
        if len(inertial):
            rise = step**2 / 8.0 * torque_curvature(states.tree, inertial, np.array(bounds))
        terms = np.where(bodies, 0.0, self.base)
        if terms.any():
            rise += np.abs(np.diff(states.torque(terms), axis=0)).max(axis=0, initial=0.0)
        return rise[list(self.joints)] / self.limit
