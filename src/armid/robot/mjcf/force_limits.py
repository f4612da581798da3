"""Ranges of an MJCF that are in effect, and the effort limits of joints that follow from their actuators."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator

from armid.errors import Finding
from armid.robot.mjcf.settings import ACTUATORS, Settings
from armid.robot.xml import numbers

LIMITED = {
    "range": "limited",
    "actuatorfrcrange": "actuatorfrclimited",
    "forcerange": "forcelimited",
    "ctrlrange": "ctrllimited",
}
"""Attribute that switches a range on or off, by the name of the attribute with the range."""


def range_in_effect(
    element: ET.Element, key: str, settings: Settings, where: str, findings: list[Finding]
) -> list[float] | None:
    """Range (lower and upper bound) of a joint or actuator; `None` if it has none, or if it is switched off.

    Args:
        element: Joint or actuator with the attributes of its default class.
        key: Attribute with the range, one of `LIMITED`.
        settings: Settings of the document.
        where: Name of the element, for messages.
        findings: List to which a finding is added if MuJoCo would refuse the range.
    """
    found = numbers(element, key, 2, settings.source, where)
    state = element.get(LIMITED[key], "auto")
    if found is None or state == "false":
        return None
    if state == "auto" and settings.compiler.get("autolimits") == "false":
        if any(found):
            what = (
                f"the {key} {found[0]:g} to {found[1]:g} of {where} is not used: autolimits is off and "
                f"{LIMITED[key]} is not given; MuJoCo refuses this"
            )
            joint = element.get("joint", element.get("name", ""))
            remedy = f'write {LIMITED[key]}="true" if the limit is real'
            findings.append(Finding("limits-unknown", "info", joint, what, remedy))
        return None
    return found


def actuator_efforts(root: ET.Element, settings: Settings, findings: list[Finding]) -> Iterator[tuple[str, float]]:
    """Yields names of joints and the effort limits [N·m or N] that follow from their actuators.

    The force of an actuator is limited by its forcerange. The control of a motor is its force; that of other
    actuators is not.

    Args:
        root: The document.
        settings: Settings of the document.
        findings: List to which findings about ranges are added that MuJoCo would refuse.
    """
    for element in (a for section in root.findall("actuator") for a in section if a.tag in ACTUATORS):
        actuator = settings.resolved(element, "main", "actuator")
        name = actuator.get("joint", "")
        where = f"the actuator of {name!r}"
        actuator.set("gear", (actuator.get("gear") or "1").split()[0])
        gear = numbers(actuator, "gear", 1, settings.source, where) or [1.0]
        keys = ("forcerange", "ctrlrange") if actuator.tag == "motor" else ("forcerange",)
        ranges = [r for k in keys if (r := range_in_effect(actuator, k, settings, where, findings))]
        if ranges:
            yield name, abs(gear[0]) * min(abs(bound) for each in ranges for bound in each)
