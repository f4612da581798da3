"""Bodies that could meet, and those of them that a plan keeps apart: links, and links and surroundings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.errors import ArmidError
from armid.excitation.collision.coal import distances, too_close
from armid.excitation.collision.convex_hulls import Hulls
from armid.excitation.collision.distances import Clearance, CollisionBodies
from armid.excitation.collision.pairs import pairs_of_bodies
from armid.excitation.collision.required_distances import (
    BY_CAPSULES,
    CONSTRUCTION,
    LEFT_OUT,
    MEASURED,
    RequiredDistances,
    everything,
    settled,
)
from armid.excitation.limits.joint_limits import Limits
from armid.robot.kinematics import forward_kinematics
from armid.robot.robot import Robot
from armid.robot.shapes import Shape
from armid.robot.visual_bodies import missing_bodies
from armid.values import Array

__all__ = [
    "CollisionModel",
    "CollisionOptions",
    "IgnoredPair",
    "collision_of",
    "empty_collision_model",
    "kept_apart",
    "looked_at",
    "make_collision_model",
]

LOOKED = 3000
"""Random poses in which pairs are looked at, to leave out of a search those that never come near each other."""

TRIED = 300
"""Of these, poses in which bodies are measured as they are, or by convex bodies closer around them than capsules."""

NEAR = 0.08
"""Distance beyond the margin [m] within which a pair in any of these poses takes part in the search."""

HALF_STEP, CERTIFICATE = 0.0005, 0.003
"""A search keeps beyond the margin what bodies come together in half a step of the certificate's grid [s] with all
joints at their fastest, so that the certificate need not draw the plan together; no more than so many metres."""

SPARED = 0.9
"""Share of what the start pose has beyond the margin that a search may keep free."""

ROUNDING = 1e-9
"""Metres."""


@dataclass(frozen=True, slots=True)
class IgnoredPair:
    """Two bodies that touch by construction and are not looked at.

    Attributes:
        pair: Their names.
        share: Of some random poses in which the bodies themselves overlap, or, of the first link above what the arm
            is mounted on, are closer than what is asked, 0 to 1.
    """

    pair: str
    share: float


@dataclass(frozen=True, eq=False, slots=True)
class CollisionOptions:
    """Pairs that a plan keeps apart.

    Attributes:
        searched: Pairs that could come near each other, for the search.
        every: All pairs that are kept apart by what is around the bodies, for the last word.
        skipped: Pairs that are not looked at.
        shapes: The bodies as they are, the surroundings last.
        pairs: Indices into `shapes` of the pairs of `every`, shape (m, 2).
        own: How many of the shapes are the arm's.
        measured: Indices into `shapes` of pairs that are measured as they are at the end, shape (r, 2).
        kept: Distances that these keep, shape (r,) [m].
    """

    searched: Clearance | None
    every: Clearance
    skipped: tuple[IgnoredPair, ...]
    shapes: tuple[Shape, ...]
    pairs: NDArray[np.intp]
    own: int
    measured: NDArray[np.intp]
    kept: Array

    @property
    def surroundings(self) -> tuple[Shape, ...]:
        """Bodies that do not move."""
        return self.shapes[self.own :]

    def clear(self, robot: Robot, q: Array) -> NDArray[np.bool_]:
        """Tell whether all pairs keep what they should in poses (N, n), shape (N,)."""
        poses = forward_kinematics(robot, q)
        result = (self.every.bodies.distances(poses) > self.every.margins).all(axis=1)
        for pair, kept in zip(self.measured, self.kept, strict=True):
            result &= ~too_close(self.shapes, pair, float(kept), poses)
        return np.asarray(result)

    def clear_as_they_are(self, robot: Robot, q: Array) -> bool:
        """Tell whether bodies that are measured as they are keep their distance in all of some poses (N, n)."""
        poses = forward_kinematics(robot, q)
        return not any(
            too_close(self.shapes, pair, float(kept), poses).any()
            for pair, kept in zip(self.measured, self.kept, strict=True)
        )


@dataclass(frozen=True, eq=False, slots=True)
class CollisionModel:
    """An arm and its surroundings, with all pairs of bodies that a motion could bring together.

    Attributes:
        robot: The arm.
        shapes: The bodies as they are, the surroundings last.
        bodies: Capsules, solids, their pairs, and hulls for pairs whose capsules touch in most poses.
        pairs: Indices into `shapes` of these pairs, shape (m, 2).
        keeping: What each pair keeps, and how it is looked at.
        nearest: Least distance of each pair in many random poses, shape (m,) [m].
        touching: Share of these poses in which each pair is closer than what is asked, shape (m,).
        tried: Some of these poses, shape (k, n).
    """

    robot: Robot
    shapes: tuple[Shape, ...]
    bodies: CollisionBodies
    pairs: NDArray[np.intp]
    keeping: RequiredDistances
    nearest: Array
    touching: Array
    tried: Array

    def room(self, q: Array) -> Array:
        """Least distance beyond what each pair keeps in poses (N, n), shape (N,) [m]; negative is too close."""
        looked = self.keeping.of(BY_CAPSULES)
        return (self.distances(q) - self.keeping.margin)[:, looked].min(axis=1, initial=np.inf)

    def clear(self, q: Array) -> Array:
        """The same less what a search keeps besides, shape (N,) [m]."""
        looked = self.keeping.of(BY_CAPSULES)
        kept = self.keeping.margin + self.keeping.spare
        return (self.distances(q) - kept)[:, looked].min(axis=1, initial=np.inf)

    def apart(self, q: Array) -> NDArray[np.bool_]:
        """Tell whether the pairs that are measured as they are keep their distance in poses (N, n), shape (N,)."""
        which = self.keeping.of(MEASURED)
        found = distances(self.shapes, self.pairs[which], forward_kinematics(self.robot, q))
        return np.asarray((found > self.keeping.margin[which]).all(axis=1))

    def distances(self, q: Array) -> Array:
        """Distance of each pair in poses (N, n), shape (N, m) [m]."""
        return self.bodies.distances(forward_kinematics(self.robot, q))

    def closer(self, which: NDArray[np.intp], margin: float) -> CollisionModel:
        """The same with some of the pairs, rising, measured by hulls where these lie closer around the bodies."""
        hulls, poses = Hulls(self.shapes, self.pairs[which], which), forward_kinematics(self.robot, self.tried)
        apart, before = hulls.distances(poses), self.bodies.distances(poses)[:, which]
        better = apart.sum(axis=0) > before.sum(axis=0) + ROUNDING
        kept = np.union1d(self.bodies.hulls.at, which[better])
        touching, nearest = self.touching.copy(), self.nearest.copy()
        touching[which[better]] = (apart < margin).mean(axis=0)[better]
        nearest[which[better]] = apart.min(axis=0)[better]
        bodies = replace(self.bodies, hulls=Hulls(self.shapes, self.pairs[kept], kept))
        return replace(self, bodies=bodies, nearest=nearest, touching=touching)


def make_collision_model(
    robot: Robot, limits: Limits, surroundings: Sequence[Shape] = (), *, margin: float = 0.02
) -> CollisionModel:
    """An arm among bodies, looked at in many random poses.

    Raises:
        ArmidError: The description has no shapes, or the margin is negative.
    """
    missing = missing_bodies(robot)
    if missing:
        raise ArmidError(
            f"Collisions of {robot.name} cannot be checked: {missing[0].evidence}.",
            remedy="say where its package is with --package NAME=DIR (or ROS_PACKAGE_PATH, AMENT_PREFIX_PATH), put "
            "the meshes beside the description, or leave the check out with --no-collision.",
        )
    if not robot.shapes:
        raise ArmidError(
            f"The description of {robot.name} does not say what space its links take; collisions cannot be checked.",
            remedy="give a URDF with <collision> bodies, or a DH table with capsules; or --no-collision.",
        )
    if not margin >= 0.0:
        raise ArmidError(f"The distance that stays between bodies cannot be negative; found {margin} m.")
    shapes = (*robot.shapes, *surroundings)
    bodies, pairs = pairs_of_bodies(robot, shapes)
    low = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
    high = np.where(np.isfinite(limits.upper), limits.upper, np.pi)
    q = np.random.default_rng(0).uniform(low, high, (LOOKED, robot.n))
    poses = forward_kinematics(robot, q)
    distance = bodies.distances(poses)
    touching = (distance < margin).mean(axis=0)
    some = poses[0][:TRIED], poses[1][:TRIED]
    fastest = bodies.approach(some, robot.tree, limits.velocity).max(axis=0) if len(pairs) else np.zeros(0)
    keeping = everything(margin, np.minimum(HALF_STEP * fastest, CERTIFICATE))
    nearest = distance.min(axis=0, initial=np.inf)
    cell = CollisionModel(robot, shapes, bodies, pairs, keeping, nearest, touching, q[:TRIED])
    cell = cell.closer(np.flatnonzero(touching > CONSTRUCTION), margin)
    around = cell.distances(cell.tried)
    return replace(cell, keeping=settled(keeping, robot, shapes, pairs, cell.tried, around, cell.touching))


def empty_collision_model(robot: Robot) -> CollisionModel:
    """An arm of which nobody knows what space it takes, with nothing around it."""
    none = np.zeros((0, 2), dtype=np.intp)
    bodies = CollisionBodies((), (), none, np.zeros(0, dtype=np.intp))
    nothing = np.zeros(0)
    return CollisionModel(robot, (), bodies, none, everything(0.0, nothing), nothing, nothing, np.zeros((0, robot.n)))


def collision_of(
    robot: Robot, limits: Limits, start: Array, surroundings: Sequence[Shape] = (), *, margin: float = 0.02
) -> CollisionOptions:
    """Pairs of bodies that a plan must keep apart; see `kept_apart`."""
    return kept_apart(make_collision_model(robot, limits, surroundings, margin=margin), start)


def kept_apart(cell: CollisionModel, start: Array) -> CollisionOptions:
    """Pairs of bodies that a plan from a start pose must keep apart.

    Links next to each other are no pair. Links two joints apart that are closer than the margin in most poses keep
    half of what is usually between them; what overlaps in nearly all poses is listed as skipped
    (`armid.excitation.collision.required_distances`).

    Args:
        cell: The arm and its surroundings.
        start: The start pose, shape (n,) [rad or m].

    Raises:
        ArmidError: Bodies are too close to each other in the start pose.
    """
    keeping, labels = cell.keeping, cell.bodies.labels
    distance = cell.distances(start[None])[0]
    looked = keeping.of(BY_CAPSULES)
    wrong = np.flatnonzero((distance < keeping.margin) & looked)
    if len(wrong):
        cell = cell.closer(np.setdiff1d(wrong, cell.bodies.hulls.at), float(keeping.margin.max(initial=0.0)))
        distance = cell.distances(start[None])[0]
    own = keeping.of(MEASURED)
    poses = forward_kinematics(cell.robot, start[None])
    distance[own] = distances(cell.shapes, cell.pairs[own], poses)[0]
    keeping = keeping.lowered(distance)
    cell = replace(cell, keeping=keeping)
    wrong = np.flatnonzero((distance < keeping.margin) & (looked | own))
    if len(wrong):
        k = int(wrong[(distance - keeping.margin)[wrong].argmin()])
        raise ArmidError(
            f"In the start pose {labels[k]} are {1000 * max(distance[k], 0.0):.0f} mm apart, less than the "
            f"{1000 * keeping.margin[k]:.0f} mm that are asked.",
            remedy="choose another start pose with --start, a smaller --clearance, or move what is around.",
        )
    made, kept = looked_at(cell), np.flatnonzero(looked)
    margin = keeping.margin[kept]
    near = np.flatnonzero(np.minimum(cell.nearest, distance)[kept] < margin + NEAR)
    if not len(near):
        return made
    # A search from a start that keeps the margin, but nothing beyond it, would not begin.
    spare = np.minimum(keeping.spare[kept], SPARED * np.maximum(distance[kept] - margin, 0.0))
    searched = Clearance("collision", made.every.bodies.only(near), margin[near], spare[near])
    return replace(made, searched=searched)


def looked_at(cell: CollisionModel) -> CollisionOptions:
    """Pairs of bodies that should keep apart, from whatever pose; see `kept_apart` for a search."""
    keeping, labels = cell.keeping, cell.bodies.labels
    kept, own = np.flatnonzero(keeping.of(BY_CAPSULES)), keeping.of(MEASURED)
    return CollisionOptions(
        None,
        Clearance("collision", cell.bodies.only(kept), keeping.margin[kept]),
        tuple(IgnoredPair(labels[k], float(keeping.touching[k])) for k in np.flatnonzero(keeping.of(LEFT_OUT))),
        cell.shapes,
        cell.pairs[kept],
        len(cell.robot.shapes),
        cell.pairs[own],
        keeping.margin[own],
    )
