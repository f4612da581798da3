"""Missing and impossible inertias: joints that move no mass, links without mass, placeholders, negative moments."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding
from armid.maths.inertia import vector_to_com_inertia
from armid.robot.robot import Robot

PLACEHOLDER = 0.01
"""Mass below which the mass of a moving link may be a placeholder [kg], because simulators refuse a mass of zero."""

NEGLIGIBLE = 0.01
"""Ratio of a mass to the mass of the heaviest link below which the mass may be a placeholder. This second condition
is needed because real links of small arms may weigh only grams."""


ROUNDING = 1e-6
"""Largest ratio of the size of a negative moment of inertia to the largest moment that counts as rounding."""


CANCELLED = 1e-12
"""Ratio of the inertia about the centre of mass to that about the origin below which the former is only rounding."""


def impossible_inertias(inertias: Mapping[str, Array]) -> tuple[Finding, ...]:
    """Findings about negative masses and moments of inertia.

    Args:
        inertias: Inertial parameters (10,) of moving bodies in their own frames, by name.
    """
    found: list[Finding] = []
    for name, vector in inertias.items():
        mass = float(vector[0])
        moments = np.linalg.eigvalsh(_about_com(vector))
        if mass >= 0.0 and moments[0] >= -ROUNDING * max(abs(moments[-1]), abs(moments[0])):
            continue
        told = ", ".join(f"{x:.3g}" for x in moments)
        what = (
            f"no body has a mass of {mass:.4g} kg and the principal moments of inertia {told} kg·m²: mass and "
            "moments are never negative"
        )
        remedy = "correct the <inertial> of the body; armid certify compares it with the shapes of the body"
        found.append(Finding("inertia-impossible", "warning", name, what, remedy))
    return tuple(found)


def point_masses(inertias: Mapping[str, Array]) -> tuple[Finding, ...]:
    """Findings about bodies with a mass but without inertia about their centres of mass.

    Args:
        inertias: Inertial parameters (10,) of moving bodies in their own frames, by name.
    """
    bare = [name for name, vector in inertias.items() if vector[0] and not _about_com(vector).any()]
    what = "the link has a mass but no inertia; it is treated as a point mass"
    remedy = (
        "if the inertia is known, give diaginertia or fullinertia in <inertial>; MuJoCo refuses a moving point mass"
    )
    return tuple(Finding("inertia-missing", "info", name, what, remedy) for name in bare)


def _about_com(vector: Array) -> Array:
    """Inertia (3, 3) of a body about its centre of mass [kg·m²]; zero if it is only the rounding of its terms."""
    if not vector[0]:
        return np.zeros((3, 3))
    about = vector_to_com_inertia(vector)[2]
    return about if np.abs(about).max() > CANCELLED * np.abs(vector[4:]).max() else np.zeros((3, 3))


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
