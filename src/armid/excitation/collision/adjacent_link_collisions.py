"""Collision check of bodies of adjacent links, whose distance depends on the position of only one joint.

Adjacent links are connected by a joint, so most of their bodies touch in all poses, or rotate against each other with
a gap of constant width. Other bodies of adjacent links can collide, such as the jaws of a gripper or a forearm that
folds onto the upper arm. The distance of such bodies is computed over the range of the joint, and a plan keeps the
joint within the positions in which the bodies are apart. For a search this only means narrower position limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError, Finding
from armid.excitation.collision.coal import distances, mesh_triangles, too_close
from armid.excitation.collision.hull_distances import parts_of
from armid.excitation.collision.ignored_pairs import IgnoredBodies, IgnoredPair, ignored_pairs
from armid.excitation.collision.pairs import bounding_volumes, joints_between, stands
from armid.excitation.collision.required_distances import ALWAYS, HALF, LEAST, MOSTLY, RARE
from armid.excitation.limits.joint_limits import Limits
from armid.maths.rotation_clearance import SweptProfile, swept_profile
from armid.robot.collision_body_names import BodyPair
from armid.robot.kinematics import forward_kinematics
from armid.robot.robot import Robot
from armid.robot.shapes import Shape

STEP, FEWEST = 0.05, 60
"""Largest step of the positions of a revolute joint at which distances are computed [rad], and smallest number of
steps over the range of a joint."""

POSITIONS = 128
"""Largest number of positions of a joint in a motion, spread over its range in the motion, at which the distance of
adjacent links is computed."""

ROUGH = 16
"""Number of positions of a joint at which the distance of every pair is computed with its triangles, to find the
pairs that always touch and the pairs whose distance is constant."""

SAME = 1e-6
"""Largest difference of distances at `ROUGH` positions at which they count as equal [m]. The computation of one
distance of detailed meshes that face each other across a gap can take a second."""

HALVED = 7
"""Number of bisections by which the position is found at which two bodies have their required distance."""

FAVOURED = 0.85
"""Smallest width of a range of positions that contains zero, divided by the width of the widest range, with which it
is preferred to the widest range."""

Interval = tuple[float, float]


@dataclass(frozen=True, eq=False, slots=True)
class AdjacentPair:
    """Two bodies of adjacent links that a plan must keep apart.

    Attributes:
        pair: Names of the two bodies.
        bodies: Indices of the two bodies in the list of all shapes.
        joint: Index of the joint between the links of the two bodies.
        required_distance: Required distance between the two bodies [m].
        free: Ranges of the joint's position in which the bodies keep the required distance, in ascending order [rad
            or m].
        constant: True if the distance is the same at `ROUGH` positions, as between the two sides of a flange, and the
            profiles of both meshes prove that it is at least the required one at all angles. For such a pair, the
            distance is computed at only `ROUGH` positions of a motion.
    """

    pair: BodyPair
    bodies: tuple[int, int]
    joint: int
    required_distance: float
    free: tuple[Interval, ...]
    constant: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class AdjacentLinks:
    """Pairs of bodies of adjacent links, checked and not checked.

    Attributes:
        checked: Pairs that a plan must keep apart.
        left_out: Pairs that are not checked: they touch in most positions, or the user has excluded them. The
            attribute `share` of a pair is the share of positions in which its bodies touch or are less than a
            millimetre apart.
        reach: Range of each joint over which the pairs were examined, shape (n, 2) [rad or m].
        margin: Distance that the user requires [m]; the required distance of a pair may be smaller.
    """

    checked: tuple[AdjacentPair, ...]
    left_out: tuple[IgnoredPair, ...]
    reach: Array
    margin: float = 0.0

    def narrowed(self, limits: Limits, start: Array | None) -> Limits:
        """Limits with position ranges in which adjacent links stay apart: those around the start pose, or the widest.

        Args:
            limits: Limits of the joints.
            start: Start pose, shape (n,) [rad or m]; `None` for the widest range of each joint.

        Raises:
            ArmidError: Bodies are too close to each other in the start pose.
        """
        lower, upper = limits.lower.copy(), limits.upper.copy()
        for joint in dict.fromkeys(each.joint for each in self.checked):
            pairs = [each for each in self.checked if each.joint == joint]
            first, last = self.reach[joint]
            free = _common([(first, last)], pairs)
            at = None if start is None else float(start[joint])
            if at is None:
                low, high = _widest(free)
            elif any(low < at < high for low, high in free):
                low, high = next(each for each in free if each[0] < at < each[1])
            else:
                close = next(each for each in pairs if not any(low < at < high for low, high in each.free))
                raise ArmidError(
                    f"In the start pose, {close.pair} touch or are closer than the required "
                    f"{1000.0 * close.required_distance:.1f} mm.",
                    remedy=f"choose another position of {limits.joints[joint]} with --start, or leave the pair "
                    "out of the collision check with --ignore-pair A,B.",
                )
            if (low, high) != (first, last):
                lower[joint], upper[joint] = low, high
        return replace(limits, lower=lower, upper=upper)


NO_ADJACENT = AdjacentLinks((), (), np.zeros((0, 2)))
"""`AdjacentLinks` without any pairs."""


def adjacent_links(
    robot: Robot, shapes: Sequence[Shape], limits: Limits, margin: float, ignored: Sequence[IgnoredBodies] = ()
) -> AdjacentLinks:
    """Pairs of bodies of adjacent links, with the ranges of the joint position in which the two bodies are apart.

    The required distance is the margin, or less if the bodies are close to each other: at most half of the distance
    that the bodies exceed in nearly all positions in which they do not touch. Pairs are not checked if they touch in
    nearly all positions, if they are usually closer than a millimetre, or if they are apart in less than a third of
    the range of the joint.

    Args:
        robot: The arm.
        shapes: The bodies, the surroundings last.
        limits: Limits of the joints.
        margin: Largest required distance [m].
        ignored: Pairs that the user has excluded.
    """
    reach = np.column_stack(
        [
            np.where(np.isfinite(limits.lower), limits.lower, -np.pi),
            np.where(np.isfinite(limits.upper), limits.upper, np.pi),
        ]
    )
    chosen = [
        (a, b)
        for a in range(len(shapes))
        for b in range(a + 1, len(shapes))
        if not stands(robot, shapes, b) and joints_between(robot, shapes[a].link, shapes[b].link) == 1
    ]
    volumes, pairs = bounding_volumes(shapes, chosen)
    labels = [BodyPair(shapes[a].name, shapes[b].name) for a, b in pairs]
    reasons = ignored_pairs([replace(each, strict=False) for each in ignored], labels, [s.name for s in shapes])
    checked: list[AdjacentPair] = []
    left_out: list[IgnoredPair] = []
    for k, (a, b) in enumerate(pairs.tolist()):
        joint = max(shapes[a].link, shapes[b].link)
        low, high = reach[joint]
        looked = _AdjacentBodies(robot, tuple(shapes), (a, b), joint, 0.5 * reach.sum(axis=1))
        count = FEWEST + 1 if robot.joints[joint].is_prismatic else max(FEWEST, math.ceil((high - low) / STEP)) + 1
        q = np.linspace(low, high, count)
        bound = volumes.only([k]).distances(looked.poses(q))[:, 0]
        found = _judged(looked, q, bound, margin, labels[k])
        if isinstance(found, IgnoredPair):
            left_out.append(found)
        elif k in reasons:
            left_out.append(IgnoredPair(labels[k], math.nan, reasons[k], (a, b), adjacent=True))
        else:
            checked.append(found)
    return replace(_with_room(checked, left_out, reach), margin=margin)


@dataclass(frozen=True, eq=False, slots=True)
class _AdjacentBodies:
    """Two bodies of adjacent links and the joint between these links; all other joints rest in a fixed pose."""

    robot: Robot
    shapes: tuple[Shape, ...]
    bodies: tuple[int, int]
    joint: int
    middle: Array

    def poses(self, q: Array) -> tuple[Array, Array]:
        """Rotations (k, n, 3, 3) and origins (k, n, 3) of the links at positions (k,) of the joint."""
        every = np.tile(self.middle, (len(q), 1))
        every[:, self.joint] = q
        return forward_kinematics(self.robot, every)

    def apart(self, q: Array) -> Array:
        """Distances (k,) [m] of the bodies themselves, not of bounding volumes, at positions (k,) of the joint."""
        return distances(self.shapes, np.array([self.bodies]), self.poses(q))[:, 0]

    def clear(self, q: Array, kept: float) -> NDArray[np.bool_]:
        """Mask (k,) of the joint positions (k,) at which the bodies keep the distance `kept` [m].

        It is faster than `apart`.
        """
        return ~too_close(self.shapes, np.array(self.bodies), kept, self.poses(q))

    def clear_at_all_angles(self, kept: float) -> bool:
        """Checks whether the profiles of two meshes prove that they keep a distance [m] at all joint angles."""
        shapes = [self.shapes[k] for k in self.bodies]
        joint = self.robot.joints[self.joint]
        if joint.is_prismatic or any(shape.kind != "mesh" for shape in shapes):
            return False
        R, p = (x[0] for x in self.poses(np.zeros(1)))
        axis, origin = R[self.joint] @ np.asarray(joint.axis), p[self.joint]
        profiles: list[SweptProfile] = []
        for shape in shapes:
            triangles = mesh_triangles(shape) @ shape.placement[:3, :3].T + shape.placement[:3, 3]
            if shape.link >= 0:
                triangles = triangles @ R[shape.link].T + p[shape.link]
            profiles.append(swept_profile(triangles, axis, origin))
        return not profiles[0].closer_than(profiles[1], kept)

    def hulls(self, q: Array) -> Array:
        """Distances (k,) [m] of convex bodies that enclose the two bodies, at positions (k,) of the joint."""
        return distances(self.shapes, np.array([self.bodies]), self.poses(q), parts_of)[:, 0]


def adjacent_ranges(robot: Robot, adjacent: AdjacentLinks, limits: Limits, narrowed: Limits) -> tuple[Finding, ...]:
    """Finding that names joints whose position range is narrowed to keep adjacent links apart.

    Args:
        robot: The arm.
        adjacent: Pairs of adjacent links.
        limits: Limits of the joints before the ranges were narrowed.
        narrowed: Limits of the joints with narrowed position ranges.
    """
    parts: list[str] = []
    for j, joint in enumerate(robot.joints):
        low, high = float(narrowed.lower[j]), float(narrowed.upper[j])
        if (low, high) == (limits.lower[j], limits.upper[j]):
            continue
        close = [
            f"{each.pair} ({1000.0 * each.required_distance:.1f} mm)"
            for each in adjacent.checked
            if each.joint == j and {low, high} & set(np.ravel(each.free)) - set(adjacent.reach[j])
        ]
        parts.append(f"{joint.name} {low:.4g} to {high:.4g} {joint.unit}, because of {' and '.join(close)}")
    if not parts:
        return ()
    evidence = (
        "the plan uses narrower position limits, within which adjacent links keep apart (required distance): "
        f"{'; '.join(parts)}"
    )
    remedy = "if two such links may touch, leave the pair out of the collision check with --ignore-pair A,B."
    return (Finding("adjacent-range", "info", "", evidence, remedy),)


def spread_positions(q: Array, count: int = POSITIONS) -> NDArray[np.intp]:
    """Indices of poses in which the positions of one joint are spread over their range, sorted by position.

    Args:
        q: Positions of the joint, shape (N,) [rad or m].
        count: Largest number of poses.
    """
    order = q.argsort(kind="stable")
    low, high = q[order[[0, -1]]]
    places = np.searchsorted(q[order], np.linspace(low, high, count))
    return order[np.unique(places.clip(max=len(q) - 1))]


def _judged(
    looked: _AdjacentBodies, q: Array, bound: Array, margin: float, label: BodyPair
) -> AdjacentPair | IgnoredPair:
    """Decides whether a pair is checked: the pair with required distance and free positions, or the reason why not.

    Args:
        looked: The two bodies.
        q: Positions of the joint, shape (k,) [rad or m].
        bound: Lower bounds of the distance of the bodies at these positions, shape (k,) [m].
        margin: Largest required distance [m].
        label: Names of the bodies.
    """
    far = margin / HALF

    def pair(kept: float, free: tuple[Interval, ...], *, constant: bool = False) -> AdjacentPair:
        return AdjacentPair(label, looked.bodies, looked.joint, kept, free, constant)

    def left_out(share: float, cause: str) -> IgnoredPair:
        return IgnoredPair(label, share, "", looked.bodies, cause, adjacent=True)

    everywhere = ((float(q[0]), float(q[-1])),)
    if bound.min() > far:
        return pair(margin, everywhere)
    some = q[np.unique(np.linspace(0, len(q) - 1, ROUGH).astype(np.intp))]
    touching = ~looked.clear(some, 0.0)
    share = float(touching.mean())
    if share >= ALWAYS:
        return left_out(share, "touching in all positions of their joint")
    gaps = looked.apart(some[~touching])
    close = (int(touching.sum()) + int((gaps <= LEAST).sum())) / len(some)
    if close >= HALF:
        return left_out(
            close, f"touching or less than {1000.0 * LEAST:.0f} mm apart in most positions of their joint"
        )
    kept = min(margin, HALF * float(np.quantile(gaps, RARE)))
    if not touching.any() and np.ptp(gaps) <= SAME and looked.clear_at_all_angles(kept):
        return pair(kept, everywhere, constant=True)
    clear = looked.hulls(q) > far
    clear[~clear] = looked.clear(q[~clear], kept)
    free = _intervals(lambda position: bool(looked.clear(np.array([position]), kept)[0]), q, clear)
    if max((high - low for low, high in free), default=0.0) < (1.0 - MOSTLY) * (q[-1] - q[0]):
        return left_out(share, "apart in less than a third of the range of their joint")
    return pair(kept, free)


def _intervals(is_clear: Callable[[float], bool], q: Array, clear: NDArray[np.bool_]) -> tuple[Interval, ...]:
    """Ranges of a joint's position in which two bodies keep their required distance.

    `clear` is the mask of the positions `q` (k,) at which they keep it. The ends of the ranges are found by
    bisection.
    """

    def end(inside: float, outside: float) -> float:
        for _ in range(HALVED):
            middle = 0.5 * (inside + outside)
            inside, outside = (middle, outside) if is_clear(middle) else (inside, middle)
        return inside

    edges = np.flatnonzero(np.diff(np.concatenate([[False], clear, [False]]).astype(np.int8)))
    found: list[Interval] = []
    for first, beyond in edges.reshape(-1, 2).tolist():
        low, high = float(q[first]), float(q[beyond - 1])
        low = low if first == 0 else end(low, float(q[first - 1]))
        high = high if beyond == len(q) else end(high, float(q[beyond]))
        found.append((low, high))
    return tuple(found)


def _common(free: Sequence[Interval], pairs: Sequence[AdjacentPair]) -> list[Interval]:
    """Intersection of the ranges `free` of a joint's position with the free ranges of all pairs."""
    found = list(free)
    for each in pairs:
        shared = [(max(a, c), min(b, d)) for a, b in found for c, d in each.free]
        found = [(low, high) for low, high in shared if low < high]
    return found


