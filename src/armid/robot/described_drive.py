"""Rotor inertia and friction of a joint that a description contains."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass

from armid.errors import Finding
from armid.robot.xml import numbers


@dataclass(frozen=True, slots=True)
class DescribedServo:
    """Position servo of a joint in the description: torque K (c - q - b) - D q̇ for the command c.

    Attributes:
        stiffness: K [N·m/rad or N/m].
        damping: D [N·m·s/rad or N·s/m].
        offset: b [rad or m].
        damping_ratio: Ratio from which a simulator computes further damping, which is not part of `damping`.
        command_range: Lowest and highest command that has an effect [rad or m]; `None` without such a range.
        actuators: Number of actuators of the joint; only the first position servo is described here.
    """

    stiffness: float
    damping: float = 0.0
    offset: float = 0.0
    damping_ratio: float = 0.0
    command_range: tuple[float, float] | None = None
    actuators: int = 1


@dataclass(frozen=True, slots=True)
class DescribedDrive:
    """Rotor inertia, friction and servo of a joint in the description; zero if it contains none.

    Attributes:
        rotor_inertia: Inertia of rotor and transmission, referred to the joint [kg·m² or kg].
        viscous: Friction per velocity [N·m·s/rad or N·s/m].
        coulomb: Friction of constant size against the motion [N·m or N].
        servo: Position servo; `None` if the description has none.
    """

    rotor_inertia: float = 0.0
    viscous: float = 0.0
    coulomb: float = 0.0
    servo: DescribedServo | None = None


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
    return DescribedDrive(**found, servo=None)


def negative_drive(joint: str, element: ET.Element, keys: Mapping[str, str]) -> tuple[Finding, ...]:
    """Finding about negative friction or rotor inertia of a joint, which `drive_of` replaces by zero.

    Args:
        joint: Name of the joint.
        element: The element, which `drive_of` accepts.
        keys: Name of the attribute for each field of `DescribedDrive`.
    """
    given = {key: element.get(key, "").split() for key in keys.values()}
    wrong = [f'{key}="{values[0]}"' for key, values in given.items() if values and float(values[0]) < 0.0]
    if not wrong:
        return ()
    what = f"{', '.join(wrong)} of the joint is ignored, because no joint has negative friction or rotor inertia"
    return (Finding("description-ignored", "warning", joint, what, "correct the value in the description"),)
