"""Nearest pair of bodies of an arm and its surroundings over a motion.

Bodies, pairs and distances are the same as in the preflight report (`armid.excitation.collision.closest_approach`),
so the results of both agree. The distances of capsules around the bodies are lower bounds; NumPy computes them for
all moments at once. Coal then measures the pairs in the order of these bounds until the next bound is larger than the
smallest distance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.excitation.collision.closest_approach import adjacent_distances, constant_distances, random_poses
from armid.excitation.collision.coal import nearest, whole
from armid.excitation.collision.collision_model import CollisionOptions, looked_at, make_collision_model
from armid.excitation.collision.hull_distances import parts_of
from armid.excitation.limits.joint_limits import described_limits
from armid.report.preview.animation_frames import Clip
from armid.robot.kinematics import forward_kinematics
from armid.robot.robot import Robot
from armid.robot.shapes import Shape

MOMENTS = 600
"""Largest number of moments at which distances are computed; the page interpolates between them."""


@dataclass(frozen=True, eq=False, slots=True)
class NearestBodies:
    """Nearest pair of bodies over time, at M moments.

    Attributes:
        time: Times of the moments, shape (M,) [s].
        distance: Smallest distance, shape (M,) [m]; negative if bodies overlap.
        pair: Index of the pair in `pairs`, shape (M,).
        points: Nearest points of both bodies in the base frame, shape (M, 2, 3) [m].
        pairs: Names of all checked pairs.
        constant: Pairs that are close to each other and have the same distance in all poses, with their distances
            [m]; they are never shown as the nearest pair.
    """

    time: Array
    distance: Array
    pair: NDArray[np.intp]
    points: Array
    pairs: tuple[str, ...]
    constant: tuple[tuple[str, float], ...] = ()


def bodies_to_watch(robot: Robot, surroundings: tuple[Shape, ...] = ()) -> CollisionOptions | None:
    """Bodies and pairs to check for collisions along a motion that was not designed; `None` without bodies.

    Raises:
        ArmidError: Meshes are missing or cannot be read.
    """
    if not robot.shapes:
        return None
    limits = described_limits(robot)
    moving = np.where(np.isfinite(limits.velocity), limits.velocity, 1.0)
    cell = make_collision_model(robot, replace(limits, velocity=moving), surroundings)
    return looked_at(cell.without_dispensable())


def closest(robot: Robot, clip: Clip, collision: CollisionOptions) -> NearestBodies | None:
    """Nearest pair of bodies at each moment of a motion; `None` if no pair is checked.

    Args:
        robot: The arm.
        clip: The motion.
        collision: Bodies, and pairs that are checked.
    """
    shapes, count = collision.shapes, len(collision.pairs)
    adjacent = collision.adjacent.checked
    pairs = np.vstack([collision.pairs, collision.measured, *(each.bodies for each in adjacent)])
    if not len(pairs):
        return None
    moments = np.unique(np.linspace(0, len(clip.time) - 1, MOMENTS).astype(np.intp))
    q = clip.q[moments]
    turned, placed = forward_kinematics(robot, q)
    bound = np.full((len(moments), len(pairs)), -np.inf)
    bound[:, :count] = collision.every.bodies.distances((turned, placed)) if count else 0.0
    gaps = np.full(len(pairs), np.nan)
    apart = len(pairs) - len(adjacent)
    anywhere = random_poses(collision, robot)
    gaps[:apart] = constant_distances(collision, (turned, placed), bound[:, :count], anywhere)
    for k, each in enumerate(adjacent, apart):
        found = adjacent_distances(collision, each, q[:, each.joint], (turned, placed))
        bound[:, k] = np.interp(q[:, each.joint], q[found.which, each.joint], found.distance)
        gaps[k] = found.distance.min() if found.is_constant(collision, each, anywhere) else np.nan
    bound[:, np.isfinite(gaps)] = np.inf
    samples = len(moments)
    distance, pair, points = np.full(samples, np.inf), np.zeros(samples, np.intp), np.zeros((samples, 2, 3))
    for k, order in enumerate(bound.argsort(axis=1)):
        pose = turned[k : k + 1], placed[k : k + 1]
        for m in order:
            if bound[k, m] >= distance[k]:
                break
            measured, first, second, _ = nearest(shapes, pairs[m : m + 1], pose, parts_of if m < count else whole)
            separation = max(measured[0, 0], bound[k, m])  # lower bounds, and interpolated ones of adjacent links
            if separation < distance[k]:
                distance[k], pair[k], points[k] = separation, m, (first[0, 0], second[0, 0])
    names = tuple(f"{shapes[a].name} – {shapes[b].name}" for a, b in pairs)
    constant = tuple((names[k], float(gaps[k])) for k in np.flatnonzero(np.isfinite(gaps)))
    return NearestBodies(clip.time[moments], distance, pair, points, names, constant)
