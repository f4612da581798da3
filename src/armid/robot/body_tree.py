"""Tree of bodies of a URDF or MJCF; fixed joints are merged into the link that carries them."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array
from armid.errors import Finding, RobotError
from armid.maths.inertia import transform
from armid.maths.rotations import homogeneous
from armid.robot.described_drive import DescribedDrive
from armid.robot.described_limits import DescribedLimits
from armid.robot.robot import EARTH_GRAVITY, Frame, InertialParameters, Joint, Link, Robot

ORTHONORMAL_TOLERANCE = 1e-6
"""Largest deviation of RᵀR from the identity that can be explained by rounding of printed numbers."""

FLANGE_NAMES = ("tool0", "flange")
"""Names of the frame of the tool flange, in order of preference, by the convention REP 199 of ROS-Industrial."""

FrameKind = Literal["body", "site", "joint", "fixed"]

NAMED_KINDS: tuple[FrameKind, ...] = ("body", "site", "fixed")
"""Kinds of frames that can be the tip, in order of preference."""


@dataclass(frozen=True, eq=False, slots=True)
class TreeFrame:
    """Frame of a tree of bodies.

    Attributes:
        name: Name of the body, site or joint; empty for a joint that has none.
        kind: `body`, `site`, `joint` (the frame of a movable joint) or `fixed` (that of a fixed joint).
        joint: Index of the movable joint that carries the frame; -1 for the base.
        above: Index of the frame to which it is attached; -1 for the frame of the base.
        placement: Pose in the frame of the link that the joint moves, shape (4, 4).
    """

    name: str
    kind: FrameKind
    joint: int
    above: int
    placement: Array


@dataclass(frozen=True, eq=False, slots=True)
class TreeJoint:
    """Movable joint of a tree of bodies.

    Attributes:
        name: Name of the joint.
        parent: Index of the joint whose link carries this joint; -1 for the base.
        axis: Direction of the axis in the frame of the joint, shape (3,).
        is_prismatic: True if the joint is prismatic.
        placement: Pose in the frame of the parent link, shape (4, 4).
    """

    name: str
    parent: int
    axis: Array
    is_prismatic: bool
    placement: Array


@dataclass(slots=True)
class BodyTree:
    """Joints, inertias and frames of a description, in the order in which a reader has added them.

    Attributes:
        joints: Movable joints, parents before children.
        inertias: Inertial parameters (10,) of the link that each joint moves, in the frame of that link.
        frames: Frames of bodies, joints and sites.
    """

    joints: list[TreeJoint] = field(default_factory=list[TreeJoint])
    inertias: list[Array] = field(default_factory=list[Array])
    frames: list[TreeFrame] = field(default_factory=list[TreeFrame])

    def add_joint(self, above: int, name: str, pose: Array, axis: ArrayLike, *, is_prismatic: bool) -> int:
        """Adds a movable joint and returns the index of its frame.

        Args:
            above: Index of the frame of the body that carries the joint; -1 for the base.
            name: Name of the joint.
            pose: Pose (4, 4) in the frame of that body.
            axis: Direction of the axis, shape (3,).
            is_prismatic: True if the joint is prismatic.
        """
        parent, placement = self._carrier(above)
        direction = np.asarray(axis, dtype=np.float64)
        self.joints.append(TreeJoint(name, parent, direction, is_prismatic, placement @ pose))
        self.inertias.append(np.zeros(10))
        return self._add_frame(TreeFrame(name, "joint", len(self.joints) - 1, above, np.eye(4)))

    def add_frame(self, above: int, name: str, kind: FrameKind, pose: Array) -> int:
        """Adds a body, site or fixed joint with a pose (4, 4) in a frame `above`; returns the index of its frame."""
        joint, placement = self._carrier(above)
        return self._add_frame(TreeFrame(name, kind, joint, above, placement @ pose))

    def add_inertia(self, frame: int, vector: Array) -> None:
        """Adds inertial parameters (10,), given in a frame, to the link that carries it; no effect on the base."""
        joint, placement = self._carrier(frame)
        if joint >= 0:
            self.inertias[joint] = self.inertias[joint] + transform(vector, placement[:3, :3], placement[:3, 3])

    def bodies(self) -> Iterator[tuple[int, TreeFrame]]:
        """Yields the frames of the bodies with their indices."""
        return ((k, frame) for k, frame in enumerate(self.frames) if frame.kind == "body")

    def is_moved(self, joint: int, locked: Collection[str]) -> bool:
        """Tests whether a joint that is not locked carries the link of a joint; joint -1 is the base."""
        while joint >= 0 and self.joints[joint].name in locked:
            joint = self.joints[joint].parent
        return joint >= 0

    def _carrier(self, frame: int) -> tuple[int, Array]:
        """Joint that carries a frame, and the pose of the frame in the frame of its link."""
        return (-1, np.eye(4)) if frame < 0 else (self.frames[frame].joint, self.frames[frame].placement)

    def _add_frame(self, frame: TreeFrame) -> int:
        self.frames.append(frame)
        return len(self.frames) - 1


def robot_from_tree(
    tree: BodyTree,
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
    """Robot from a tree of bodies.

    Args:
        tree: The tree.
        name: Name of the robot.
        limits: Limits of the joints, by name.
        source: Path of the description.
        locked: Joints that will be locked; they are not counted in the search for the tip.
        tip: Name of the tip frame; if `None`, it is searched (see `find_tip`).
        gravity: Acceleration of gravity in the base frame (3,) [m/s²].
        findings: Findings of the reader.
        drives: Rotor inertia and friction of the joints, by name.

    Raises:
        RobotError: There is no movable joint, an orientation is not a rotation, or the tip frame does not exist.
    """
    if not tree.joints:
        raise RobotError(
            f"{source} has no movable joint.",
            remedy="give a description with at least one revolute, continuous or prismatic joint.",
        )
    of = drives or {}
    joints = tuple(
        _joint(joint, limits.get(joint.name, DescribedLimits()), of.get(joint.name, DescribedDrive()), source)
        for joint in tree.joints
    )
    frame = find_tip(tree, locked) if tip is None else _named_frame(tree, tip, source)
    placement = _checked(frame.placement, f"frame {frame.name!r}", source)
    return Robot(
        name,
        joints,
        _links(tree),
        Frame(frame.name, frame.joint, placement),
        np.array(gravity, dtype=np.float64),
        source=source,
        findings=findings,
    )


def find_tip(tree: BodyTree, locked: Collection[str]) -> TreeFrame:
    """Finds the frame of the tool flange.

    The search begins at the last movable joint of the longest chain. Locked joints are not counted; if several chains
    are equally long, the last one is taken. If a frame fixed to the link of this joint is called tool0 or flange, it
    is the tip. Otherwise the search follows the bodies that are fixed to the link outwards, as long as there is only
    one. If there are several such bodies, but only one of them is on a fixed joint and the others are on locked
    joints, the search continues with this one; otherwise it stops.
    """
    frames = tree.frames
    last = _last_joint(tree, locked)
    fixed, over_locked = _attached(tree, locked)
    joint = next(k for k, f in enumerate(frames) if f.kind == "joint" and f.joint == last)
    body = next((k for k, f in tree.bodies() if f.above == joint), joint)
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


def _last_joint(tree: BodyTree, locked: Collection[str]) -> int:
    """Index of the last movable joint of the longest chain of joints; locked joints are not counted."""
    depth: list[int] = []
    for joint in tree.joints:
        above = depth[joint.parent] if joint.parent >= 0 else 0
        depth.append(above + (joint.name not in locked))
    moving = [i for i, joint in enumerate(tree.joints) if joint.name not in locked]
    if not moving:
        raise RobotError(
            "All joints are locked, so no joint can move.",
            remedy="change --lock, --only or --tip so that at least one joint is not locked.",
        )
    return max(moving, key=lambda i: (depth[i], i))


def _attached(tree: BodyTree, locked: Collection[str]) -> tuple[dict[int, list[int]], dict[int, list[int]]]:
    """Indices of the bodies that each frame carries on fixed joints, and of those that it carries on locked ones."""
    fixed: dict[int, list[int]] = {k: [] for k in range(-1, len(tree.frames))}
    over_locked: dict[int, list[int]] = {k: [] for k in range(-1, len(tree.frames))}
    for k, body in tree.bodies():
        if body.above < 0:
            continue
        joint = tree.frames[body.above]
        if joint.kind == "fixed":
            fixed[joint.above].append(k)
        elif joint.kind == "joint" and joint.name in locked:
            over_locked[joint.above].append(k)
    return fixed, over_locked


def _named_frame(tree: BodyTree, name: str, source: str) -> TreeFrame:
    """Frame with a given name; bodies take precedence over other frames."""
    frames = [frame for kind in NAMED_KINDS for frame in tree.frames if frame.kind == kind]
    for frame in frames:
        if frame.name == name:
            return frame
    raise RobotError(
        f"{source} has no frame {name!r} for the tip.",
        possible=", ".join(frame.name for frame in frames if frame.name),
        remedy="give the name of one of these frames.",
    )


def _joint(joint: TreeJoint, limit: DescribedLimits, drive: DescribedDrive, source: str) -> Joint:
    """Joint of a robot with its limits."""
    bounded = math.isfinite(limit.lower) or math.isfinite(limit.upper)
    return Joint(
        joint.name,
        "prismatic" if joint.is_prismatic else "revolute" if bounded else "continuous",
        joint.parent,
        joint.axis,
        _checked(joint.placement, f"joint {joint.name!r}", source),
        np.array([limit.lower, limit.upper]),
        limit.velocity,
        limit.effort,
        np.array(limit.soft),
        drive,
    )


def _links(tree: BodyTree) -> tuple[Link, ...]:
    """Links with the names of their bodies; a zero inertia becomes `None`."""
    names: dict[int, str] = {}
    for _, body in tree.bodies():
        if body.above >= 0 and tree.frames[body.above].kind == "joint":
            names.setdefault(body.joint, body.name)
    return tuple(
        Link(
            names.get(i, f"link of {joint.name}"),
            InertialParameters.from_vector(tree.inertias[i]) if tree.inertias[i].any() else None,
        )
        for i, joint in enumerate(tree.joints)
    )


def _checked(pose: Array, where: str, source: str) -> Array:
    """Pose (4, 4), after a check of its rotation."""
    rotation = pose[:3, :3]
    if not np.abs(rotation.T @ rotation - np.eye(3)).max() < ORTHONORMAL_TOLERANCE:
        raise RobotError(
            f"{source}: the orientation of {where} is not a rotation.",
            remedy=f"correct the angles or axes of {where} in the description.",
        )
    return homogeneous(rotation, pose[:3, 3])
