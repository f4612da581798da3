"""Conversion of a Pinocchio model to a `Robot`, for the readers of URDF and MJCF."""

from __future__ import annotations

import importlib
import math
import os
import tempfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array
from armid.errors import Finding, RobotError
from armid.maths.rotations import homogeneous
from armid.robot.described_drive import DescribedDrive
from armid.robot.robot import EARTH_GRAVITY, Frame, InertialParameters, Joint, Link, Robot

ORTHONORMAL_TOLERANCE = 1e-6
"""Largest deviation of RᵀR from the identity that can be explained by rounding of printed numbers."""

NO_STOP = 100.0
"""Position limit [rad] from which a revolute joint counts as unlimited, because no real arm turns 16 times between
its limits."""

NO_SPEED = 100.0
"""Velocity limit [rad/s or m/s] from which the limit counts as unknown: ten times the velocity of the fastest arms.
Descriptions for simulators contain limits of 100 to 50 000 if the real limits were not known."""

NO_EFFORT = 1000.0
"""Effort limit [N·m or N] from which the limit counts as unknown if the velocity limit of the joint is unknown, too.
Strong arms have such effort limits, but their velocity limits are known."""

FLANGE_NAMES = ("tool0", "flange")
"""Names of the frame of the tool flange, in order of preference, by the convention REP 199 of ROS-Industrial."""

Rotating = ("RX", "RY", "RZ", "RUBX", "RUBY", "RUBZ", "RevoluteUnaligned", "RevoluteUnboundedUnaligned")
Sliding = ("PX", "PY", "PZ", "PrismaticUnaligned")


@dataclass(frozen=True, slots=True)
class DescribedLimits:
    """Limits of one joint; infinite if the description does not contain a limit.

    Attributes:
        lower: Lowest position [rad or m].
        upper: Highest position [rad or m].
        velocity: Largest speed [rad/s or m/s].
        effort: Largest effort [N·m or N].
        soft: Lowest and highest position [rad or m] that the controller of the robot allows.
    """

    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf
    soft: tuple[float, float] = (-math.inf, math.inf)


def limits_of(
    joint: str, *, position: tuple[float, float] | None, velocity: float, effort: float, turns: bool
) -> tuple[DescribedLimits, Finding | None]:
    """Limits of a joint from its description; placeholder values are treated as unknown limits.

    Placeholders are a velocity or effort limit of zero, a position range of zero width, a position range of a
    rotating joint that is wider than that of any real joint, and a velocity limit that no arm reaches. If the
    velocity limit is one that no arm reaches, the effort limit also counts as a placeholder if it is the same number
    or 1000 or more. All placeholders except zeros are reported in a finding.

    Args:
        joint: Name of the joint.
        position: Lower and upper limit [rad or m]; `None` if not given.
        velocity: Velocity limit [rad/s or m/s]; 0 if not given.
        effort: Effort limit [N·m or N]; 0 if not given.
        turns: True if the joint rotates.

    Raises:
        RobotError: The lower limit is larger than the upper limit.
    """
    lower, upper = position or (-math.inf, math.inf)
    unit, effort_unit = ("rad", "N·m") if turns else ("m", "N")
    finding = None
    if lower > upper:
        raise RobotError(
            f"The lower position limit {lower:g} {unit} of joint {joint!r} is above the upper limit "
            f"{upper:g} {unit}.",
            remedy="exchange the two limits.",
        )
    if lower == upper or (turns and position is not None and min(-lower, upper) > NO_STOP):
        finding = Finding(
            "limits-unknown",
            "info",
            joint,
            f"position limits {lower:g} to {upper:g} {unit} are implausible; the joint is treated as unlimited",
            "write the real limits of the joint into the description if they are needed",
        )
        lower, upper = -math.inf, math.inf
    velocity, effort = abs(velocity) or math.inf, abs(effort) or math.inf
    if NO_SPEED <= velocity < math.inf:
        both = effort == velocity or NO_EFFORT <= effort < math.inf
        effort_too = f" and effort limit {effort:g} {effort_unit}" if both else ""
        stated = f"velocity limit {velocity:g} {unit}/s{effort_too}"
        position_too = f"{finding.evidence}; " if finding is not None else ""
        finding = Finding(
            "limits-unknown",
            "info",
            joint,
            f"{position_too}{stated}: no arm reaches this, so the limit counts as unknown",
            "write the real limits of the joint into the description if they are needed",
        )
        velocity, effort = math.inf, math.inf if both else effort
    return DescribedLimits(lower, upper, velocity, effort), finding