def _widest(free: Sequence[Interval]) -> Interval:
    """Widest of several ranges, or the range that contains zero if it is nearly as wide."""
    widest = max(free, key=lambda each: each[1] - each[0])
    enough = FAVOURED * (widest[1] - widest[0])
    return next((each for each in free if each[0] < 0.0 < each[1] and each[1] - each[0] >= enough), widest)


def _with_room(checked: Sequence[AdjacentPair], left_out: Sequence[IgnoredPair], reach: Array) -> AdjacentLinks:
    """Leaves out pairs that, together with other pairs, would leave a joint less than a third of its range."""
    kept: list[AdjacentPair] = []
    others = list(left_out)
    for each in sorted(checked, key=lambda pair: min(low - high for low, high in pair.free)):
        low, high = reach[each.joint]
        free = _common([(low, high)], [*(pair for pair in kept if pair.joint == each.joint), each])
        if max((b - a for a, b in free), default=0.0) < (1.0 - MOSTLY) * (high - low):
            cause = "apart together with others in less than a third of the range of their joint"
            others.append(IgnoredPair(each.pair, 0.0, "", each.bodies, cause, adjacent=True))
        else:
            kept.append(each)
    return AdjacentLinks(tuple(sorted(kept, key=lambda pair: pair.bodies)), tuple(others), reach)
