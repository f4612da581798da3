"""Rotor inertia and friction of a joint that a description contains."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass

from armid.robot.xml import numbers


@dataclass(frozen=True, slots=True)
class DescribedDrive:
    """Rotor inertia and friction of a joint in the description; zero if it contains none.

    Attributes:
        rotor_inertia: Inertia of rotor and transmission, referred to the joint [kg·m² or kg].
        viscous: Friction per velocity [N·m·s/rad or N·s/m].
        coulomb: Friction of constant size against the motion [N·m or N].
    """

    rotor_inertia: float = 0.0
    viscous: float = 0.0
    coulomb: float = 0.0


def drive_of(element: ET.Element, keys: Mapping[str, str], source: str, where: str) -> DescribedDrive:
    """Rotor inertia and friction in the attributes of an element.

    Negative values are physically impossible and are replaced by zero. If an attribute has several values, as MuJoCo
    allows for nonlinear damping, the first one is used.

    Args:
        element: The element.
        keys: Name of the attribute for each field of `DescribedDrive`.
        source: Path of the description, for messages.
        where: Name of the element, for messages.

    Raises:
        RobotError: An attribute is not a finite number.
    """
    found: dict[str, float] = {}
    for name, key in keys.items():
        values = numbers(element, key, max(1, len(element.get(key, "").split())), source, where)
        found[name] = max(0.0, values[0]) if values else 0.0
    return DescribedDrive(**found)