def pinocchio() -> Any:
    """Module pinocchio, imported at the first use because this takes 0.3 s."""
    return importlib.import_module("pinocchio")


def build(make: Callable[[], Any], source: str) -> Any:
    """Result of `make` for a description; messages that the parser prints become part of the error.

    Raises:
        RobotError: The parser does not accept the description, or it prints an error and ignores a part of the
            description.
    """
    result, reason = None, ""
    # urdfdom prints errors to the C++ standard error only, and continues without an inertia that it cannot read.
    with tempfile.TemporaryFile() as stderr:
        saved = os.dup(2)
        os.dup2(stderr.fileno(), 2)
        try:
            result = make()
        except (ValueError, RuntimeError) as error:
            reason = str(error).strip().splitlines()[-1].removeprefix("message:").strip()
        finally:
            os.dup2(saved, 2)
            os.close(saved)
        stderr.seek(0)
        lines = [line.strip() for line in stderr.read().decode(errors="replace").splitlines()]
    messages = [line.removeprefix("Error:").strip() for line in lines if line.startswith("Error:")]
    if result is None or messages:
        raise RobotError(
            f"{source} cannot be read as a robot description: {'; '.join(messages) or reason}",
            remedy="correct this error in the description.",
        )
    return result


def robot_from_model(
    model: Any,
    *,
    name: str,
    limits: Mapping[str, DescribedLimits],
    source: str,
    locked: Collection[str],
    tip: str | None,
    gravity: ArrayLike = EARTH_GRAVITY,
    findings: tuple[Finding, ...] = (),
    drives: Mapping[str, DescribedDrive] | None = None,
) -> Robot:
    """Robot from a Pinocchio model, in which fixed joints are merged already.

    Args:
        model: A `pinocchio.Model`.
        name: Name of the robot.
        limits: Limits of the joints, by name.
        source: Path of the description.
        locked: Joints that will be locked; they are not counted in the search for the tip.
        tip: Name of the tip frame; if `None`, it is searched (see `find_tip`).
        gravity: Acceleration of gravity in the base frame (3,) [m/s²].
        findings: Findings of the reader.
        drives: Rotor inertia and friction of the joints, by name.

    Raises:
        RobotError: There is no movable joint, a joint does not have exactly one degree of freedom, or the tip frame
            does not exist.
    """
    if model.njoints < 2:
        raise RobotError(
            f"{source} has no movable joint.",
            remedy="give a description with at least one revolute, continuous or prismatic joint.",
        )
    joints = tuple(_joint(model, i, limits, source) for i in range(1, model.njoints))
    joints = tuple(replace(joint, drive=(drives or {}).get(joint.name, joint.drive)) for joint in joints)
    links = tuple(_link(model, i) for i in range(1, model.njoints))
    frame = find_tip(model, locked) if tip is None else _named_frame(model, tip, source)
    placement = _placement(frame.placement, f"frame {frame.name!r}", source)
    return Robot(
        name,
        joints,
        links,
        Frame(frame.name, frame.parentJoint - 1, placement),
        np.array(gravity, dtype=np.float64),
        source=source,
        findings=findings,
    )


def find_tip(model: Any, locked: Collection[str]) -> Any:
    """Finds the frame of the tool flange.

    The search begins at the last movable joint of the longest chain. Locked joints are not counted; if several chains
    are equally long, the last one is taken. If a frame fixed to the link of this joint is called tool0 or flange, it
    is the tip. Otherwise the search follows the bodies that are fixed to the link outwards, as long as there is only
    one. If there are several such bodies, but only one of them is on a fixed joint and the others are on locked
    joints, the search continues with this one; otherwise it stops.
    """
    frames = list(model.frames)
    last = _last_joint(model, locked)
    fixed, over_locked = _attached(model, locked)
    joint = next(k for k, f in enumerate(frames) if f.type.name == "JOINT" and f.parentJoint == last)
    body = next((b for b, f in enumerate(frames) if f.type.name == "BODY" and f.parentFrame == joint), joint)
    reached, carried = [body], [body]
    while reached:
        reached = [b for k in reached for b in fixed[k] + over_locked[k]]
        carried += reached
    for wanted in FLANGE_NAMES:
        for k in carried:
            if frames[k].name == wanted:
                return frames[k]
    onwards = [body]
    while len(onwards) == 1:
        body = onwards[0]
        onwards = fixed[body] if len(fixed[body]) == 1 else fixed[body] + over_locked[body]
    return frames[body]


