"""Reading of the bodies that an arm's joints move, from the description of the arm."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from armid.maths.inertia import vector_to_com_inertia
from armid.robot.described_bodies import mjcf, urdf
from armid.robot.described_bodies.body import DescribedBody
from armid.robot.loading import builtin_arms, expanded
from armid.robot.packages import forget, give_packages
from armid.robot.readers import READERS
from armid.robot.robot import Robot


def described_bodies(robot: Robot, *, packages: Mapping[str, str] | None = None) -> tuple[DescribedBody, ...]:
    """Bodies with a mass that the joints of an arm move, as its description states them.

    Bodies on fixed and locked joints are separate here. Bodies of the base are left out, because they do not move.

    Args:
        robot: The arm, whose `source` is read again.
        packages: Folders of ROS packages by name, as in `load_robot`.

    Raises:
        RobotError: The description cannot be read any more.
    """
    given = give_packages(packages or {})
    try:
        if robot.source in builtin_arms() or not Path(robot.source).is_file():
            return _links(robot)
        text, source, reader = expanded(robot.source)
        if reader is READERS["urdf"].reader:
            found = urdf.bodies(text, source)
        elif reader is READERS["mjcf"].reader:
            found = mjcf.bodies(text, source)
        else:
            return _links(robot)
        outline = reader.outline(text, source=source)
    finally:
        forget(given)
    moving = set(robot.joint_names)
    return tuple(body for body in found if outline.chain(body.name) & moving)


def _links(robot: Robot) -> tuple[DescribedBody, ...]:
    """Links with a mass, for an arm whose description has no separate bodies, such as a DH table.

    They have no shapes, because the capsules of a table surround the links only loosely.
    """
    masses = [(link.name, link.inertial.vector) for link in robot.links if link.inertial and link.inertial.mass]
    return tuple(DescribedBody(name, *vector_to_com_inertia(vector), ()) for name, vector in masses)
