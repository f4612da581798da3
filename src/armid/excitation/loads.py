"""Joint torques of a model that is known more or less, held inside the drives' limits with a margin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.excitation.channels import States
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
        """How far a torque may rise between points of a grid, as a share: the largest step between neighbours.

        Torque is no series of finitely many harmonics. It goes half a step at most from the nearer of two points, so
        this allows for twice the slope that the grid sees; it is a margin and no proof.
        """
        del step
        return np.abs(np.diff(self.values(states), axis=0)).max(axis=0, initial=0.0)
