"""Element <inertial> of an MJCF: its checks, its plain form, and the inertial parameters that it states."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from armid.checked_array import Array
from armid.errors import RobotError
from armid.maths.inertia import com_inertia_to_vector, vector_to_com_inertia
from armid.robot.mjcf.poses import placement_of
from armid.robot.mjcf.settings import ORIENTATIONS, Settings

INERTIAL = {"mass": 1, "diaginertia": 3, "fullinertia": 6}
"""Attributes of the element besides its pose, with their numbers of values."""

FULL = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Row and column of the entries of the attribute `fullinertia`."""


def plain_inertial(body: ET.Element, settings: Settings, name: str) -> ET.Element | None:
    """Element <inertial> of a body in plain form; `None` if the body has none.

    Args:
        body: The body.
        settings: Settings of the document.
        name: Name of the body, for messages.

    Raises:
        RobotError: The body has several elements <inertial>, or the element contradicts itself or has no mass.
    """
    given, where = body.findall("inertial"), f"the inertial of {name!r}"
    if not given:
        return None
    if len(given) > 1:
        raise RobotError(
            f"{settings.source}: the body {name!r} has {len(given)} elements <inertial>.",
            possible="one <inertial> in each body",
            remedy="keep one of them.",
        )
    (inertial,) = given
    kept = settings.checked(inertial, INERTIAL, where)
    if "mass" not in kept:
        raise RobotError(f"{settings.source}: {where} has no mass.", remedy="add the attribute mass [kg].")
    others = [key for key in ("diaginertia", *ORIENTATIONS) if key in inertial.attrib]
    if "fullinertia" in kept and others:
        raise RobotError(
            f"{settings.source}: {where} has fullinertia, which is given in the axes of the body, and also "
            f"{' and '.join(others)}.",
            possible="fullinertia alone, or diaginertia with an orientation",
            remedy="remove one of the two forms; MuJoCo reads no such <inertial>.",
        )
    return ET.Element("inertial", {**kept, **settings.pose(inertial, where)})


def stated_inertia(inertial: ET.Element) -> Array:
    """Ten inertial parameters (10,) in the frame of the body, from an element <inertial> in plain form."""

    def given(key: str) -> list[float]:
        return [float(word) for word in inertial.get(key, "").split()]

    (mass,) = given("mass")
    about_com = np.diag(given("diaginertia") or [0.0] * 3)
    if "fullinertia" in inertial.attrib:
        xx, yy, zz, xy, xz, yz = given("fullinertia")
        about_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    pose = placement_of(inertial)
    turned = pose[:3, :3] @ about_com @ pose[:3, :3].T
    return com_inertia_to_vector(mass, pose[:3, 3], turned)


def inertial_of(vector: Array) -> ET.Element:
    """Element <inertial> for ten inertial parameters (10,) in the frame of the body, in full precision."""
    mass, com, inertia = vector_to_com_inertia(vector)
    texts = {"mass": [mass], "pos": com, "fullinertia": [inertia[i, j] for i, j in FULL]}
    return ET.Element("inertial", {key: " ".join(repr(float(x)) for x in xs) for key, xs in texts.items()})
