"""Inertias that a description lacks: joints that move no mass, links with geometry but without mass, placeholders."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.robot.robot import Robot

PLACEHOLDER = 0.01
"""Mass below which the mass of a moving link may be a placeholder [kg], because simulators refuse a mass of zero."""

NEGLIGIBLE = 0.01
"""Ratio of a mass to the mass of the heaviest link below which the mass may be a placeholder. This second condition
is needed because real links of small arms may weigh only grams."""


def placeholder_masses(masses: Array) -> NDArray[np.bool_]:
    """Mask (K,) of the masses of an arm's links (K,) [kg] that are placeholders for unknown masses."""
    return masses < min(PLACEHOLDER, NEGLIGIBLE * float(masses.max(initial=0.0)))


def massless_joints(robot: Robot) -> tuple[str, ...]:
    """Names of the joints that move no mass according to the description."""
    carried = [0.0 if link.inertial is None else link.inertial.mass for link in robot.links]
    for i in range(robot.n - 1, -1, -1):
        if robot.joints[i].parent >= 0:
            carried[robot.joints[i].parent] += carried[i]
    return tuple(joint.name for joint, mass in zip(robot.joints, carried, strict=True) if mass == 0.0)


def links_without_inertia(robot: Robot) -> tuple[int, ...]:
    """Indices of links with geometry but without mass, in a description that gives other links a mass.

    The real mass of such links is not known from the description, for instance because a simulator computes it from
    meshes. A link without geometry and mass is only a frame.
    """
    if robot.inertial_vector is None:
        return ()
    solid = {shape.link for shape in (*robot.shapes, *robot.visuals)}
    return tuple(
        i for i, link in enumerate(robot.links) if i in solid and (link.inertial is None or not link.inertial.mass)
    )


def joints_with_unknown_load(robot: Robot) -> tuple[str, ...]:
    """Names of the joints that move a link of unknown mass (`links_without_inertia`)."""
    moved: set[int] = set()
    for i in links_without_inertia(robot):
        while i >= 0:
            moved.add(i)
            i = robot.joints[i].parent
    return tuple(robot.joint_names[i] for i in sorted(moved))


def inertial_key(robot: Robot) -> str:
    """Name of the element or key with which the format of the description states the inertia of a link."""
    return "<inertial>" if robot.source.endswith(("xml", "urdf", "xacro", "mjcf")) else "[joint.inertial]"
