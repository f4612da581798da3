"""Collision model of an arm and its surroundings: pairs of bodies and the distances that a plan must keep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.excitation.collision.adjacent_link_collisions import NO_ADJACENT, AdjacentLinks, adjacent_links
from armid.excitation.collision.coal import distances, too_close
from armid.excitation.collision.distances import Clearance, CollisionBodies
from armid.excitation.collision.hull_distances import Hulls
from armid.excitation.collision.ignored_pairs import IgnoredBodies, IgnoredPair, ignored_pairs
from armid.excitation.collision.pairs import joints_on_path, pairs_of_bodies, stands
from armid.excitation.collision.required_distances import (
    BY_CAPSULES,
    LEFT_OUT,
    MEASURED,
    RequiredDistances,
    adjusted_distances,
    often_near,
    uniform_distances,
)
from armid.excitation.limits.joint_limits import Limits
from armid.robot.collision_from_visual import missing_bodies
from armid.robot.kinematics import forward_kinematics, longest_reach
from armid.robot.robot import Robot
from armid.robot.shapes import Shape

LOOKED = 3000
"""Number of random poses in which distances are computed, to find the pairs of bodies that are never close. A search
ignores such pairs."""

TRIED = 300
"""Number of random poses in which distances of the bodies or of tighter convex hulls are computed."""

NEAR = 0.08
"""Excess distance of a pair in its closest random pose below which the pair takes part in the search [m]."""

WIDE = 0.1
"""Smallest difference, for which hulls are used for a pair, between the share of random poses that its capsules
exclude and the share that its hulls exclude."""

HALF_STEP, CERTIFICATE = 0.0005, 0.003
"""Half a step of the certificate's grid [s], and a bound [m]. A search keeps an additional distance: the distance by
which bodies can approach each other in this time at the velocity limits, but at most the bound. The certificate then
need not reduce the amplitudes of the plan."""

SPARED = 0.9
"""Largest additional distance that a search keeps, divided by the excess distance of the pair in the start pose."""

FARTHEST, ALLOWED = 0.5, 0.05
"""Largest allowed `--clearance`, divided by the reach of the arm; and a `--clearance` that is always allowed [m]."""

ROUNDING = 1e-9
"""Tolerance of comparisons of distances [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class CollisionOptions:
    """Pairs of bodies that a plan must keep apart.

    Attributes:
        searched: Pairs that can come close to each other, for the search; `None` if there are none.
        every: All pairs that are checked with bounding volumes, for the certificate.
        skipped: Pairs that are not checked, without the pairs of adjacent links.
        shapes: The bodies themselves, the surroundings last.
        pairs: Indices into `shapes` of the pairs of `every`, shape (m, 2).
        own: Number of shapes that belong to the arm.
        measured: Indices into `shapes` of the pairs that are checked with the bodies themselves, shape (r, 2).
        required_distances: Required distances of the pairs of `measured`, shape (r,) [m].
        left_out: Bounding volumes of the pairs of `skipped`.
        adjacent: Pairs of adjacent links.
    """

    searched: Clearance | None
    every: Clearance
    skipped: tuple[IgnoredPair, ...]
    shapes: tuple[Shape, ...]
    pairs: NDArray[np.intp]
    own: int
    measured: NDArray[np.intp]
    required_distances: Array
    left_out: CollisionBodies
    adjacent: AdjacentLinks = NO_ADJACENT

    @property
    def unchecked(self) -> tuple[IgnoredPair, ...]:
        """All pairs of bodies that are not checked, including the pairs of adjacent links."""
        return (*self.skipped, *self.adjacent.left_out)

    @property
    def clearance(self) -> float:
        """Distance that the user requires [m]; smaller distances are required of pairs close by construction."""
        return self.adjacent.margin

    @property
    def surroundings(self) -> tuple[Shape, ...]:
        """Bodies of the surroundings."""
        return self.shapes[self.own :]

    def clear(self, robot: Robot, q: Array) -> NDArray[np.bool_]:
        """Mask (N,) of the poses (N, n) in which all pairs keep their required distance."""
        poses = forward_kinematics(robot, q)
        result = (self.every.bodies.distances(poses) > self.every.margins).all(axis=1)
        for pair, kept in zip(self.measured, self.required_distances, strict=True):
            result &= ~too_close(self.shapes, pair, float(kept), poses)
        return np.asarray(result)

    def too_close_as_they_are(self, robot: Robot, q: Array) -> list[int]:
        """Indices of the joints between bodies of pairs of `measured` that are too close in a pose (N, n)."""
        poses = forward_kinematics(robot, q)
        moving = (
            joints_on_path(robot, *(self.shapes[k].link for k in pair))
            for pair, kept in zip(self.measured, self.required_distances, strict=True)
            if too_close(self.shapes, pair, float(kept), poses).any()
        )
        return sorted({j for joints in moving for j in joints})


@dataclass(frozen=True, eq=False, slots=True)
class CollisionModel:
    """Arm and surroundings, with all pairs of bodies that can collide.

    Attributes:
        robot: The arm.
        shapes: The bodies themselves, the surroundings last.
        bodies: Capsules and solids with their pairs, and hulls for pairs whose capsules touch in most poses.
        pairs: Indices into `shapes` of the pairs of `bodies`, shape (m, 2).
        required: Required distance of each pair, and the way in which the pair is checked.
        nearest: Smallest distance of each pair in many random poses, shape (m,) [m].
        touching: Share of the random poses in which each pair is closer than the required distance, shape (m,).
        tried: Some of the random poses, shape (k, n) [rad or m].
        ignored: Option or file with which the user excludes a pair, by the index of the pair.
        adjacent: Pairs of adjacent links, which are not among `pairs`.
    """

    robot: Robot
    shapes: tuple[Shape, ...]
    bodies: CollisionBodies
    pairs: NDArray[np.intp]
    required: RequiredDistances
    nearest: Array
    touching: Array
    tried: Array
    ignored: Mapping[int, str] = field(default_factory=dict[int, str])
    adjacent: AdjacentLinks = NO_ADJACENT

    def excess_distance(self, q: Array) -> Array:
        """Smallest excess distance of all pairs in poses (N, n), shape (N,) [m]; negative if a pair is too close.

        The excess distance is the distance minus the required distance. A positive result is a lower bound.
        """
        return self._excess(q, self.required.margin)

    def search_excess_distance(self, q: Array) -> Array:
        """Smallest difference (N,) [m] of the distance in poses (N, n) and the distance that a search requires.

        A search requires the required distance plus `required.spare`. The sign is that of `excess_distance`.
        """
        return self._excess(q, self.required.margin + self.required.spare)

    def _excess(self, q: Array, required: Array) -> Array:
        """Smallest difference (N,) [m] of distance and `required` distance (m,), over pairs of kind `BY_CAPSULES`."""
        checked = np.flatnonzero(self.required.of(BY_CAPSULES))
        poses, required = forward_kinematics(self.robot, q), required[checked]
        found = self.bodies.only(checked).distances(poses, reach=required)
        return (found - required).min(axis=1, initial=np.inf)

    def apart(self, q: Array) -> NDArray[np.bool_]:
        """Mask (N,) of the poses (N, n) in which all pairs of kind `MEASURED` keep their required distance."""
        which = self.required.of(MEASURED)
        found = distances(self.shapes, self.pairs[which], forward_kinematics(self.robot, q))
        return np.asarray((found > self.required.margin[which]).all(axis=1))

    @property
    def margin(self) -> float:
        """Largest required distance of all pairs [m], which is that of pairs that are not close by construction."""
        return float(self.required.margin.max(initial=0.0))

    def too_close(self, q: Array) -> NDArray[np.bool_]:
        """Mask of the pairs that are closer than their required distance in poses (N, n), shape (N, m)."""
        close = (self.distances(q) < self.required.margin) & self.required.of(BY_CAPSULES)
        which = np.flatnonzero(self.required.of(MEASURED))
        found = distances(self.shapes, self.pairs[which], forward_kinematics(self.robot, q))
        close[:, which] = found <= self.required.margin[which]
        return close

    def distances(self, q: Array) -> Array:
        """Distances of the bounding volumes of the m pairs in poses (N, n), shape (N, m) [m]."""
        return self.bodies.distances(forward_kinematics(self.robot, q))

    def closer(self, which: NDArray[np.intp], margin: float, gain: float = -1.0) -> CollisionModel:
        """Collision model with convex hulls for some pairs, if hulls enclose their bodies more tightly than capsules.

        Args:
            which: Indices of the pairs, in ascending order.
            margin: Distance below which bodies count as touching [m].
            gain: Smallest difference of two shares of random poses for which hulls are used: share in which capsules
                touch, minus share in which hulls touch.
        """
        hulls, poses = Hulls(self.shapes, self.pairs[which], which), forward_kinematics(self.robot, self.tried)
        apart, before = hulls.distances(poses), self.bodies.distances(poses)[:, which]
        better = apart.sum(axis=0) > before.sum(axis=0) + ROUNDING
        better &= self.touching[which] - (apart < margin).mean(axis=0) >= gain
        kept = np.union1d(self.bodies.hulls.at, which[better])
        touching, nearest = self.touching.copy(), self.nearest.copy()
        touching[which[better]] = (apart < margin).mean(axis=0)[better]
        nearest[which[better]] = apart.min(axis=0)[better]
        bodies = replace(self.bodies, hulls=Hulls(self.shapes, self.pairs[kept], kept))
        return replace(self, bodies=bodies, nearest=nearest, touching=touching)

    def without_dispensable(self) -> CollisionModel:
        """Collision model that does not check pairs of neighbouring links that overlap in most poses."""
        required = self.required
        kind = np.where(required.dispensable, LEFT_OUT, required.kind)
        return replace(self, required=replace(required, kind=kind))

    def tightened(self) -> CollisionModel:
        """Collision model with hulls for all pairs whose capsules are so wide that they exclude many poses."""
        wide = np.flatnonzero(self.required.of(BY_CAPSULES) & (self.touching > WIDE))
        return self.closer(np.setdiff1d(wide, self.bodies.hulls.at), self.margin, WIDE)


def _check(robot: Robot, margin: float) -> None:
    """Raises an error if bodies are missing, or a margin [m] is negative or too large for the arm."""
    missing = missing_bodies(robot)
    if missing:
        raise ArmidError(
            f"Collisions of {robot.name} cannot be checked: {missing[0].evidence}.",
            remedy="name the folder of the package with --package NAME=DIR (or ROS_PACKAGE_PATH, AMENT_PREFIX_PATH), "
            "put the meshes beside the description, or switch the check off with --no-collision.",
        )
    if not robot.shapes:
        raise ArmidError(
            f"The description of {robot.name} contains no shapes of the links, so collisions cannot be checked.",
            remedy="give a URDF with <collision> elements or a DH table with capsules, or switch the check off with "
            "--no-collision.",
        )
    if not margin >= 0.0:
        raise ArmidError(
            f"The required distance between bodies cannot be negative; found {margin} m.",
            remedy="give a --clearance of zero or more.",
        )
    reach = longest_reach(robot)
    if margin > max(FARTHEST * reach, ALLOWED):
        raise ArmidError(
            f"The required distance between bodies (--clearance) is {margin:g} m, but {robot.name} reaches only "
            f"{reach:.2g} m, so its bodies cannot keep it.",
            possible=f"0 to {max(FARTHEST * reach, ALLOWED):.2g} m",
            remedy=f"give it in metres{f'; {margin:g} mm are {margin / 1000.0:g}' if margin >= 1.0 else ''}.",
        )


def make_collision_model(
    robot: Robot,
    limits: Limits,
    surroundings: Sequence[Shape] = (),
    *,
    margin: float = 0.02,
    ignored: Sequence[IgnoredBodies] = (),
) -> CollisionModel:
    """Collision model of an arm and its surroundings, with required distances determined from random poses.

    Args:
        robot: The arm.
        limits: Limits of the joints of the arm.
        surroundings: Bodies that do not move.
        margin: Required distance between bodies [m].
        ignored: Pairs that are not checked.

    Raises:
        ArmidError: The description has no shapes, or the margin is negative or too large for the arm.
    """
    _check(robot, margin)
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
    required = uniform_distances(margin, np.minimum(HALF_STEP * fastest, CERTIFICATE))
    nearest = distance.min(axis=0, initial=np.inf)
    cell = CollisionModel(robot, shapes, bodies, pairs, required, nearest, touching, q[:TRIED])
    reasons = ignored_pairs(ignored, bodies.labels, tuple(shape.name for shape in shapes))
    looked = np.array([k not in reasons for k in range(len(pairs))], dtype=np.bool_)
    cell = cell.closer(np.flatnonzero(often_near(margin, robot, shapes, pairs, distance) & looked), margin)
    around = cell.distances(cell.tried)
    touching = np.where(looked, cell.touching, 0.0)
    known = np.where(looked, touching, np.nan)
    required = adjusted_distances(required, robot, shapes, pairs, cell.tried, around, known)
    required = replace(required, kind=np.where(looked, required.kind, LEFT_OUT))
    adjacent = adjacent_links(robot, shapes, limits, margin, ignored)
    return replace(cell, touching=touching, required=required, ignored=reasons, adjacent=adjacent)


def empty_collision_model(robot: Robot) -> CollisionModel:
    """Collision model without any bodies, for a description without shapes."""
    none = np.zeros((0, 2), dtype=np.intp)
    bodies = CollisionBodies((), (), none, np.zeros(0, dtype=np.intp))
    nothing = np.zeros(0)
    return CollisionModel(
        robot, (), bodies, none, uniform_distances(0.0, nothing), nothing, nothing, np.zeros((0, robot.n))
    )


def collision_of(
    robot: Robot, limits: Limits, start: Array, surroundings: Sequence[Shape] = (), *, margin: float = 0.02
) -> CollisionOptions:
    """Pairs of bodies that a plan must keep apart if it begins in a given start pose; see `collision_options`."""
    return collision_options(make_collision_model(robot, limits, surroundings, margin=margin), start)


def collision_options(cell: CollisionModel, start: Array) -> CollisionOptions:
    """Pairs of bodies that a plan must keep apart if it begins in a given start pose.

    Adjacent links are kept apart by narrower position limits (`AdjacentLinks.narrowed`). For links with one link
    between them that cannot keep the margin, the required distance is smaller. Pairs that overlap in nearly all poses
    are not checked and are listed as skipped (`armid.excitation.collision.required_distances`).

    Args:
        cell: Arm and surroundings.
        start: Start pose, shape (n,) [rad or m].

    Raises:
        ArmidError: Bodies are too close to each other in the start pose.
    """
    required, labels = cell.required, cell.bodies.labels
    distance = cell.distances(start[None])[0]
    looked = required.of(BY_CAPSULES)
    wrong = np.flatnonzero((distance < required.margin) & looked)
    if len(wrong):
        cell = cell.closer(np.setdiff1d(wrong, cell.bodies.hulls.at), float(required.margin.max(initial=0.0)))
        distance = cell.distances(start[None])[0]
    own = required.of(MEASURED)
    poses = forward_kinematics(cell.robot, start[None])
    distance[own] = distances(cell.shapes, cell.pairs[own], poses)[0]
    required = required.lowered(distance)
    cell = replace(cell, required=required)
    wrong = np.flatnonzero((distance < required.margin) & (looked | own))
    if len(wrong):
        k = int(wrong[(distance - required.margin)[wrong].argmin()])
        raise ArmidError(
            f"In the start pose, the distance between {labels[k]} is {1000 * max(distance[k], 0.0):.0f} mm; at least "
            f"{1000 * required.margin[k]:.0f} mm are required.",
            remedy="choose another start pose with --start, a smaller --clearance, or move the surroundings.",
        )
    made, kept = looked_at(cell), np.flatnonzero(looked)
    margin = required.margin[kept]
    near = np.flatnonzero(np.minimum(cell.nearest, distance)[kept] < margin + NEAR)
    if not len(near):
        return made
    # The spare distance must not exceed what the start pose has, or the search would have no feasible start.
    spare = np.minimum(required.spare[kept], SPARED * np.maximum(distance[kept] - margin, 0.0))
    searched = Clearance("collision", made.every.bodies.only(near), margin[near], spare[near])
    return replace(made, searched=searched)


def looked_at(cell: CollisionModel) -> CollisionOptions:
    """Pairs of bodies that a plan must keep apart, if no start pose is known; a search needs `collision_options`."""
    required, labels = cell.required, cell.bodies.labels
    kept, own = np.flatnonzero(required.of(BY_CAPSULES)), required.of(MEASURED)
    left_out = np.flatnonzero(required.of(LEFT_OUT))
    return CollisionOptions(
        None,
        Clearance("collision", cell.bodies.only(kept), required.margin[kept]),
        tuple(
            IgnoredPair(
                labels[k],
                np.nan if k in cell.ignored else float(required.touching[k]),
                cell.ignored.get(k, ""),
                (int(cell.pairs[k, 0]), int(cell.pairs[k, 1])),
                _cause(cell, k),
            )
            for k in left_out.tolist()
        ),
        cell.shapes,
        cell.pairs[kept],
        len(cell.robot.shapes),
        cell.pairs[own],
        required.margin[own],
        cell.bodies.only(left_out),
        cell.adjacent,
    )


def _cause(cell: CollisionModel, k: int) -> str:
    """Reason why a pair of an arm body and the surroundings is not checked; empty for other pairs."""
    if not stands(cell.robot, cell.shapes, int(cell.pairs[k].max())):
        return ""
    often = "all" if cell.required.touching[k] >= 1.0 else "most"
    return f"turning on its mount, closer than the clearance of {1000.0 * cell.margin:.1f} mm in {often} random poses"
