"""Compiler settings and default classes of an MJCF, and the poses that depend on them."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from armid.checked_array import Array
from armid.errors import RobotError
from armid.maths.rotations import axis_rotation, rotation_x, rotation_y, rotation_z
from armid.robot.xml import numbers

POSE = {"pos": 3, "quat": 4, "xyaxes": 6, "zaxis": 3}
"""Attributes of a pose in plain form, with their numbers of values."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Compiler settings and default classes of one MJCF.

    Attributes:
        source: Path of the document, for messages.
        compiler: Attributes of the compiler.
        defaults: Default classes by name; for each class, the attributes by tag.
    """

    source: str
    compiler: dict[str, str] = field(default_factory=dict[str, str])
    defaults: dict[str, dict[str, dict[str, str]]] = field(default_factory=dict[str, dict[str, dict[str, str]]])

    def resolved(self, element: ET.Element, childclass: str) -> ET.Element:
        """Element with the attributes of its default class added.

        Args:
            element: The element.
            childclass: Default class of elements without the name of a class.

        Raises:
            RobotError: The default class of the element does not exist.
        """
        name = element.get("class", childclass)
        if name not in self.defaults:
            raise RobotError(
                f"{self.source} has no default class {name!r}, which an element uses.",
                possible=", ".join(self.defaults),
                remedy="correct the name of the class.",
            )
        attributes = {**self.defaults[name].get(element.tag, {}), **element.attrib}
        attributes.pop("class", None)
        return ET.Element(element.tag, attributes)

    def pose(self, element: ET.Element, where: str) -> dict[str, str]:
        """Attributes of the pose of an element; Euler angles and an angle about an axis are written as two axes."""
        pose = self.checked(element, POSE, where)
        euler = numbers(element, "euler", 3, self.source, where)
        axisangle = numbers(element, "axisangle", 4, self.source, where)
        if euler is not None:
            pose["xyaxes"] = _axes(_euler_rotation(self.radians(euler), self.compiler.get("eulerseq", "xyz")))
        elif axisangle is not None:
            axis = np.array(axisangle[:3])
            pose["xyaxes"] = _axes(
                axis_rotation(axis / (np.linalg.norm(axis) or 1.0), self.radians(axisangle[3:])[0])
            )
        return pose

    def checked(self, element: ET.Element, counts: Mapping[str, int], where: str) -> dict[str, str]:
        """Those attributes in `counts` that an element has, after a check of their numbers of values."""
        there = [key for key, n in counts.items() if numbers(element, key, n, self.source, where) is not None]
        return {key: element.get(key, "") for key in there}

    def radians(self, angles: list[float]) -> list[float]:
        """Converts angles from the unit of the document to radians."""
        return angles if self.compiler.get("angle", "degree") == "radian" else [math.radians(a) for a in angles]


def settings_of(root: ET.Element, source: str) -> Settings:
    """Settings of a document whose includes are resolved.

    Raises:
        RobotError: The setting of the sequence of Euler angles is invalid.
    """
    settings = Settings(source)
    for compiler in root.findall("compiler"):
        settings.compiler.update(compiler.attrib)
    sequence = settings.compiler.get("eulerseq", "xyz")
    if len(sequence) != 3 or set(sequence.lower()) - set("xyz"):
        raise RobotError(
            f"{source}: the compiler setting eulerseq has the invalid value {sequence!r}.",
            possible="three letters, each x, y, z, X, Y or Z",
            remedy="correct the setting.",
        )
    settings.defaults["main"] = {}
    for section in root.findall("default"):
        _add_defaults(settings, section, {}, "main")
    return settings


def _add_defaults(
    settings: Settings, section: ET.Element, inherited: dict[str, dict[str, str]], fallback: str
) -> None:
    """Adds a default class and the classes inside it; unnamed classes get the name of the class around them."""
    own = {tag: dict(values) for tag, values in inherited.items()}
    for element in section:
        if element.tag != "default":
            own[element.tag] = {**own.get(element.tag, {}), **element.attrib}
    settings.defaults[section.get("class", fallback)] = own
    for inner in section.findall("default"):
        _add_defaults(settings, inner, own, fallback)


def _euler_rotation(angles: list[float], sequence: str) -> Array:
    """Rotation by Euler angles [rad]; lower-case letters stand for body axes, upper-case ones for fixed axes."""
    rotation = np.eye(3)
    about = {"x": rotation_x, "y": rotation_y, "z": rotation_z}
    for letter, angle in zip(sequence, angles, strict=True):
        step = about[letter.lower()](angle)
        rotation = rotation @ step if letter.islower() else step @ rotation
    return rotation


def _axes(rotation: Array) -> str:
    """First and second column of a rotation, as text in full precision."""
    return " ".join(repr(float(x)) for x in rotation[:, :2].T.ravel())
