"""Joints that move no mass according to the description, and the key for the missing inertia in its format."""

from __future__ import annotations

from armid.robot.robot import Robot


def massless_joints(robot: Robot) -> tuple[str, ...]:
    """Names of the joints that move no mass according to the description."""
    carried = [0.0 if link.inertial is None else link.inertial.mass for link in robot.links]
    for i in range(robot.n - 1, -1, -1):
        if robot.joints[i].parent >= 0:
            carried[robot.joints[i].parent] += carried[i]
    return tuple(joint.name for joint, mass in zip(robot.joints, carried, strict=True) if mass == 0.0)


def inertial_key(robot: Robot) -> str:
    """Key for the inertia of a link in the format of the description."""
    return "<inertial>" if robot.source.endswith(("xml", "urdf", "xacro", "mjcf")) else "[joint.inertial]"
