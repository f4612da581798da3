"""Joints of an MJCF, and its equality constraints, which couple joints or close loops."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping

from armid.errors import Finding, RobotError
from armid.robot.described_limits import DescribedLimits
from armid.robot.joint_selection import Follows, JointOutline, SelectedJoint
from armid.robot.mjcf.settings import Settings
from armid.robot.xml import numbers

COUPLINGS = ("flex", "flexvert", "flexstrain")
LOOPS = ("connect", "weld")
IDENTITY = (0.0, 1.0, 0.0, 0.0, 0.0)
"""Default coefficients of the polynomial of an equality of joints, lowest power first."""


def joints_of(body: ET.Element) -> list[ET.Element]:
    """Joints of one body."""
    return [element for element in body if element.tag in ("joint", "freejoint")]


def joint_names(root: ET.Element) -> list[str]:
    """Names of all joints of a document whose includes are resolved."""
    bodies = (body for worldbody in root.findall("worldbody") for body in worldbody.iter("body"))
    return [joint.get("name", "") for body in bodies for joint in joints_of(body)]


def outline_of(
    root: ET.Element, settings: Settings, limits: Mapping[str, DescribedLimits], references: Mapping[str, float]
) -> JointOutline:
    """All joints of a document whose includes are resolved, and the joint that moves each body and site.

    Args:
        root: The document.
        settings: Settings of the document.
        limits: Limits of the joints with one degree of freedom.
        references: Reference positions of these joints [rad or m].
    """
    follows = _follows(root, settings, references)
    joints: list[SelectedJoint] = []
    frames: dict[str, int] = {}

    def walk(body: ET.Element, parent: int) -> None:
        for joint in joints_of(body):
            name = joint.get("name", "")
            limit = limits.get(name, DescribedLimits())
            joints.append(SelectedJoint(name, parent, name in limits, limit.lower, limit.upper, follows.get(name)))
            parent = len(joints) - 1
        frames[body.get("name", "")] = parent
        frames.update({site.get("name", ""): parent for site in body.findall("site") if site.get("name")})
        for child in body.findall("body"):
            walk(child, parent)

    for worldbody in root.findall("worldbody"):
        for body in worldbody.findall("body"):
            walk(body, -1)
    return JointOutline(tuple(joints), frames)


def _follows(root: ET.Element, settings: Settings, references: Mapping[str, float]) -> dict[str, Follows]:
    """Laws of mimic joints, by joint, from the equality constraints of a document.

    An equality states that q - ref of a joint, with its reference position ref, is constant, or that it is a
    polynomial in q - ref of another joint.
    """
    result: dict[str, Follows] = {}
    for tie in _active(root, settings):
        follower = tie.get("joint1", "")
        if tie.tag != "joint" or follower in result:
            continue
        where = f"the equality of joint {follower!r}"
        given = tie.get("polycoef", "").split()
        factors = [*(numbers(tie, "polycoef", len(given), settings.source, where) or ()), *IDENTITY[len(given) :]]
        leader, shift = tie.get("joint2", ""), references.get(follower, 0.0)
        kept = _shifted(factors, references.get(leader, 0.0)) if leader else factors[:1]
        result[follower] = Follows(leader, (kept[0] + shift, *kept[1:]))
    return result


def _shifted(factors: list[float], by: float) -> list[float]:
    """Coefficients of a polynomial in x that is given by its coefficients in powers of x - by."""
    degree = range(len(factors))
    return [sum(factors[k] * math.comb(k, i) * (-by) ** (k - i) for k in degree if k >= i) for i in degree]


def _active(root: ET.Element, settings: Settings) -> list[ET.Element]:
    """Equality constraints of a document that are not disabled, with the attributes of their default classes."""
    ties = (tie for section in root.findall("equality") for tie in section)
    full = (settings.resolved(tie, "main", "equality") for tie in ties)
    return [tie for tie in full if tie.get("active") != "false"]


def check_equalities(root: ET.Element, settings: Settings, locked: Collection[str]) -> list[Finding]:
    """Raises an error if an equality closes a loop or couples joints, and these joints are not locked.

    Returns:
        Findings about equalities that are ignored.

    Raises:
        RobotError: An equality closes a loop or couples joints that are not locked.
    """
    found: list[Finding] = []
    source = settings.source
    above = _joints_above(root)
    dragged = {body.get("name", "") for body in root.iter("body") if body.get("mocap") == "true"}
    for tie in _active(root, settings):
        follower = tie.get("joint1")
        if tie.tag in COUPLINGS:
            raise RobotError(
                f"{source} has an equality of kind {tie.tag!r}, which couples joints; armid cannot model it.",
                possible="open chains and trees",
                remedy='remove the equality, or give it active="false".',
            )
        tied = _tied(root, tie, above)
        moving = sorted(tied - set(locked))
        # A body that is tied to a mocap body is moved by a simulation, and is not part of the arm.
        if tie.tag in LOOPS and dragged & set(_ends(tie)):
            what = f"the equality {tie.tag} to a mocap body, with which a simulation moves the arm, is ignored"
            found.append(Finding("mocap-ignored", "info", " - ".join(_ends(tie)), what))
        elif tie.tag in (*LOOPS, "tendon") and moving:
            what = "closes a loop over" if tie.tag in LOOPS else "couples"
            raise RobotError(
                f"{source} has an equality of kind {tie.tag!r}, which {what} {', '.join(moving)}.",
                possible="open chains and trees",
                remedy="lock these joints (--lock), or select an arm that does not contain them (--tip LINK, --only "
                "PATTERN).",
            )
        if tie.tag == "joint" and follower not in locked:
            raise RobotError(
                f"{source}: joint {follower!r} is a mimic joint: an equality couples it to {tie.get('joint2')!r}.",
                remedy=f"lock {follower!r} with --lock, or remove the equality.",
            )
    return found


def _tied(root: ET.Element, tie: ET.Element, above: Mapping[str, set[str]]) -> set[str]:
    """Joints that are coupled by an equality of bodies, sites or tendons."""
    if tie.tag in LOOPS:
        one, other = (above.get(end, set[str]()) for end in _ends(tie))
        return one ^ other
    names = {tie.get("tendon1"), tie.get("tendon2")}
    tendons = [each for section in root.findall("tendon") for each in section if each.get("name") in names]
    joints = {joint.get("joint", "") for tendon in tendons for joint in tendon.iter("joint")}
    sites = {site.get("site", "") for tendon in tendons for site in tendon.iter("site")}
    return joints.union(*(above.get(site, set[str]()) for site in sites))


def _ends(tie: ET.Element) -> tuple[str, str]:
    """Names of the two bodies or sites that an equality connects; an empty name stands for the world."""
    one, other = ("body1", "body2") if "body1" in tie.attrib else ("site1", "site2")
    return tie.get(one, ""), tie.get(other, "")


def _joints_above(root: ET.Element) -> dict[str, set[str]]:
    """Names of the joints between the world and each body or site, by its name."""
    found: dict[str, set[str]] = {}

    def walk(body: ET.Element, carried: set[str]) -> None:
        own = carried | {joint.get("name", "") for joint in joints_of(body)}
        found[body.get("name", "")] = own
        found.update({site.get("name", ""): own for site in body.findall("site")})
        for child in body.findall("body"):
            walk(child, own)

    for worldbody in root.findall("worldbody"):
        for body in worldbody.findall("body"):
            walk(body, set())
    return found
