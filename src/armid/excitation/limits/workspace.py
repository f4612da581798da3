"""Places of points of the arm: their gradient by the unknowns, and the workspace of the tip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.excitation.limits.constraints import States
from armid.kernel.tree import Tree
from armid.values import Array

__all__ = ["SCALE", "Workspace", "box_workspace", "carried_by", "point_gradient", "point_speed"]

SCALE = 0.1
"""Distance [m] that counts as a whole limit where what is limited is a distance: one at the border, zero so far
inside."""


def carried_by(tree: Tree, links: Sequence[int]) -> Array:
    """One where a joint moves a link, else zero, shape (m, n)."""
    mask = np.zeros((len(links), tree.n))
    for row, link in zip(mask, links, strict=True):
        row[tree.ancestors(link)] = 1.0
    return mask


def _axes(tree: Tree, poses: tuple[Array, Array]) -> tuple[Array, Array]:
    """Directions of the joints' axes (N, n, 3), and their moments about the base's origin."""
    R, p = poses
    axes: Array = np.einsum("njik,jk->nji", R, tree.axis)
    moments: Array = np.cross(p, axes)
    return axes, moments


def point_gradient(tree: Tree, poses: tuple[Array, Array], mask: Array, points: Array, forces: Array) -> Array:
    """Gradient by q of forces · points: the torque that the forces make about each joint.

    Args:
        tree: The arm's geometry.
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of its links.
        mask: Which joints move each point, shape (m, n).
        points: In the base frame, shape (N, m, 3) [m].
        forces: Shape (N, m, 3).

    Returns:
        Shape (N, m, n).
    """
    axes, moments = _axes(tree, poses)
    turning = np.cross(points, forces) @ axes.transpose(0, 2, 1) + forces @ moments.transpose(0, 2, 1)
    if tree.prismatic.any():
        turning = np.where(tree.prismatic.astype(bool), forces @ axes.transpose(0, 2, 1), turning)
    return turning * mask


def point_speed(tree: Tree, poses: tuple[Array, Array], mask: Array, points: Array, speed: Array) -> Array:
    """Bound (N, m) [m/s] of the speed of points (N, m, 3), from the joints' speeds (n,) [rad/s or m/s]."""
    axes, moments = _axes(tree, poses)
    arms = np.cross(axes[:, None], points[:, :, None]) + moments[:, None]
    reach = np.where(tree.prismatic.astype(bool), 1.0, np.linalg.norm(arms, axis=-1))
    return (reach * mask) @ speed


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
        forces = weights[:, :, None] * self.normals / SCALE
        places = np.broadcast_to(self._tip(states)[:, None], forces.shape)
        mask = carried_by(states.tree, [states.robot.tip.parent] * len(self.labels))
        return states.pull_positions(point_gradient(states.tree, states.poses, mask, places, forces))

    def between(self, states: States, step: float) -> Array:
        """Tell how far the tip may go between points of a grid, as a share."""
        mask = carried_by(states.tree, [states.robot.tip.parent])
        speed = point_speed(states.tree, states.poses, mask, self._tip(states)[:, None], states.speed_bound)
        return np.full(len(self.labels), 0.5 * step * float(speed.max()) / SCALE)


def box_workspace(low: Sequence[float], high: Sequence[float]) -> Workspace:
    """The tip stays inside a box of the base frame, between two corners (3,) [m]."""
    normals = np.vstack([-np.eye(3), np.eye(3)])
    labels = tuple(f"{side} {axis}" for side in ("low", "high") for axis in "xyz")
    return Workspace("tip", labels, normals, np.concatenate([-np.asarray(low), np.asarray(high)]))
