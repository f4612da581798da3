"""Position servos of an MJCF: actuators whose force is a gain times the position error of one joint."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace

from armid.robot.described_drive import DescribedDrive, DescribedServo
from armid.robot.mjcf.force_limits import range_in_effect
from armid.robot.mjcf.settings import ACTUATORS, Settings
from armid.robot.xml import numbers

USUAL_STIFFNESS = 1.0
"""Gain `kp` of a position actuator that states none, as in MuJoCo."""


def position_servos(root: ET.Element, settings: Settings) -> Iterator[tuple[str, DescribedServo]]:
    """Yields names of joints and their position servos.

    These are actuators `position`, and `general` with a fixed gain kp and the affine bias -kp q - kv q̇. The gear must
    be 1. Damping that is stated by a ratio depends on the mass matrix in MuJoCo; the ratio is kept, and the damping
    is zero.
    """
    elements = [a for section in root.findall("actuator") for a in section if a.tag in ACTUATORS]
    number = Counter(settings.resolved(each, "main", "actuator").get("joint", "") for each in elements)
    for element in elements:
        actuator = settings.resolved(element, "main", "actuator")
        name, source = actuator.get("joint", ""), settings.source
        where = f"the actuator of {name!r}"
        actuator.set("gear", (actuator.get("gear") or "1").split()[0])
        if not name or (numbers(actuator, "gear", 1, source, where) or [1.0])[0] != 1.0:
            continue
        if actuator.tag == "position":
            stiffness = (numbers(actuator, "kp", 1, source, where) or [USUAL_STIFFNESS])[0]
            damping, offset = (numbers(actuator, "kv", 1, source, where) or [0.0])[0], 0.0
        elif actuator.tag == "general" and actuator.get("biastype") == "affine":
            gain = [float(x) for x in (actuator.get("gainprm") or "1").split()]
            bias = [*(float(x) for x in (actuator.get("biasprm") or "0").split()), 0.0, 0.0, 0.0]
            if actuator.get("gaintype", "fixed") != "fixed" or bias[1] != -gain[0]:
                continue
            stiffness, damping, offset = gain[0], -bias[2], -bias[0] / gain[0] if gain[0] else 0.0
        else:
            continue
        ratio = 0.0
        if actuator.tag == "position" and damping == 0.0:
            ratio = (numbers(actuator, "dampratio", 1, source, where) or [0.0])[0]
        ends = range_in_effect(actuator, "ctrlrange", settings, where, [])
        bounds = None if ends is None else (ends[0], ends[1])
        if stiffness > 0.0 and damping >= 0.0:
            yield name, DescribedServo(stiffness, damping, offset, max(ratio, 0.0), bounds, number[name])


def with_position_servos(
    drives: Mapping[str, DescribedDrive], root: ET.Element, settings: Settings
) -> dict[str, DescribedDrive]:
    """Drives of the joints, with the position servos of the document."""
    servos: dict[str, DescribedServo] = {}
    for name, servo in position_servos(root, settings):
        servos.setdefault(name, servo)
    return {name: replace(drive, servo=servos.get(name)) for name, drive in drives.items()}
