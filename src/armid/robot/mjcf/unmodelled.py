"""Findings about parts of an MJCF that change masses or torques in MuJoCo, and that armid does not model."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence

from armid.errors import Finding
from armid.robot.mjcf.settings import Settings
from armid.robot.xml import numbers

SWITCHED = {"boundmass": 0.0, "boundinertia": 0.0, "settotalmass": 0.0}
"""Compiler settings that change masses and inertias if they exceed these values."""

LISTED = 5
"""Largest number of bodies or joints that one finding names."""


def changing_settings(compiler: Mapping[str, str], source: str) -> list[str]:
    """Names of the compiler settings in effect that change masses and inertias.

    Args:
        compiler: Compiler settings.
        source: Path of the document, for messages.

    Raises:
        RobotError: A setting is not a number.
    """
    element = ET.Element("compiler", dict(compiler))
    found = ["balanceinertia"] if element.get("balanceinertia") == "true" else []
    for key, usual in SWITCHED.items():
        value = numbers(element, key, 1, source, "the compiler")
        found += [key] * (value is not None and value[0] > usual)
    return found


def ignored_settings(settings: Settings) -> list[Finding]:
    """Finding about compiler settings in effect that change masses and inertias; empty without such settings."""
    ignored = changing_settings(settings.compiler, settings.source)
    if not ignored:
        return []
    return [
        _ignored(
            "",
            f"the compiler settings {', '.join(ignored)} are ignored, although they change masses or inertias",
            "write the changed masses and inertias into the bodies, and remove these settings",
        )
    ]


def ignored_parts(root: ET.Element, settings: Settings) -> list[Finding]:
    """Findings about gravity compensation, springs, and orientations that versions of MuJoCo read differently.

    Args:
        root: The document with includes resolved and names for all bodies and joints.
        settings: Settings of the document.
    """
    bodies = [each for world in root.findall("worldbody") for each in _bodies(world, "main")]
    lifted = [name for name, body, _ in bodies if any(numbers(body, "gravcomp", 1, settings.source, name) or ())]
    joints = [settings.resolved(joint, own) for _, body, own in bodies for joint in body.findall("joint")]
    sprung = [joint.get("name", "") for joint in joints if _has_spring(joint, settings)]
    disputed = [
        name
        for name, body, own in bodies
        if any(settings.is_disputed(each, own) for each in (*body.findall("geom"), *body.findall("site")))
    ]
    found: list[Finding] = []
    if lifted:
        what = f"gravcomp of the bodies {_listed(lifted)}, a force against their weight in simulations, is ignored"
        remedy = "remove gravcomp before torques of a simulation are compared with those of the model"
        found.append(_ignored(", ".join(lifted), what, remedy))
    if sprung:
        what = (
            f"the springs of the joints {_listed(sprung)} (stiffness with springref, or springdamper) are ignored; "
            "armid has no term for them"
        )
        remedy = "remove the springs if the real arm has none; otherwise subtract their torque from recorded torque"
        found.append(_ignored(", ".join(sprung), what, remedy))
    if disputed:
        what = (
            f"geoms or sites of the bodies {_listed(disputed)} have a quat, and their default class has another form "
            "of orientation; armid and MuJoCo 4 use the quat, MuJoCo 3 uses the class"
        )
        remedy = "remove the orientation from the default class"
        found.append(Finding("orientation-ambiguous", "warning", ", ".join(disputed), what, remedy))
    return found


def _bodies(element: ET.Element, childclass: str) -> Iterator[tuple[str, ET.Element, str]]:
    """Yields the name of each body inside an element, the body, and the default class of what it contains."""
    childclass = element.get("childclass", childclass)
    for body in element.findall("body"):
        yield body.get("name", ""), body, body.get("childclass", childclass)
        yield from _bodies(body, childclass)


def _has_spring(joint: ET.Element, settings: Settings) -> bool:
    """Tests whether a joint has a spring; springdamper makes one from a time constant and a damping ratio."""
    where = f"joint {joint.get('name', '')!r}"
    values = numbers(joint, "stiffness", max(1, len(joint.get("stiffness", "").split())), settings.source, where)
    made = numbers(joint, "springdamper", 2, settings.source, where)
    return any(values or ()) or (made is not None and min(made) > 0.0)


def _ignored(channel: str, evidence: str, remedy: str) -> Finding:
    return Finding("description-ignored", "warning", channel, evidence, remedy)


def _listed(names: Sequence[str]) -> str:
    """Text with the first names, and the number of the others."""
    return ", ".join(names[:LISTED]) + (f" and {len(names) - LISTED} more" if len(names) > LISTED else "")
