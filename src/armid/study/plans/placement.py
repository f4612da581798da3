"""Start of a motion and what it keeps apart: the start pose that is given or found, bodies, a floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.errors import ArmidError, Finding
from armid.excitation.collision.collision_model import (
    CollisionOptions,
    empty_collision_model,
    kept_apart,
    make_collision_model,
)
from armid.excitation.limits.joint_limits import Limits
from armid.excitation.start_pose import Holds, any_pose, choose_start, usual_pose
from armid.robot.robot import Robot
from armid.robot.shapes import Shape
from armid.study.plans.goals import DesignConstraints
from armid.values import Array

__all__ = ["Placement", "place_motion"]


@dataclass(frozen=True, eq=False, slots=True)
class Placement:
    """Start of a motion.

    Attributes:
        start: The pose, shape (n,) [rad or m].
        collision: What keeps apart from there; nothing where collisions are not checked.
        findings: What the reader should know.
        unchecked: Why collisions are not checked; empty where they are.
    """

    start: Array
    collision: CollisionOptions | None
    findings: tuple[Finding, ...]
    unchecked: str = ""


def place_motion(
    robot: Robot, limits: Limits, rules: DesignConstraints, given: Array | None, holds: Holds = any_pose
) -> Placement:
    """The start pose that is given, or one with room around it, and what keeps apart from there.

    Without collisions it is zero where joints can be there, else the middle of their range, if its torque can be
    held; where bodies must keep apart, or it cannot, see `armid.excitation.start_pose`.

    Args:
        robot: The arm.
        limits: Of its joints.
        rules: What keeps apart.
        given: The pose, shape (n,) [rad or m], where one is given.
        holds: Which poses the joints can hold.

    Raises:
        ArmidError: The pose breaks a limit, or bodies are too close in it.
    """
    if given is not None:
        given = _checked_start(robot, limits, given)
    if rules.clearance is None:
        why = "left out (--no-collision)" if robot.shapes else "the description has no bodies"
        start, findings = (given, ()) if given is not None else _anywhere(robot, limits, holds)
        return Placement(start, None, (*findings, _unseen(why)), why)
    floor = None if rules.floor is None else rules.floor.shape
    said = None if rules.floor is None else _no_floor(rules.floor.why)
    if floor is not None:
        try:
            found = _among(robot, limits, rules, (*rules.surroundings, floor), given, holds)
            return Placement(found.start, found.collision, (*found.findings, _floor(floor)))
        except ArmidError as error:
            said = _no_floor(f"the arm does not start above the plane through its base ({error.problem})")
    found = _among(robot, limits, rules, rules.surroundings, given, holds)
    return found if said is None else Placement(found.start, found.collision, (*found.findings, said))


def _among(
    robot: Robot,
    limits: Limits,
    rules: DesignConstraints,
    around: tuple[Shape, ...],
    given: Array | None,
    holds: Holds,
) -> Placement:
    """The start among bodies."""
    assert rules.clearance is not None
    cell = make_collision_model(robot, limits, around, margin=rules.clearance)
    findings: tuple[Finding, ...] = ()
    start = given
    if start is None:
        chosen = choose_start(cell, limits, holds)
        start = chosen.pose
        if not chosen.usual:
            said = (
                f"the usual start pose leaves less room; the series starts at {_numbers(start)}, "
                f"about which {100 * chosen.room:.0f} % of the swings that were tried are free"
            )
            findings = (_chosen(said),)
    collision = kept_apart(cell, start)
    return Placement(start, collision, (*findings, *_left_out(collision)))


def _anywhere(robot: Robot, limits: Limits, holds: Holds) -> tuple[Array, tuple[Finding, ...]]:
    """The usual pose, or another one where the joints cannot hold that."""
    usual = usual_pose(limits)
    if holds(usual[None])[0]:
        return usual, ()
    chosen = choose_start(empty_collision_model(robot), limits, holds)
    said = f"the joints cannot hold the usual start pose; the series starts at {_numbers(chosen.pose)}"
    return chosen.pose, (_chosen(said),)


def _numbers(pose: Array) -> str:
    return " ".join(f"{q:g}" for q in pose)


def _chosen(said: str) -> Finding:
    return Finding("start-chosen", "info", "", said, "choose another with --start.")


def _unseen(why: str) -> Finding:
    """Return what is to be known of a plan that keeps the limits of joints alone."""
    return Finding(
        "collision-unseen",
        "warning",
        "",
        f"collisions were not checked: {why}; the arm may meet itself, the floor or what stands by",
        "look at the preview and run the rehearsal first.",
    )


def _floor(floor: Shape) -> Finding:
    """That a floor was assumed, and where."""
    said = f"{floor.name}: the plane through the base frame's origin, across gravity; the arm keeps above it"
    return Finding("floor-assumed", "info", "", said, "move it with --floor HEIGHT, or leave it out with --no-floor.")


def _no_floor(why: str) -> Finding:
    """That no floor was assumed, and why."""
    remedy = "say with --floor HEIGHT, in metres over the base, where there is one."
    return Finding("floor-left-out", "info", "", f"no floor is assumed: {why}", remedy)


def _left_out(collision: CollisionOptions) -> tuple[Finding, ...]:
    """Pairs of bodies that nobody looks at, which is the description's doing."""
    if not collision.skipped:
        return ()
    pairs = "; ".join(f"{each.pair} ({100 * each.share:.0f} %)" for each in collision.skipped)
    said = f"{len(collision.skipped)} pairs of bodies touch in nearly all poses and are not looked at: {pairs}"
    return (Finding("pairs-touching-always", "info", "", said),)


def _checked_start(robot: Robot, limits: Limits, given: Array) -> Array:
    """A start pose inside its limits."""
    start = np.asarray(given, dtype=np.float64)
    if start.shape != (robot.n,):
        raise ArmidError(
            f"The start pose has {start.size} numbers; {robot.name} has {robot.n} joints.",
            possible=f"one number a joint, in this order: {', '.join(robot.joint_names)}",
        )
    for name, q, low, high in zip(robot.joint_names, start, limits.lower, limits.upper, strict=True):
        if not low < q < high:
            raise ArmidError(
                f"The start pose puts {name} at {q:g}, outside {low:g} to {high:g}.",
                remedy="choose a pose inside the limits with --start.",
            )
    return start
