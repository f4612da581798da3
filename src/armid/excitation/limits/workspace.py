"""Workspace limits of the tip of the arm, with gradients and bounds of the speed of points on the arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.excitation.limits.constraint_channels import States
from armid.kernel.tree import Tree

SCALE = 0.1
"""Distance of a body or point from its limit at which the utilisation is zero [m]; at the limit the utilisation is
one."""


def carried_by(tree: Tree, links: Sequence[int]) -> Array:
    """Mask (m, n) of the joints that move each of m links: 1 if the joint moves the link, otherwise 0."""
    mask = np.zeros((len(links), tree.n))
    for row, link in zip(mask, links, strict=True):
        row[tree.ancestors(link)] = 1.0
    return mask


def _axes(tree: Tree, poses: tuple[Array, Array]) -> tuple[Array, Array]:
    """Directions (N, n, 3) of the joint axes, and their moments (N, n, 3) about the origin of the base frame."""
    R, p = poses
    axes: Array = np.einsum("njik,jk->nji", R, tree.axis)
    moments: Array = np.cross(p, axes)
    return axes, moments


def point_gradient(tree: Tree, poses: tuple[Array, Array], mask: Array, points: Array, forces: Array) -> Array:
    """Gradient by q of the scalar product of forces and points, which equals the joint torque of the forces.

    Args:
        tree: The arm's geometry.
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
        mask: Mask of the joints that move each point, from `carried_by`, shape (m, n).
        points: Points in the base frame, shape (N, m, 3) [m].
        forces: Weights of the coordinates of the points, shape (N, m, 3).

    Returns:
        Gradient, shape (N, m, n).
    """
    axes, moments = _axes(tree, poses)
    turning = np.cross(points, forces) @ axes.transpose(0, 2, 1) + forces @ moments.transpose(0, 2, 1)
    if tree.prismatic.any():
        turning = np.where(tree.prismatic.astype(bool), forces @ axes.transpose(0, 2, 1), turning)
    return turning * mask


def point_speed(tree: Tree, poses: tuple[Array, Array], mask: Array, points: Array, speed: Array) -> Array:
    """Upper bound (N, m) [m/s] of the speeds of points (N, m, 3) for joint speeds (n,) [rad/s or m/s]."""
    axes, moments = _axes(tree, poses)
    arms = np.cross(axes[:, None], points[:, :, None]) + moments[:, None]
    reach = np.where(tree.prismatic.astype(bool), 1.0, np.linalg.norm(arms, axis=-1))
    return (reach * mask) @ speed


@dataclass(frozen=True, eq=False, slots=True)
class Workspace:
    """Constraint channel of planes that the tip of the arm must not cross; a box has six planes.

    Attributes:
        name: Name of the limited quantity.
        labels: Names of the planes.
        normals: Unit normals that point out of the workspace, in the base frame, shape (m, 3).
        offsets: Largest allowed scalar product of normal and position of the tip, shape (m,) [m].
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
        """Utilisations (N, m): one minus the distance of the tip from each plane, divided by `SCALE`."""
        return 1.0 - (self.offsets - self._tip(states) @ self.normals.T) / SCALE

    def pullback(self, states: States, weights: Array) -> Array:
        """Gradients (m, n k), by the unknowns, of the sums over the samples of utilisations times weights (N, m)."""
        forces = weights[:, :, None] * self.normals / SCALE
        points = np.broadcast_to(self._tip(states)[:, None], forces.shape)
        mask = carried_by(states.tree, [states.robot.tip.parent] * len(self.labels))
        return states.pullback_positions(point_gradient(states.tree, states.poses, mask, points, forces))

    def between(self, states: States, step: float) -> Array:
        """Upper bound (m,) of the rise of the utilisations between grid points, from the speed of the tip."""
        mask = carried_by(states.tree, [states.robot.tip.parent])
        speed = point_speed(states.tree, states.poses, mask, self._tip(states)[:, None], states.speed_bound)
        return np.full(len(self.labels), 0.5 * step * float(speed.max()) / SCALE)


def box_workspace(low: Sequence[float], high: Sequence[float]) -> Workspace:
    """Workspace that is a box in the base frame, given by two opposite corners (3,) [m]."""
    normals = np.vstack([-np.eye(3), np.eye(3)])
    labels = tuple(f"{side} {axis}" for side in ("low", "high") for axis in "xyz")
    return Workspace("tip", labels, normals, np.concatenate([-np.asarray(low), np.asarray(high)]))
