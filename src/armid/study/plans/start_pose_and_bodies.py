"""Start pose of a designed motion, given or chosen, and the collision model of the arm and its surroundings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError, Finding
from armid.excitation.collision.adjacent_link_collisions import adjacent_ranges
from armid.excitation.collision.collision_model import (
    CollisionModel,
    CollisionOptions,
    collision_options,
    empty_collision_model,
    make_collision_model,
)
from armid.excitation.collision.ignored_pairs import IgnoredPair, pairs_by_reason
from armid.excitation.collision.required_distances import ALWAYS
from armid.excitation.limits.joint_limits import Limits
from armid.excitation.start_pose import Holds, Start, any_pose, choose_start, find_start, free_range, usual_pose
from armid.notebook_display import plural
from armid.robot.robot import Robot
from armid.robot.shapes import Shape
from armid.study.plans.design_options import DesignConstraints

TIGHT = 0.1
"""If less than this share of random moves from a start pose is free of collisions, the bodies are enclosed in hulls
instead of capsules, which are wider."""


@dataclass(frozen=True, eq=False, slots=True)
class Placement:
    """Start pose of a designed motion, with the pairs of bodies that must keep a distance.

    Attributes:
        start: The pose, shape (n,) [rad or m].
        collision: Pairs of bodies that must keep a distance; `None` if collisions are not checked.
        limits: Limits of the joints; position limits are narrowed so that adjacent links do not touch.
        findings: Findings on start pose, floor and collisions.
        unchecked: Reason why collisions are not checked; empty if they are checked.
    """

    start: Array
    collision: CollisionOptions | None
    limits: Limits
    findings: tuple[Finding, ...]
    unchecked: str = ""


def place_motion(
    robot: Robot, limits: Limits, constraints: DesignConstraints, given: Array | None, holds: Holds = any_pose
) -> Placement:
    """Checks a given start pose, or chooses a pose with free space around it, and makes the collision model.

    The usual start position of a joint is zero if the limits allow it, otherwise the middle of the range. If
    collisions are checked, or the joints cannot hold the usual pose, `armid.excitation.start_pose` chooses the pose.

    Args:
        robot: The arm.
        limits: Limits of the joints of the arm.
        constraints: Clearance, surroundings and floor.
        given: Start pose that the user gives, shape (n,) [rad or m]; `None` if a pose is chosen.
        holds: Function that tests whether the torques of the joints are sufficient to hold poses.

    Raises:
        ArmidError: The given pose violates a limit, or bodies are too close to each other in this pose.
    """
    if given is not None:
        given = _checked_start(robot, limits, given)
    if constraints.clearance is None:
        why = "the check was left out (--no-collision)" if robot.shapes else "the description has no shapes of bodies"
        start, findings = (given, ()) if given is not None else _without_bodies(robot, limits, holds)
        return Placement(start, None, limits, (*findings, _unseen(why)), why)
    floor = None if constraints.floor is None else constraints.floor.shape
    remark = None if constraints.floor is None else _no_floor(constraints.floor.why)
    if floor is not None:
        try:
            found = _among_bodies(robot, limits, constraints, (*constraints.surroundings, floor), given, holds)
            return replace(found, findings=(*found.findings, _floor(floor)))
        except ArmidError as error:
            remark = _no_floor(f"the arm does not start above the plane through its base ({error.problem})")
    found = _among_bodies(robot, limits, constraints, constraints.surroundings, given, holds)
    return found if remark is None else replace(found, findings=(*found.findings, remark))


def _among_bodies(
    robot: Robot,
    limits: Limits,
    constraints: DesignConstraints,
    around: tuple[Shape, ...],
    given: Array | None,
    holds: Holds,
) -> Placement:
    """Start pose of an arm with collision check; `around` are the bodies of the surroundings."""
    assert constraints.clearance is not None
    cell = make_collision_model(robot, limits, around, margin=constraints.clearance, ignored=constraints.ignored)
    described, limits = limits, cell.adjacent.narrowed(limits, given)
    findings = adjacent_ranges(robot, cell.adjacent, described, limits)
    start = given
    if start is not None:
        if (cell.too_close(start[None])[0] & cell.required.dispensable).any():
            cell = cell.without_dispensable()
        cell = cell if free_range(cell, limits, start, holds) >= TIGHT else cell.tightened()
    else:
        cell, chosen = _choose(cell, limits, holds)
        start = chosen.pose
        if not chosen.usual:
            evidence = (
                f"the motion starts from {_positions(robot, start)} and not from the usual start pose, around which "
                "limits, bodies or torque leave less free space; on average, random moves from the chosen pose are "
                f"free of collisions for {100 * chosen.free_share:.0f} % of their length"
            )
            findings = (_chosen(evidence), *findings)
    collision = collision_options(cell, start)
    return Placement(start, collision, limits, (*findings, *_without_shapes(robot), *_skipped_pairs(collision)))


def _choose(cell: CollisionModel, limits: Limits, holds: Holds) -> tuple[CollisionModel, Start]:
    """Chooses the start pose of an arm with collision check, and the collision model with which a pose is possible.

    If capsules are so wide that no pose has free space, hulls replace them. If no pose has free space with hulls,
    either, pairs of neighbours whose bodies overlap in most poses are left out.
    """
    chosen = find_start(cell, limits, holds)
    if chosen is not None and chosen.free_share >= TIGHT:
        return cell, chosen
    tight = cell.tightened()
    if not tight.required.dispensable.any():
        return tight, choose_start(tight, limits, holds)
    chosen = find_start(tight, limits, holds)
    if chosen is not None and chosen.free_share >= TIGHT:
        return tight, chosen
    return _choose(cell.without_dispensable(), limits, holds)


def _without_bodies(robot: Robot, limits: Limits, holds: Holds) -> tuple[Array, tuple[Finding, ...]]:
    """Start pose without collision check: the usual pose, or another pose if the joints cannot hold the usual one."""
    usual = usual_pose(limits)
    if holds(usual[None])[0]:
        return usual, ()
    chosen = choose_start(empty_collision_model(robot), limits, holds)
    evidence = (
        "the joints cannot hold the usual start pose within their torque limits, so the motion starts from "
        f"{_positions(robot, chosen.pose)}"
    )
    return chosen.pose, (_chosen(evidence),)


def _positions(robot: Robot, pose: Array) -> str:
    """Text that gives a pose: name, position and unit of each joint."""
    return ", ".join(f"{joint.name} {q:.4g} {joint.unit}" for joint, q in zip(robot.joints, pose, strict=True))


def _chosen(evidence: str) -> Finding:
    return Finding("start-chosen", "info", "", evidence, "choose another pose with --start.")


def _unseen(why: str) -> Finding:
    """Finding for a plan whose collisions are not checked."""
    return Finding(
        "collision-unseen",
        "warning",
        "",
        f"collisions were not checked: {why}; the arm may collide with itself, the floor or other objects",
        "look at the preview and run the rehearsal first.",
    )


def _floor(floor: Shape) -> Finding:
    """Finding that a floor is assumed, with its position."""
    evidence = (
        f"{floor.name}: the plane through the origin of the base frame, perpendicular to gravity; the arm stays "
        "above it"
    )
    return Finding(
        "floor-assumed",
        "info",
        "",
        evidence,
        "change its height with --floor HEIGHT, or leave it out with --no-floor.",
    )


def _no_floor(why: str) -> Finding:
    """Finding that no floor is assumed, with the reason."""
    remedy = "if there is a floor, give its height above the base in metres with --floor HEIGHT."
    return Finding("floor-left-out", "info", "", f"no floor is assumed: {why}", remedy)


def _without_shapes(robot: Robot) -> tuple[Finding, ...]:
    """Finding that names moving links without shapes, for which collisions cannot be checked."""
    bare = [link.name for k, link in enumerate(robot.links) if all(shape.link != k for shape in robot.shapes)]
    if not bare:
        return ()
    evidence = f"collisions are not checked for {plural(len(bare), 'link')} without shapes in the description"
    remedy = "add shapes of these links to the description, or watch these links in the preview."
    return (Finding("links-without-bodies", "info", "", f"{evidence}: {', '.join(bare)}", remedy),)


def _skipped_pairs(collision: CollisionOptions) -> tuple[Finding, ...]:
    """Findings about pairs of bodies that are not checked: excluded by the user, or touching in most poses."""
    asked = [each for each in collision.unchecked if each.reason]
    built = [each for each in collision.skipped if not each.reason]
    mounts = [each for each in built if each.cause]
    always = [each for each in built if not each.cause and each.share >= ALWAYS]
    mostly = [each for each in built if not each.cause and each.share < ALWAYS]
    findings: list[Finding] = []
    if asked:
        said = f"{_bodies(asked)} {_are(asked)} not checked, as requested: {'; '.join(_by_reason(asked))}"
        findings.append(Finding("pairs-ignored", "info", "", said, "watch these bodies in the preview."))
    if always:
        said = (
            f"{_bodies(always)} touch in nearly all poses and {_are(always)} therefore not checked: {_shares(always)}"
        )
        findings.append(Finding("pairs-touching-always", "info", "", said))
    if mounts:
        said = f"{_bodies(mounts)} {_are(mounts)} not checked: {'; '.join(_by_reason(mounts))}"
        findings.append(Finding("pairs-touching-always", "info", "", said))
    if mostly:
        said = (
            f"{_bodies(mostly)} of neighbouring links overlap in most poses, because of the shapes in the "
            f"description, and {_are(mostly)} therefore not checked (share of random poses): {_shares(mostly)}"
        )
        remedy = (
            "if the links can collide, give narrower limits to the joints between them with --limit "
            "JOINT.position=LOW:HIGH."
        )
        findings.append(Finding("pairs-touching-mostly", "info", "", said, remedy))
    return tuple(findings)


def _bodies(pairs: Sequence[IgnoredPair]) -> str:
    return f"{plural(len(pairs), 'pair')} of bodies"


def _are(pairs: Sequence[IgnoredPair]) -> str:
    return "is" if len(pairs) == 1 else "are"


def _by_reason(pairs: Sequence[IgnoredPair]) -> list[str]:
    """Texts about unchecked pairs of bodies: each reason, with the pair of links or the number of pairs."""
    return [
        f"{why} ({found[0] if len(found) == 1 else plural(len(found), 'pair') + ' of links'})"
        for why, found in pairs_by_reason(pairs).items()
    ]


def _shares(pairs: Sequence[IgnoredPair]) -> str:
    return "; ".join(each.account for each in pairs)


def _checked_start(robot: Robot, limits: Limits, given: Array) -> Array:
    """Start pose (n,) that the user gives, after a check of its length and of the position limits."""
    start = np.asarray(given, dtype=np.float64)
    if start.shape != (robot.n,):
        raise ArmidError(
            f"The start pose has {start.size} numbers, but {robot.name} has {robot.n} joints.",
            possible=f"one number for each joint, in this order: {', '.join(robot.joint_names)}",
            remedy=f"give {robot.n} numbers with --start, or leave --start out; then a start pose is chosen.",
        )
    for name, q, low, high in zip(robot.joint_names, start, limits.lower, limits.upper, strict=True):
        if not low < q < high:
            raise ArmidError(
                f"The start pose has {name} at {q:g}, outside the limits {low:g} to {high:g}.",
                remedy="choose a pose inside the limits with --start.",
            )
    return start
