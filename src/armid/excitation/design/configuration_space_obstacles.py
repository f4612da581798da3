"""Constraint channel for pairs of bodies whose distance gives a search no direction, by maps of joint positions.

For such a pair, bounding volumes are too wide: capsules and hulls overlap although the bodies do not. However, at
most two joints are between the two bodies. Coal therefore tests the bodies themselves on a grid of positions of these
joints. In the plane of the two positions, the bodies are too close in some region; the channel limits the distance of
the motion from this region. The distance of the bodies is checked again when the plan is finished.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from armid.checked_array import Array
from armid.excitation.collision.coal import too_close
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.collision.pairs import joints_on_path
from armid.excitation.limits.constraint_channels import States
from armid.excitation.limits.joint_limits import Limits
from armid.robot.collision_body_names import BodyPair
from armid.robot.kinematics import forward_kinematics
from armid.robot.robot import Robot

POSITIONS = 41
"""Number of positions of each of the two joints at which the bodies are tested."""

SCALE = 0.5
"""Distance, in the plane of two joint positions, from the region in which bodies are too close, at which the
utilisation is zero [rad, or share of the range of a prismatic joint]."""

SPARE, SPARED = 0.5, 0.9
"""Additional distance that a search keeps from the region in which bodies are too close, in steps of the grid; and
its largest value, divided by the distance of the start pose from this region."""

JOINTS = 2
"""Number of joints between the two bodies of a pair for which a grid of joint positions is computed."""


@dataclass(frozen=True, eq=False, slots=True)
class PositionMap:
    """Map of the distance to the region in which a pair of bodies is too close, over the positions of two joints.

    Attributes:
        pair: Names of the bodies.
        joints: Indices of the two joints.
        low: Positions at the beginning of the grid, shape (2,) [rad or m].
        step: Steps of the grid, shape (2,) [rad or m].
        distance: Distances at the points of the grid, shape (`POSITIONS`, `POSITIONS`) [rad; for a prismatic joint,
            share of its range]; negative inside the region.
        spare: Additional distance that a search keeps, in the unit of `distance`.
    """

    pair: BodyPair
    joints: tuple[int, int]
    low: Array
    step: Array
    distance: Array
    spare: float = 0.0

    def at(self, q: Array) -> tuple[Array, Array]:
        """Distances (N,) from the region in poses (N, n), interpolated, and gradients (N, 2) by the two positions."""
        place = np.clip((q[:, self.joints] - self.low) / self.step, 0.0, POSITIONS - 1.0)
        cell = np.minimum(place.astype(np.intp), POSITIONS - 2)
        u, v = (place - cell).T
        i, j = cell.T
        table = self.distance
        a, b, c, d = table[i, j], table[i + 1, j], table[i, j + 1], table[i + 1, j + 1]
        value = (1.0 - u) * (1.0 - v) * a + u * (1.0 - v) * b + (1.0 - u) * v * c + u * v * d
        slopes = np.column_stack([(1.0 - v) * (b - a) + v * (d - c), (1.0 - u) * (c - a) + u * (d - b)])
        return value, slopes / self.step


@dataclass(frozen=True, eq=False, slots=True)
class MeasuredPairs:
    """Constraint channel for a search that keeps pairs of bodies apart by maps of the positions of two joints.

    Attributes:
        name: Name of the limited quantity.
        maps: Map of each pair.
    """

    name: str
    maps: tuple[PositionMap, ...]

    @property
    def labels(self) -> tuple[BodyPair, ...]:
        """Names of the two bodies of each pair."""
        return tuple(each.pair for each in self.maps)

    def values(self, states: States) -> Array:
        """Utilisations (N, m): 1 - d / `SCALE`, with the distance d in joint space from colliding positions."""
        q = states.derivatives[0]
        return np.column_stack([1.0 - (each.at(q)[0] - each.spare) / SCALE for each in self.maps])

    def pullback(self, states: States, weights: Array) -> Array:
        """Gradients (m, n k), by the unknowns, of the sums over the samples of utilisations times weights (N, m)."""
        q = states.derivatives[0]
        by_q = np.zeros((*weights.shape, states.basis.n))
        for k, each in enumerate(self.maps):
            by_q[:, k, each.joints] = -weights[:, k, None] * each.at(q)[1] / SCALE
        return states.pullback_positions(by_q)

    def between(self, states: States, step: float) -> Array:
        """Upper bound (m,) of the rise of each utilisation between neighbouring points of a grid with a step [s]."""
        rises = [
            sum(
                float(states.speed_bound[j] * np.abs(np.diff(each.distance, axis=k)).max() / each.step[k])
                for k, j in enumerate(each.joints)
            )
            for each in self.maps
        ]
        return 0.5 * step / SCALE * np.array(rises)


def measured_pairs(
    collision: CollisionOptions, robot: Robot, limits: Limits, start: Array
) -> tuple[MeasuredPairs, ...]:
    """Constraint channel of the pairs of `collision.measured` that a search must keep apart; empty without pairs.

    Args:
        collision: Pairs of bodies that must be kept apart.
        robot: The arm.
        limits: Limits of the joints.
        start: Start pose, shape (n,) [rad or m].
    """
    low = np.where(np.isfinite(limits.lower), limits.lower, start - np.pi)
    high = np.where(np.isfinite(limits.upper), limits.upper, start + np.pi)
    maps: list[PositionMap] = []
    for pair, kept in zip(collision.measured, collision.required_distances, strict=True):
        a, b = (collision.shapes[k] for k in pair)
        joints = joints_on_path(robot, a.link, b.link)
        if len(joints) != JOINTS:
            continue
        grids = [np.linspace(low[j], high[j], POSITIONS) for j in joints]
        q = np.tile(start, (POSITIONS**2, 1))
        q[:, joints] = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, JOINTS)
        close = too_close(collision.shapes, pair, float(kept), forward_kinematics(robot, q))
        if not close.any():
            continue
        found = _map(robot, BodyPair(a.name, b.name), joints, grids, close.reshape(POSITIONS, POSITIONS))
        here = float(found.at(start[None])[0][0])
        if here > 0.0:
            maps.append(replace(found, spare=min(found.spare, SPARED * here)))
    return (MeasuredPairs("collision", tuple(maps)),) if maps else ()


def _map(
    robot: Robot, pair: BodyPair, joints: Sequence[int], grids: Sequence[Array], close: NDArray[np.bool_]
) -> PositionMap:
    """Makes the map of a pair from the mask of the grid points at which its bodies are too close.

    `grids` are the positions of the two joints on the grid.
    """
    first, second = joints
    step = np.array([grid[1] - grid[0] for grid in grids])
    slides = [robot.joints[j].is_prismatic for j in joints]
    unit = np.where(slides, 1.0 / (POSITIONS - 1), step)
    outside, inside = (np.asarray(distance_transform_edt(each, sampling=unit)) for each in (~close, close))
    # The border lies between the points of the grid, half a step from either side.
    half = 0.5 * float(unit.min())
    distance = np.where(close, half - inside, outside - half)
    low = np.array([grid[0] for grid in grids])
    return PositionMap(pair, (first, second), low, step, distance, SPARE * float(unit.max()))
