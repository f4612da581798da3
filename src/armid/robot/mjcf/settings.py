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

ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")
"""Attributes that state an orientation; an element has at most one of them."""

ACTUATORS = (
    "general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion"
)  # fmt: skip
"""Elements of the section <actuator>; in a default class, all of them set the same defaults."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Compiler settings and default classes of one MJCF.

    Attributes:
        source: Path of the document, for messages.
        compiler: Attributes of the compiler.
        defaults: Default classes by name; for each class, the attributes by tag. The tag is `actuator` for all kinds
            of actuators, and `equality` for all kinds of equality constraints.
    """

    source: str
    compiler: dict[str, str] = field(default_factory=dict[str, str])
    defaults: dict[str, dict[str, dict[str, str]]] = field(default_factory=dict[str, dict[str, dict[str, str]]])

    def resolved(self, element: ET.Element, childclass: str, kind: str = "") -> ET.Element:
        """Element with the attributes of its default class added.

        An orientation of the element replaces that of the class, in whatever form either is given.

        Args:
            element: The element.
            childclass: Default class of elements without the name of a class.
            kind: Tag under which the class has the attributes; empty for the tag of the element.

        Raises:
            RobotError: The default class of the element does not exist.
        """
        attributes = _merged(self._inherited(element, childclass, kind or element.tag), element.attrib)
        attributes.pop("class", None)
        return ET.Element(element.tag, attributes)

    def is_disputed(self, element: ET.Element, childclass: str) -> bool:
        """Tests whether an element states a quaternion, and its default class another form of orientation.

        The quaternion counts in MuJoCo 4, the orientation of the class in MuJoCo 3.
        """
        inherited = self._inherited(element, childclass, element.tag)
        return "quat" in element.attrib and any(key in inherited for key in ORIENTATIONS[1:])

    def _inherited(self, element: ET.Element, childclass: str, kind: str) -> dict[str, str]:
        """Attributes that an element has from its default class."""
        name = element.get("class", childclass)
        if name not in self.defaults:
            raise RobotError(
                f"{self.source} has no default class {name!r}, which an element uses.",
                possible=", ".join(self.defaults),
                remedy="correct the name of the class.",
            )
        return self.defaults[name].get(kind, {})

    def pose(self, element: ET.Element, where: str) -> dict[str, str]:
        """Attributes of the pose of an element; Euler angles and an angle about an axis are written as two axes."""
        given = [key for key in ORIENTATIONS if key in element.attrib]
        if len(given) > 1:
            raise RobotError(
                f"{self.source}: {where} has several orientations: {', '.join(given)}.",
                remedy="give only one of them.",
            )
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
        RobotError: The setting of the sequence of Euler angles is invalid, poses are global, or a default class is
            defined twice.
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
    if settings.compiler.get("coordinate") == "global":
        raise RobotError(
            f'{source}: the compiler setting coordinate="global" gives all poses in the frame of the world.',
            possible='poses relative to the parent body (coordinate="local", the only form since MuJoCo 2.3.4)',
            remedy="load the file in MuJoCo 2.3.3 or older, save it, and give the saved file.",
        )
    settings.defaults["main"] = {}
    for section in root.findall("default"):
        # Sections at the top, for instance of included files, are one class. MuJoCo 3 and 4 call it main.
        settings.defaults["main"] = _with_own(settings.defaults["main"], section)
        settings.defaults[section.get("class", "main")] = settings.defaults["main"]
        _add_inner(settings, section, settings.defaults["main"], "main")
    return settings


def _add_inner(settings: Settings, section: ET.Element, own: dict[str, dict[str, str]], around: str) -> None:
    """Adds the classes inside a default class with the attributes `own`; unnamed ones get the name of that class."""
    for inner in section.findall("default"):
        name = inner.get("class", around)
        if name in settings.defaults and "class" in inner.attrib:
            raise RobotError(
                f"{settings.source} defines the default class {name!r} twice.",
                remedy="merge the two definitions into one, or give them different names.",
            )
        settings.defaults[name] = _with_own(own, inner)
        _add_inner(settings, inner, settings.defaults[name], name)


def _with_own(inherited: Mapping[str, dict[str, str]], section: ET.Element) -> dict[str, dict[str, str]]:
    """Attributes by tag of a default class: the inherited ones with those that the section itself states."""
    own = dict(inherited)
    for element in section:
        if element.tag != "default":
            tag = "actuator" if element.tag in ACTUATORS else element.tag
            own[tag] = _merged(own.get(tag, {}), element.attrib)
    return own


def _merged(inherited: Mapping[str, str], own: Mapping[str, str]) -> dict[str, str]:
    """Inherited attributes, with an element's own attributes in place of inherited ones of the same name.

    An own orientation replaces each form of orientation. An own size with fewer numbers replaces the first ones.
    """
    turned = any(key in own for key in ORIENTATIONS)
    kept = {key: value for key, value in inherited.items() if not (turned and key in ORIENTATIONS)}
    merged = {**kept, **own}
    if "size" in own:
        sizes = own["size"].split()
        merged["size"] = " ".join([*sizes, *inherited.get("size", "").split()[len(sizes) :]])
    return merged


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
