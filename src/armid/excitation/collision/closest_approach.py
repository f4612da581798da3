"""Closest approach of bodies along a motion, computed with Coal after a plan is finished.

The search and the certificate of a plan use capsules and hulls. This module computes the distance of every pair
again, pose by pose. Primitive shapes (sphere, box, capsule) are represented exactly. A cylinder is enclosed in a
prism. A mesh is cut into slices and replaced by the convex hulls of the slices, which together contain the mesh. For
the few pairs whose hulls overlap although the bodies do not, the triangles of the meshes are used. The distance of
adjacent links depends only on the joint between them; it is therefore computed for positions of this joint. Preflight
pages and the exit code of `armid excite` report these distances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.excitation.collision.adjacent_link_collisions import ROUGH, AdjacentPair, spread_positions
from armid.excitation.collision.coal import distances, too_close, whole
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.collision.hull_distances import parts_of
from armid.robot.collision_body_names import BodyPair
from armid.robot.kinematics import forward_kinematics
from armid.robot.robot import Robot

RATE = 250.0
"""Rate of the poses of a motion in which distances of bodies are computed [Hz]."""

EVERY = 5
"""Stride of the poses in which distances are computed first; then the poses next to the closest one are added. For
pairs whose distance is computed with their triangles, all poses in which the required distance is not kept are
added."""

FIRST = 8
"""Number of poses with the closest capsules, in which distances are computed before all other poses."""

NEAR = 0.05
"""Lower bound of the distance of a pair below which it is tested whether its distance is constant [m]. Pairs that are
further apart are not tested, because lists name the closest pairs first."""

CONSTANT = 3e-3
"""Largest change of a distance at which it counts as constant [m]. If the real distance of two neighbouring links is
constant, the distance of their hulls changes by up to 2.5 mm (measured at the wrist of the robot TIAGo)."""

MOMENTS = 24
"""Number of poses of a motion in which it is tested whether the distance of a pair is constant. If it is, random
poses in the whole range of the joints are tested, too, because a motion may stay in a region in which the distance
hardly changes."""

RANDOM = 100
"""Number of random poses in which it is tested whether the distance of a pair is constant."""

CLOSER = 16
"""Number of additional positions of a joint, around the position with the smallest distance, at which the distance of
adjacent links is computed."""

ROUNDING = 1e-6
"""Tolerance in comparisons of the iterative distances of Coal with distances that certify a plan [m]."""


@dataclass(frozen=True, slots=True)
class ClosestApproach:
    """Closest approach of two bodies.

    Attributes:
        pair: Names of the two bodies.
        distance: Smallest distance between the two bodies [m]; negative if they overlap.
        time: Time of the closest approach [s].
        required_distance: Required distance [m].
        measured: Representation of the bodies with which the distance was computed: `bodies`, `hulls` or `triangles`.
        constant: True if the distance is small and changes by at most 3 mm in the motion and in random poses.
            Neighbouring links that rotate against each other with a narrow gap are an example.
    """

    pair: BodyPair
    distance: float
    time: float
    required_distance: float
    measured: str = "bodies"
    constant: bool = False

    @property
    def is_sufficient(self) -> bool:
        """True if the smallest distance is at least the required distance, except for rounding."""
        return self.distance >= self.required_distance - ROUNDING


def closest_approaches(
    collision: CollisionOptions, robot: Robot, times: Array, q: Array
) -> tuple[ClosestApproach, ...]:
    """Closest approach of every checked pair of bodies along a motion, nearest first; constant distances last.

    Args:
        collision: Pairs of bodies that must be kept apart.
        robot: The arm.
        times: Times of the poses, shape (N,) [s].
        q: Positions of the joints at these times, shape (N, n) [rad or m].
    """
    poses = forward_kinematics(robot, q)
    anywhere = random_poses(collision, robot)
    adjacent = collision.adjacent.checked
    found = [_of_adjacent(collision, each, times, q[:, each.joint], poses, anywhere) for each in adjacent]
    bound = collision.every.bodies.distances(poses) if len(collision.pairs) else np.zeros((len(times), 0))
    constant = np.isfinite(constant_distances(collision, poses, bound, anywhere)).tolist()
    if len(collision.pairs):
        margins = collision.every.margins
        for k, label in enumerate(collision.every.labels):
            distance, at = _least(collision, collision.pairs[k], bound[:, k], poses)
            meshes = any(collision.shapes[i].kind in ("mesh", "cylinder", "ellipsoid") for i in collision.pairs[k])
            by, asked = "hulls" if meshes else "bodies", float(margins[k])
            found.append(ClosestApproach(label, distance, float(times[at]), asked, by, constant[k]))
    for k, (pair, kept) in enumerate(
        zip(collision.measured, collision.required_distances, strict=True), len(collision.pairs)
    ):
        distance, at = _by_triangles(collision, pair, float(kept), poses)
        label = BodyPair(*(collision.shapes[i].name for i in pair))
        found.append(ClosestApproach(label, distance, float(times[at]), float(kept), "triangles", constant[k]))
    return tuple(sorted(found, key=lambda each: (each.constant, each.distance)))


@dataclass(frozen=True, eq=False, slots=True)
class AdjacentDistances:
    """Distances of two bodies of adjacent links over the range of the joint between them.

    Attributes:
        which: Indices of the poses in which the distance was computed, in ascending order of the joint's positions,
            shape (k,).
        distance: Distances in these poses, shape (k,) [m].
        by_hulls: True if the distances are those of convex hulls of meshes, which are used if the hulls are far
            apart.
    """

    which: NDArray[np.intp]
    distance: Array
    by_hulls: bool

    def is_constant(self, collision: CollisionOptions, pair: AdjacentPair, anywhere: tuple[Array, Array]) -> bool:
        """Checks whether the distance of a pair is small and constant, as the gap at a joint is.

        Args:
            collision: Pairs of bodies that must be kept apart.
            pair: The two bodies to which the distances belong.
            anywhere: Random poses from `random_poses`, in which the distance is compared, too.
        """
        if len(self.which) < 2 or np.ptp(self.distance) > CONSTANT or self.distance.min() >= NEAR:
            return False
        if pair.constant:
            return True
        parts = parts_of if self.by_hulls else whole
        others = distances(collision.shapes, np.array([pair.bodies]), anywhere, parts)[:, 0]
        return bool(np.ptp(np.concatenate([self.distance, others])) <= CONSTANT)


def adjacent_distances(
    collision: CollisionOptions, pair: AdjacentPair, q: Array, poses: tuple[Array, Array]
) -> AdjacentDistances:
    """Distances of two bodies of adjacent links along a motion.

    Args:
        collision: Pairs of bodies that must be kept apart.
        pair: The two bodies.
        q: Positions of the joint between them, shape (N,) [rad or m].
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
    """
    which = spread_positions(q, ROUGH) if pair.constant else spread_positions(q)
    some = poses[0][which], poses[1][which]
    found = distances(collision.shapes, np.array([pair.bodies]), some, parts_of)[:, 0]
    if found.min() > 2.0 * pair.required_distance:
        return AdjacentDistances(which, found, by_hulls=True)
    found = distances(collision.shapes, np.array([pair.bodies]), some)[:, 0]
    return AdjacentDistances(which, found, by_hulls=False)


def _of_adjacent(
    collision: CollisionOptions,
    pair: AdjacentPair,
    times: Array,
    q: Array,
    poses: tuple[Array, Array],
    anywhere: tuple[Array, Array],
) -> ClosestApproach:
    """Closest approach of two bodies of adjacent links; `q` are the positions (N,) of the joint between them."""
    found = adjacent_distances(collision, pair, q, poses)
    at = int(found.distance.argmin())
    low, high = q[found.which[max(at - 1, 0)]], q[found.which[min(at + 1, len(found.which) - 1)]]
    near = np.flatnonzero((q >= low) & (q <= high))
    few = 1 if pair.constant else CLOSER
    near = near[q[near].argsort(kind="stable")][np.unique(np.linspace(0, len(near) - 1, few).astype(np.intp))]
    some, parts = (poses[0][near], poses[1][near]), parts_of if found.by_hulls else whole
    closer = distances(collision.shapes, np.array([pair.bodies]), some, parts)[:, 0]
    which = np.concatenate([found.which, near])
    distance = np.concatenate([found.distance, closer])
    k = int(distance.argmin())
    meshes = any(collision.shapes[i].kind in ("mesh", "cylinder", "ellipsoid") for i in pair.bodies)
    by = ("hulls" if found.by_hulls else "triangles") if meshes else "bodies"
    constant = float(distance[k]) >= pair.required_distance and found.is_constant(collision, pair, anywhere)
    return ClosestApproach(
        pair.pair, float(distance[k]), float(times[which[k]]), pair.required_distance, by, constant
    )


def random_poses(collision: CollisionOptions, robot: Robot) -> tuple[Array, Array]:
    """Rotations (k, n, 3, 3) and origins (k, n, 3) of the links in random poses in the range of the joints."""
    low, high = collision.adjacent.reach.T
    return forward_kinematics(robot, np.random.default_rng(0).uniform(low, high, (RANDOM, robot.n)))


def constant_distances(
    collision: CollisionOptions, poses: tuple[Array, Array], bound: Array, anywhere: tuple[Array, Array]
) -> Array:
    """Distances of pairs of links that are built close to each other and keep the same distance in all poses.

    A distance counts as constant if it changes by at most `CONSTANT`, in the motion and in random poses. Three cases
    are not counted: distances below the required one, distances to the surroundings, and the case that all distances
    are constant because the arm hardly moves.

    Args:
        collision: Pairs of bodies that must be kept apart.
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
        bound: Lower bounds of the distances of `collision.pairs` in these poses, shape (N, m) [m].
        anywhere: Random poses from `random_poses`.

    Returns:
        Distances of the pairs of `collision.pairs` and then of `collision.measured`, shape (m + r,) [m]; NaN for
        pairs whose distance changes, and for all pairs if there is only one pose.
    """
    count = len(collision.pairs)
    result = np.full(count + len(collision.measured), np.nan)
    if len(poses[1]) < 2:
        return result
    moments = np.unique(np.linspace(0, len(poses[1]) - 1, MOMENTS).astype(np.intp))
    some = poses[0][moments], poses[1][moments]
    required = np.concatenate([collision.every.margins if count else [], collision.required_distances])
    near = np.flatnonzero(bound.min(axis=0) < NEAR).tolist()
    for k in (*near, *range(count, len(result))):
        pair = collision.pairs[[k]] if k < count else collision.measured[[k - count]]
        parts = parts_of if k < count else whole
        apart = distances(collision.shapes, pair, some, parts)[:, 0]
        apart = np.maximum(apart, bound[moments, k]) if k < count else apart
        if np.ptp(apart) > CONSTANT or apart.min() < required[k] - ROUNDING or pair.max() >= collision.own:
            continue
        others = distances(collision.shapes, pair, anywhere, parts)[:, 0]
        if k < count:
            others = np.maximum(others, collision.every.bodies.only([k]).distances(anywhere)[:, 0])
        if np.ptp(np.concatenate([apart, others])) <= CONSTANT:
            result[k] = apart.min()
    return np.full(len(result), np.nan) if np.isfinite(result).all() else result


def _least(
    collision: CollisionOptions, pair: NDArray[np.intp], bound: Array, poses: tuple[Array, Array]
) -> tuple[float, int]:
    """Smallest distance [m] of the convex parts of two bodies, and index of the pose in which it occurs.

    Args:
        collision: Pairs of bodies that must be kept apart.
        pair: Indices of the two bodies, shape (2,).
        bound: Lower bounds of the distance in the poses, shape (N,) [m].
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
    """

    def measured(which: NDArray[np.intp]) -> Array:
        some = poses[0][which], poses[1][which]
        # Capsules and convex parts both contain the body, so the larger distance holds; a simplified hull may reach
        # beyond the capsules.
        return np.maximum(distances(collision.shapes, pair[None], some, parts_of)[:, 0], bound[which])

    coarse = np.arange(0, len(bound), EVERY)
    coarse = coarse[bound[coarse].argsort(kind="stable")]
    first = coarse[:FIRST]
    seen = measured(first)
    candidates = coarse[FIRST:][bound[coarse[FIRST:]] < seen.min()]
    where, distance = np.concatenate([first, candidates]), np.concatenate([seen, measured(candidates)])
    middle = int(where[distance.argmin()])
    neighbours = np.arange(max(middle - EVERY + 1, 0), min(middle + EVERY, len(bound)))
    where, distance = np.concatenate([where, neighbours]), np.concatenate([distance, measured(neighbours)])
    k = int(distance.argmin())
    return float(distance[k]), int(where[k])


def _by_triangles(
    collision: CollisionOptions, pair: NDArray[np.intp], kept: float, poses: tuple[Array, Array]
) -> tuple[float, int]:
    """Smallest distance [m] of two bodies, computed with their triangles, and index of the pose in which it occurs.

    The distance is computed in every 25th pose and in all poses in which it is below the required one, `kept` [m].
    """
    wrong = np.flatnonzero(too_close(collision.shapes, pair, kept, poses))
    which = np.union1d(np.arange(0, len(poses[1]), EVERY * EVERY), wrong)
    some = poses[0][which], poses[1][which]
    apart = distances(collision.shapes, pair[None], some)[:, 0]
    k = int(apart.argmin())
    return float(apart[k]), int(which[k])
