"""Joint torques of a model that is known more or less, held inside the drives' limits with a margin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.excitation.limits.constraints import States
from armid.excitation.limits.torque_curvature import ORDERS, torque_curvature
from armid.values import Array

__all__ = ["Torque"]


@dataclass(frozen=True, eq=False, slots=True)
class Torque:
    """Torque of base parameters, each joint's over its limit.

    Attributes:
        name: What it is.
        joints: Which joints have a limit.
        labels: Their names.
        base: Base parameters, nominal or identified, shape (b,).
        limit: What the torque may reach, its margin taken off, shape (m,) [N·m or N].
    """

    name: str
    joints: tuple[int, ...]
    labels: tuple[str, ...]
    base: Array
    limit: Array

    def values(self, states: States) -> Array:
        """Torques over limits, shape (N, m)."""
        return np.abs(states.torque(self.base)[:, self.joints]) / self.limit

    def pull(self, states: States, weights: Array) -> Array:
        """Gradient (m, n k): one sweep of the kernel's adjoint a joint."""
        torque = states.torque(self.base)
        objective = states.objective
        rows: list[Array] = []
        for k, joint in enumerate(self.joints):
            slopes = weights[:, k] * np.sign(torque[:, joint]) / self.limit[k]
            rows.append(objective.pull(objective.columns.torque_gradient(self.base, joint, slopes)))
        return np.array(rows)

    def between(self, states: States, step: float) -> Array:
        """Tell how far a torque may rise between points of a grid, as a share.

        That of the rigid links rises above both points by at most step²/8 times the bound of its second derivative.
        Friction may jump where a joint reverses; for it the largest step between neighbours is allowed for, which is
        a margin and no proof.
        """
        goal, basis = states.objective.goal, states.basis
        bodies = np.isin(goal.base.kept, goal.model.inertial_columns)
        standard = np.zeros(len(goal.model.parameters))
        standard[goal.base.kept[bodies]] = self.base[bodies]
        places = np.abs(states.coefficients[:, -1]) + basis.peaks_between(states.x, 0)
        bounds = [places, *(basis.peaks_between(states.x, order) for order in range(1, ORDERS + 1))]
        inertial = standard[goal.model.inertial_columns].reshape(-1, 10)
        rise = np.zeros(basis.n)
        if len(inertial):
            rise = step**2 / 8.0 * torque_curvature(states.tree, inertial, np.array(bounds))
        terms = np.where(bodies, 0.0, self.base)
        if terms.any():
            rise += np.abs(np.diff(states.torque(terms), axis=0)).max(axis=0, initial=0.0)
        return rise[list(self.joints)] / self.limit
