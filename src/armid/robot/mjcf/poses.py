"""Poses of geoms and sites in plain form: a position, and one of three forms of orientation."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from armid.checked_array import Array
from armid.maths.rotations import homogeneous
from armid.robot.shapes import rotation_with_z


def placement_of(element: ET.Element) -> Array:
    """Pose (4, 4) of a body, inertial, geom or site in the frame around it; NaN if its orientation is no rotation."""

    def given(key: str) -> Array:
        return np.array([float(x) for x in element.get(key, "").split()])

    position = given("pos") if "pos" in element.attrib else np.zeros(3)
    turned = np.eye(3)
    if "quat" in element.attrib:
        turned = rotation_of_quaternion(given("quat"))
    elif "xyaxes" in element.attrib:
        x, y = given("xyaxes").reshape(2, 3)
        with np.errstate(invalid="ignore"):
            x = x / np.linalg.norm(x)
            y = y - (y @ x) * x
            y = y / np.linalg.norm(y)
        turned = np.column_stack([x, y, np.cross(x, y)])
    elif "zaxis" in element.attrib:
        turned = rotation_with_z(given("zaxis"))
    return homogeneous(turned, position)


def rotation_of_quaternion(quaternion: Array) -> Array:
    """Rotation matrix (3, 3) of a quaternion (4,) of any length, real part first."""
    with np.errstate(invalid="ignore"):
        w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
