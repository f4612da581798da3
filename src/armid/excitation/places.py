"""Where points of the arm may be: the gradient of places by the unknowns, and the workspace of the tip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.excitation.channels import States
from armid.kernel.tree import Tree
from armid.robot.robot import Robot
from armid.values import Array

__all__ = ["SCALE", "Workspace", "point_gradient", "point_speed"]

SCALE = 0.1
"""Distance [m] that counts as a whole limit where what is limited is a distance: one at the border, zero so far
inside."""


def point_gradient(
    robot: Robot, tree: Tree, poses: tuple[Array, Array], link: int, points: Array, forces: Array
) -> Array:
    """Gradient by q of Σ forces · points.

    Args:
        robot: The arm.
        tree: Its geometry.
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of its links.
        link: Which link carries the points; -1 for the base.
        points: Shape (N, ..., 3), in the base frame [m].
        forces: Shape (N, ..., 3).

    Returns:
        Shape (N, ..., n).
    """
    R, p = poses
    gradient = np.zeros((*points.shape[:-1], robot.n))
    lift = (slice(None), *(None,) * (points.ndim - 2))
    for j in tree.ancestors(link):
        axis = (R[:, j] @ tree.axis[j])[lift]
        arm = axis if tree.prismatic[j] else np.cross(axis, points - p[:, j][lift])
        gradient[..., j] = (forces * arm).sum(axis=-1)
    return gradient


def point_speed(tree: Tree, poses: tuple[Array, Array], link: int, points: Array, speed: Array) -> Array:
    """Bound (N,) [m/s] of the speed of points (N, 3) of a link, from the joints' speeds (n,) [rad/s or m/s]."""
    R, p = poses
    total = np.zeros(len(points))
    for j in tree.ancestors(link):
        axis = R[:, j] @ tree.axis[j]
        reach = (
            np.ones(len(points)) if tree.prismatic[j] else np.linalg.norm(np.cross(axis, points - p[:, j]), axis=1)
        )
        total += speed[j] * reach
    return total


@dataclass(frozen=True, eq=False, slots=True)
class Workspace:
    """The tip stays on the inner side of planes; a box is six of them.

    Attributes:
        name: What it is.
        labels: Which plane, one each.
        normals: Unit vectors out of the allowed space, base frame, shape (m, 3).
        offsets: Largest allowed normal · place, shape (m,) [m].
    """

    name: str
    labels: tuple[str, ...]
    normals: Array
    offsets: Array

    def _tip(self, states: States) -> Array:
        tip = states.robot.tip
        R, p = states.poses
        if tip.parent < 0:
            return np.tile(tip.placement[:3, 3], (len(p), 1))
        return p[:, tip.parent] + R[:, tip.parent] @ tip.placement[:3, 3]

    def values(self, states: States) -> Array:
        """One less the distance to each plane over a tenth of a metre, shape (N, m)."""
        return 1.0 - (self.offsets - self._tip(states) @ self.normals.T) / SCALE

    def pull(self, states: States, weights: Array) -> Array:
        """Gradient (m, n k)."""
        tip, link = self._tip(states), states.robot.tip.parent
        forces = weights[:, :, None] * self.normals / SCALE
        places = np.broadcast_to(tip[:, None], forces.shape)
        by_q = point_gradient(states.robot, states.tree, states.poses, link, places, forces)
        return states.pull_positions(by_q)

    def between(self, states: States, step: float) -> Array:
        """How far the tip may go between points of a grid, as a share."""
        speed = point_speed(states.tree, states.poses, states.robot.tip.parent, self._tip(states), states.speed_bound)
        return np.full(len(self.labels), 0.5 * step * float(speed.max()) / SCALE)