def _last_joint(model: Any, locked: Collection[str]) -> int:
    """Index of the last movable joint of the longest chain of joints; locked joints are not counted."""
    depth = [0] * model.njoints
    for i in range(1, model.njoints):
        depth[i] = depth[model.parents[i]] + (model.names[i] not in locked)
    moving = [i for i in range(1, model.njoints) if model.names[i] not in locked]
    if not moving:
        raise RobotError(
            "All joints are locked, so no joint can move.",
            remedy="change --lock, --only or --tip so that at least one joint is not locked.",
        )
    return max(moving, key=lambda i: (depth[i], i))


def _attached(model: Any, locked: Collection[str]) -> tuple[dict[int, list[int]], dict[int, list[int]]]:
    """Indices of the bodies that are attached to each frame by a fixed joint, and by a locked joint."""
    frames = list(model.frames)
    fixed: dict[int, list[int]] = {k: [] for k in range(len(frames))}
    over_locked: dict[int, list[int]] = {k: [] for k in range(len(frames))}
    for k, body in enumerate(frames):
        joint = frames[body.parentFrame]
        if body.type.name == "BODY" and joint.type.name == "FIXED_JOINT":
            fixed[joint.parentFrame].append(k)
        elif body.type.name == "BODY" and joint.type.name == "JOINT" and joint.name in locked:
            over_locked[joint.parentFrame].append(k)
    return fixed, over_locked


def _named_frame(model: Any, name: str, source: str) -> Any:
    """Frame with a given name; bodies take precedence over other frames."""
    kinds = {kind: [f for f in model.frames if f.type.name == kind] for kind in ("BODY", "OP_FRAME", "FIXED_JOINT")}
    for frames in kinds.values():
        for frame in frames:
            if frame.name == name:
                return frame
    raise RobotError(
        f"{source} has no frame {name!r} for the tip.",
        possible=", ".join(f.name for frames in kinds.values() for f in frames if f.name != "universe"),
        remedy="give the name of one of these frames.",
    )


def _joint(model: Any, i: int, limits: Mapping[str, DescribedLimits], source: str) -> Joint:
    """Converts joint i of a Pinocchio model to a `Joint` with its limits."""
    joint, name = model.joints[i], model.names[i]
    kind = joint.shortname().removeprefix("JointModel")
    if kind not in Rotating + Sliding:
        raise RobotError(
            f"{source}: joint {name!r} is of kind {kind}, which armid cannot model: it needs exactly one degree of "
            "freedom.",
            possible="revolute, continuous, prismatic",
            remedy=f"lock {name!r} with --lock, or replace it by joints of these kinds.",
        )
    data = joint.createData()
    joint.calc(data, pinocchio().neutral(model))
    subspace = np.asarray(data.S).reshape(6)  # linear part first
    prismatic = kind in Sliding
    limit = limits.get(name, DescribedLimits())
    bounded = math.isfinite(limit.lower) or math.isfinite(limit.upper)
    return Joint(
        name,
        "prismatic" if prismatic else "revolute" if bounded else "continuous",
        int(model.parents[i]) - 1,
        subspace[:3] if prismatic else subspace[3:],
        _placement(model.jointPlacements[i], f"joint {name!r}", source),
        np.array([limit.lower, limit.upper]),
        limit.velocity,
        limit.effort,
        np.array(limit.soft),
    )


def _link(model: Any, i: int) -> Link:
    """Converts link i of a Pinocchio model to a `Link` with the name of its body; a zero inertia becomes `None`."""
    vector = np.asarray(model.inertias[i].toDynamicParameters())
    bodies = [
        f.name
        for f in model.frames
        if f.type.name == "BODY" and f.parentJoint == i and model.frames[f.parentFrame].type.name == "JOINT"
    ]
    name = bodies[0] if bodies else f"link of {model.names[i]}"
    return Link(name, InertialParameters.from_vector(vector) if vector.any() else None)


def _placement(pose: Any, where: str, source: str) -> Array:
    """Homogeneous transform of a Pinocchio pose, after a check of its rotation."""
    rotation = np.array(pose.rotation)
    if not np.abs(rotation.T @ rotation - np.eye(3)).max() < ORTHONORMAL_TOLERANCE:
        raise RobotError(
            f"{source}: the orientation of {where} is not a rotation.",
            remedy=f"correct the angles or axes of {where} in the description.",
        )
    return homogeneous(rotation, np.array(pose.translation))
