"""Reader of URDF; meshes are not opened. Fixed joints are merged into the link that carries them."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from armid.errors import Finding, RobotError, did_you_mean
from armid.robot.body_tree import robot_from_tree
from armid.robot.collision_from_visual import with_bodies
from armid.robot.described_drive import DescribedDrive, drive_of, negative_drive
from armid.robot.described_limits import DescribedLimits, limits_of
from armid.robot.joint_selection import Follows, JointOutline, SelectedJoint
from armid.robot.missing_inertia import impossible_inertias
from armid.robot.robot import Robot
from armid.robot.urdf.shapes import shapes_of_urdf
from armid.robot.urdf.tree import axis_of, moving_inertias, tree_of_urdf
from armid.robot.xml import (
    XACRO,
    check_locked,
    floating,
    identity_only,
    numbers,
    parse_xml,
    root_tag,
    without_namespace,
)

ONE_DEGREE = ("revolute", "continuous", "prismatic")
REFUSED = ("floating", "planar", "spherical", "ball")


def recognises(text: str) -> bool:
    """Tests whether a text looks like a URDF."""
    return root_tag(text) == "robot"


def read(text: str, *, source: str, locked: Mapping[str, float], tip: str | None) -> Robot:
    """Reads the robot of a URDF text.

    Args:
        text: The URDF text.
        source: Path of the text.
        locked: Joints to be locked, with positions [rad or m]. Joints with more than one degree of freedom are made
            fixed here; the others are still joints of the result.
        tip: Name of the link that is the flange; if `None`, it is searched (see `find_tip`).

    Raises:
        RobotError: The text is not a URDF, or not a tree of joints with one degree of freedom.
    """
    root = _root(text, source)
    named = "".join(element.get("name", "") for element in (root, *root.findall("link"), *root.findall("joint")))
    if any("ros.org/wiki/xacro" in element.tag for element in root.iter()) or any(sign in named for sign in XACRO):
        raise RobotError(
            f"{source} contains xacro that is not expanded.",
            remedy="give the file the suffix .xacro, or expand it with xacro.",
        )
    moving = [joint.get("name", "") for joint in _joints(root) if joint.get("type") != "fixed"]
    check_locked(locked, moving, source)
    limits: dict[str, DescribedLimits] = {}
    findings: list[Finding] = []
    drives = {joint.get("name", ""): _drive(joint, source) for joint in _joints(root)}
    for joint in _joints(root):
        limits[joint.get("name", "")], found = _prepare(joint, locked, source)
        findings.extend(found)
    tree = tree_of_urdf(root, source)
    findings += impossible_inertias(moving_inertias(root, tree, locked, source))
    findings += _unused_inertials(root)
    robot = robot_from_tree(
        tree,
        name=root.get("name") or Path(source).stem,
        limits=limits,
        source=source,
        locked=locked,
        tip=tip,
        drives=drives,
        findings=tuple(findings),
    )
    shapes, missing = shapes_of_urdf(root, robot, locked, source)
    visuals, left_out = shapes_of_urdf(root, robot, locked, source, "visual")
    robot = replace(robot, shapes=shapes, visuals=visuals, findings=(*robot.findings, *missing, *left_out))
    drawn = [link.get("name", "") for link in root.iter("link") if link.findall("*/geometry/*")]
    return with_bodies(robot, described=drawn)


def outline(text: str, *, source: str) -> JointOutline:
    """Joints of a URDF text that are not fixed, and the joint that moves each link.

    Raises:
        RobotError: The text is not a URDF, or limits are not numbers.
    """
    root = _root(text, source)
    moving = [joint for joint in _joints(root) if joint.get("type") != "fixed"]
    index = {joint.get("name", ""): k for k, joint in enumerate(moving)}
    above = {_link_of(joint, "child"): joint for joint in _joints(root)}

    def mover(link: str) -> int:
        passed = set[str]()
        while link in above and link not in passed:
            passed.add(link)
            joint = above[link]
            if joint.get("type") != "fixed":
                return index[joint.get("name", "")]
            link = _link_of(joint, "parent")
        return -1

    frames = {link.get("name", ""): mover(link.get("name", "")) for link in root.findall("link")}
    fixed = {joint.get("name", ""): mover(_link_of(joint, "child")) for joint in _joints(root)}
    named = tuple(_named(joint, mover(_link_of(joint, "parent")), source) for joint in moving)
    return JointOutline(named, {**{name: k for name, k in fixed.items() if name not in index}, **frames})


def _root(text: str, source: str) -> ET.Element:
    """Root element of a URDF."""
    root = without_namespace(parse_xml(text, source))
    if root.tag != "robot":
        raise RobotError(
            f"{source} is not a URDF: its root is <{root.tag}>, not <robot>.",
            remedy="this is a part of a xacro file: give the file that includes it."
            if root.tag.endswith("include")
            else "give a robot description, or give the file the suffix of its format.",
        )
    return root


def _link_of(joint: ET.Element, role: str) -> str:
    """Name of the `parent` or `child` link of a joint."""
    element = joint.find(role)
    return "" if element is None else element.get("link", "")


def _named(joint: ET.Element, parent: int, source: str) -> SelectedJoint:
    """Converts a joint that is not fixed to a `SelectedJoint`; a mimic joint has the law of its position."""
    name, kind = joint.get("name", ""), joint.get("type", "")
    limit, mimic = joint.find("limit"), joint.find("mimic")
    follows = None
    if mimic is not None:
        where = f"the mimic of joint {name!r}"
        factors = [(numbers(mimic, key, 1, source, where) or [usual])[0] for key, usual in MIMIC.items()]
        follows = Follows(mimic.get("joint", ""), tuple(factors))
    lower, upper = -math.inf, math.inf
    if limit is not None and kind != "continuous":
        where = f"the limit of joint {name!r}"
        lower, upper = ((numbers(limit, key, 1, source, where) or [0.0])[0] for key in ("lower", "upper"))
    if lower == upper:
        lower, upper = -math.inf, math.inf  # a placeholder
    return SelectedJoint(name, parent, kind in ONE_DEGREE, lower, upper, follows)


MIMIC = {"offset": 0.0, "multiplier": 1.0}
"""Attributes of <mimic> and their default values: the coefficients of a polynomial in the position of the other
joint, lowest power first."""


def _joints(root: ET.Element) -> list[ET.Element]:
    """Elements <joint> of the robot, without those inside transmissions."""
    return root.findall("joint")


def _prepare(
    joint: ET.Element, locked: Mapping[str, float], source: str
) -> tuple[DescribedLimits, tuple[Finding, ...]]:
    """Checks a joint and returns its limits and findings.

    A locked joint with several degrees of freedom becomes a fixed joint.
    """
    name, kind = joint.get("name", ""), joint.get("type", "")
    if kind in REFUSED and name in locked:
        identity_only(name, kind, locked[name])
        kind = "fixed"
        joint.set("type", kind)
    if kind == "fixed":
        return DescribedLimits(), ()
    if kind not in ONE_DEGREE and kind not in REFUSED:
        known = (*ONE_DEGREE, "fixed", *REFUSED[:2])
        raise RobotError(
            f"{source}: joint {name!r} has the unknown type {kind!r}.",
            possible=", ".join(known),
            remedy=did_you_mean(kind.lower(), known) or "correct the attribute type of the joint.",
        )
    if kind not in ONE_DEGREE:
        raise floating(source, name, kind, ", ".join((*ONE_DEGREE, "fixed")))
    _check_mimic(joint, locked, source)
    if not axis_of(joint, source).any():
        raise RobotError(
            f"{source}: joint {name!r} has an axis of zero length.",
            remedy="give the direction of the axis in the attribute xyz of <axis>.",
        )
    limits, unknown = _read_limit(joint, kind, source)
    limits, unused = _with_soft_limits(joint, kind, limits, source)
    dynamics = joint.find("dynamics")
    negative = () if dynamics is None else negative_drive(name, dynamics, DRIVE)
    return limits, (*unknown, *(() if unused is None else (unused,)), *negative)


def _drive(joint: ET.Element, source: str) -> DescribedDrive:
    """Friction of a joint from its tag <dynamics>; zero without this tag."""
    dynamics = joint.find("dynamics")
    if dynamics is None:
        return DescribedDrive()
    return drive_of(dynamics, DRIVE, source, f"the dynamics of joint {joint.get('name', '')!r}")


def _check_mimic(joint: ET.Element, locked: Mapping[str, float], source: str) -> None:
    """Raises an error for a mimic joint that is not locked."""
    name, mimic = joint.get("name", ""), joint.find("mimic")
    if mimic is not None and name not in locked:
        leader = mimic.get("joint")
        raise RobotError(
            f"{source}: {name!r} is a mimic joint: its position depends on that of {leader!r}.",
            remedy=f"lock {name!r} (and also {leader!r} if it does not move), or remove <mimic>.",
        )


def _unused_inertials(root: ET.Element) -> list[Finding]:
    """Findings about links with several tags <inertial>, of which parsers of URDF read the first."""
    several = [(link.get("name", ""), len(link.findall("inertial"))) for link in root.findall("link")]
    remedy = "keep the one that is right"
    return [
        Finding(
            "description-ignored", "warning", name, f"the link has {n} tags <inertial>; only the first counts", remedy
        )
        for name, n in several
        if n > 1
    ]


def _read_limit(joint: ET.Element, kind: str, source: str) -> tuple[DescribedLimits, tuple[Finding, ...]]:
    """Limits of a joint from its tag <limit>, and findings about limits that are missing or placeholders."""
    name, limit = joint.get("name", ""), joint.find("limit")
    where = f"the limit of joint {name!r}"
    values = {key: numbers(limit, key, 1, source, where) if limit is not None else None for key in LIMIT_KEYS}
    lower, upper, velocity, effort = ((values[key] or [0.0])[0] for key in LIMIT_KEYS)
    stated = values["lower"] is not None or values["upper"] is not None
    absent = "upper" if values["upper"] is None else "lower" if values["lower"] is None else ""
    if lower > upper and absent and kind != "continuous":
        given = f"lower={lower:g}" if absent == "upper" else f"upper={upper:g}"
        raise RobotError(
            f"{source}: {where} has {given} and no {absent}, so {absent} is 0 by default, and the lower limit is "
            "above the upper one.",
            remedy=f"add the attribute {absent}; for a joint without limits, write the type continuous.",
        )
    limits, unknown = limits_of(
        name,
        position=(lower, upper) if stated and kind != "continuous" else None,
        velocity=velocity,
        effort=effort,
        turns=kind != "prismatic",
    )
    findings = () if unknown is None else (unknown,)
    if kind == "continuous" or stated:
        return limits, findings
    what = f"the {kind} joint has no position limits ({'no tag <limit>' if limit is None else 'no lower and upper'}"
    what += " in the description); it is treated as unlimited"
    remedy = "write the real limits of the joint into the description if they are needed"
    return limits, (Finding("limits-unknown", "info", name, what, remedy), *findings)


def _with_soft_limits(
    joint: ET.Element, kind: str, limits: DescribedLimits, source: str
) -> tuple[DescribedLimits, Finding | None]:
    """Limits of a joint with the soft limits of its tag <safety_controller>.

    Soft limits are used only if both are given and their range overlaps with that of the position limits; otherwise a
    finding reports the soft limits that do not overlap. A continuous joint has no soft limits.
    """
    controller = joint.find("safety_controller")
    if controller is None:
        return limits, None
    name = joint.get("name", "")
    where = f"the safety_controller of joint {name!r}"
    low, high = (numbers(controller, key, 1, source, where) for key in SOFT_KEYS)
    if low is None or high is None or kind == "continuous":
        return limits, None
    (lower,), (upper,) = low, high
    if max(lower, limits.lower) < min(upper, limits.upper):
        return replace(limits, soft=(lower, upper)), None
    evidence = (
        f"the range {lower:g} to {upper:g} of the soft limits (safety_controller) does not overlap with the position "
        "limits, so the soft limits are not used"
    )
    remedy = "correct the soft limits in the description if the robot's controller uses soft limits"
    return limits, Finding("limits-unknown", "info", name, evidence, remedy)


SOFT_KEYS = ("soft_lower_limit", "soft_upper_limit")
"""Attributes of <safety_controller> with the positions at which a controller stops the joint."""

DRIVE = {"viscous": "damping", "coulomb": "friction"}
"""Attributes of <dynamics> for the values of `DescribedDrive`."""

LIMIT_KEYS = ("lower", "upper", "velocity", "effort")
