"""Writer of URDF: writes an `<inertial>` for each link, and damping and friction for each joint.

The format can store neither rotor inertia nor friction laws other than viscous and Coulomb friction. It requires
limits of effort and velocity for each joint with position limits, and a limit of zero would block the joint. A new
file is therefore refused if such a limit is unknown. In a description only the numbers that change are replaced. The
orientation of an `<inertial>` stays, and the inertia tensor is written in the axes of this orientation.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, OutputError
from armid.export.body_split import placed
from armid.export.other_programs import mujoco_witness, pinocchio_witness
from armid.export.types import (
    Body,
    Content,
    DescriptionSource,
    OpenedDescription,
    Witness,
    WrittenDescription,
    com_form,
    rpy_of,
    text_of,
    unique_names,
)
from armid.export.xml_edit import Document, XmlNode, element_text
from armid.maths.rotations import homogeneous, rpy_rotation
from armid.robot.readers import READERS
from armid.robot.readers import urdf as reader
from armid.robot.readers.xacro import expand
from armid.robot.robot import InertialParameters, Joint, Robot
from armid.robot.xml import without_namespace

SUFFIX: str = ".urdf"

ATTRIBUTES = {"viscous": "damping", "coulomb": "friction"}
PLACES: Sequence[str] = tuple(ATTRIBUTES)
TENSOR = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
LIMITS = ("effort", "velocity")


def open_description(path: Path, data: bytes) -> OpenedDescription | None:
    """Reads a URDF so that it can be edited; a xacro file is expanded to URDF.

    The result is `None` for other formats.
    """
    if path.suffix.lower() == ".xacro":
        what = "the description is a xacro file and was expanded; the written file is a URDF"
        text = expand(data.decode(), str(path)).encode()
        return OpenedDescription(text, (str(path),), (Finding("xacro-expanded", "info", "", what),))
    is_urdf = reader.recognises(data.decode()) and path.suffix.lower() in READERS["urdf"].suffixes
    return OpenedDescription(data, (str(path),)) if is_urdf else None


def bodies(source: DescriptionSource, raw: Robot, robot: Robot) -> list[Body]:
    """Links of a URDF that move; parents come before their children."""
    root = without_namespace(ET.fromstring(source.data))
    links = {link.get("name", ""): link for link in root.findall("link")}
    below: dict[str, list[ET.Element]] = {}
    for joint in root.findall("joint"):
        below.setdefault(_named(joint, "parent"), []).append(joint)
    children = {_named(joint, "child") for joints in below.values() for joint in joints}
    found: list[Body] = []
    waiting = [(name, -1, np.eye(4)) for name in links if name not in children]
    while waiting:
        name, moved_by, pose = waiting.pop(0)
        if moved_by >= 0:
            link, placement, welded = placed(raw, source.locked, robot, moved_by, pose)
            if link >= 0:
                found.append(Body(name, link, placement, _nominal(links[name]), welded))
        for joint in below.get(name, []):
            name_of_joint = joint.get("name", "")
            if name_of_joint in raw.joint_names:
                waiting.append((_named(joint, "child"), raw.joint_index(name_of_joint), np.eye(4)))
            else:  # fixed, or locked with several degrees of freedom
                waiting.append((_named(joint, "child"), moved_by, pose @ _pose(joint.find("origin"))))
    return found


def write(content: Content) -> WrittenDescription:
    """Makes a URDF: the description with inertias and friction replaced, or a new one without shapes."""
    if content.source is None:
        return _fresh(content)
    document = Document(content.source.data)
    for link in document.root.every("link"):
        body = (content.bodies or {}).get(link.values.get("name", ""))
        if body is not None:
            _edit_inertial(document, link, body)
    for joint in document.root.every("joint"):
        values = content.joints.get(joint.values.get("name", ""), {})
        friction = {ATTRIBUTES[term]: text_of(x) for term, x in values.items() if term in ATTRIBUTES}
        if friction:
            _edit_dynamics(document, joint, friction)
    return WrittenDescription(document.edited(), _relative_meshes(document))


def missing_limits(robot: Robot) -> OutputError | None:
    """Error about joints with position limits but without limits of effort or velocity.

    The result is `None` if there is no such joint. The remedy is an option of `armid export`.
    """
    without = [joint for joint in robot.joints if _has_stops(joint) and _missing(joint)]
    if not without:
        return None
    option = _example([joint for joint in robot.joints if _missing(joint)])
    endless = [joint.name for joint in robot.joints if not _has_stops(joint) and not _has_limits(joint)]
    return OutputError(
        f"A URDF needs limits of effort and velocity for each joint with position limits; in the description, limits "
        f"of these joints are missing: {', '.join(joint.name for joint in without)}"
        + (f" (and of {', '.join(endless)}, for which the format does not require limits)." if endless else "."),
        possible="the formats mjcf and sdf, which need no limits",
        remedy=f"give the missing limits of the arm; the numbers here are only examples: {option}",
    )


def read(data: bytes, locked: Mapping[str, float]) -> Robot:
    """Reads the arm from the text of a URDF."""
    return reader.read(data.decode(), source="the written file", locked=locked, tip=None)


def witnesses(data: bytes, content: Content, q: Array, dq: Array, ddq: Array) -> list[Witness]:
    """Models that Pinocchio and MuJoCo read from a written URDF."""
    root = without_namespace(ET.fromstring(data))
    for link in root.iter("link"):
        for drawn in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(drawn)
    for joint in root.findall("joint"):
        if joint.find("limit") is None and joint.get("type") in ("revolute", "prismatic"):
            ET.SubElement(joint, "limit", {"effort": "0", "velocity": "0"})
    for extension in root.findall("mujoco"):
        root.remove(extension)
    text = ET.tostring(root, encoding="unicode")
    return [
        pinocchio_witness(lambda pin: pin.buildModelFromXML(text), content, q, dq, ddq, reads=PLACES),
        mujoco_witness(text, content, q, dq, ddq, reads=PLACES),
    ]


def _named(joint: ET.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def _numbers(text: str | None) -> list[float]:
    """Three numbers that a text contains; three zeros if the text is empty."""
    return [float(word) for word in text.split()] if text and text.strip() else [0.0, 0.0, 0.0]


def _pose(origin: ET.Element | None) -> Array:
    """Transform (4, 4) that an element `<origin>` contains; the identity if there is no such element."""
    if origin is None:
        return np.eye(4)
    return homogeneous(rpy_rotation(_numbers(origin.get("rpy"))), _numbers(origin.get("xyz")))


def _nominal(link: ET.Element) -> InertialParameters | None:
    """Inertia of a link of a URDF in the frame of the link; `None` if the link has no `<inertial>`."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    mass, tensor = inertial.find("mass"), inertial.find("inertia")
    pose = _pose(inertial.find("origin"))
    about = np.zeros((3, 3))
    for key, (i, j) in TENSOR.items():
        about[i, j] = about[j, i] = 0.0 if tensor is None else float(tensor.get(key, "0"))
    R = pose[:3, :3]
    return InertialParameters.from_com(
        0.0 if mass is None else float(mass.get("value", "0")), pose[:3, 3], R @ about @ R.T
    )


def _edit_inertial(document: Document, link: XmlNode, body: InertialParameters) -> None:
    """Replaces the inertia of a link in the text; elements of `<inertial>` that exist keep their place."""
    mass, com, about = com_form(body, f"link {link.values.get('name')!r}")
    inertial = link.find("inertial")
    if inertial is None:
        document.first(link, [_inertial_element(mass, com, about)])
        return
    origin = inertial.find("origin")
    R = rpy_rotation(_numbers(origin.values.get("rpy"))) if origin is not None else np.eye(3)
    about = R.T @ about @ R
    wanted = {
        "origin": {"xyz": text_of(*com)},
        "mass": {"value": text_of(mass)},
        "inertia": {key: text_of(about[i, j]) for key, (i, j) in TENSOR.items()},
    }
    missing: list[str] = []
    for tag, attributes in wanted.items():
        element = inertial.find(tag)
        if element is None:
            missing.append(element_text(tag, attributes))
            continue
        for key, value in attributes.items():
            document.set(element, key, value)
    if missing:
        document.last(inertial, missing)


def _edit_dynamics(document: Document, joint: XmlNode, friction: Mapping[str, str]) -> None:
    """Replaces damping and friction of a joint in the text, or inserts them if the joint has none."""
    dynamics = joint.find("dynamics")
    if dynamics is None:
        document.last(joint, [element_text("dynamics", friction)])
        return
    for key, value in friction.items():
        document.set(dynamics, key, value)


def _inertial_element(mass: float, com: Array, about: Array) -> str:
    tensor = " ".join(f'{key}="{text_of(about[i, j])}"' for key, (i, j) in TENSOR.items())
    return (
        f'<inertial><origin xyz="{text_of(*com)}" rpy="0 0 0"/><mass value="{text_of(mass)}"/>'
        f"<inertia {tensor}/></inertial>"
    )


def _relative_meshes(document: Document) -> tuple[Finding, ...]:
    """Finding about meshes whose paths are relative to the folder of the description; empty if there are none."""
    names = [node.values.get("filename", "") for node in document.root.walk() if node.tag == "mesh"]
    relative = [name for name in names if name and "://" not in name and not name.startswith("/")]
    if not relative:
        return ()
    what = f"{len(relative)} meshes, such as {relative[0]}, have paths relative to the folder of the description"
    return (Finding("relative-meshes", "info", "", what, "put the written file into the folder of the description"),)


def _fresh(content: Content) -> WrittenDescription:
    """Makes a new URDF, whose links have inertia but no shapes."""
    robot = content.robot
    if (missing := missing_limits(robot)) is not None:
        raise missing
    names = unique_names([link.name for link in robot.links])
    base, tip = unique_names(["base_link", robot.tip.name], names)
    fixed = unique_names([f"{tip}_fixed"], robot.joint_names)[0]
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(robot.name)}>", f"  <link name={quoteattr(base)}/>"]
    findings: list[Finding] = []
    for name, link in zip(names, robot.links, strict=True):
        inertial = _inertial_element(*com_form(link.inertial or InertialParameters.zero(), f"link {name!r}"))
        lines += [f"  <link name={quoteattr(name)}>", f"    {inertial}", "  </link>"]
    for i, joint in enumerate(robot.joints):
        parent = base if joint.parent < 0 else names[joint.parent]
        lines += _joint_lines(joint, parent, names[i], content.joints.get(joint.name, {}))
    endless = [j for j in robot.joints if not _has_stops(j) and not _has_limits(j)]
    half = [j.name for j in endless if math.isfinite(min(j.velocity_limit, j.effort_limit))]
    if endless:
        what = f"written without <limit>, because limits are unknown: {', '.join(j.name for j in endless)}"
        what += (
            f"; {', '.join(half)}: one limit is known, but the format stores effort and velocity only together"
            if half
            else ""
        )
        findings.append(
            Finding(
                "limits-unknown",
                "info",
                "",
                what,
                "give the limits of these joints with an option; the numbers here are only examples: "
                f"{_example(endless)}",
            )
        )
    parent = base if robot.tip.parent < 0 else names[robot.tip.parent]
    lines += [
        f"  <link name={quoteattr(tip)}/>",
        f'  <joint name={quoteattr(fixed)} type="fixed">',
        f"    {_origin(robot.tip.placement)}",
        f"    <parent link={quoteattr(parent)}/>",
        f"    <child link={quoteattr(tip)}/>",
        "  </joint>",
        "</robot>",
    ]
    return WrittenDescription(("\n".join(lines) + "\n").encode(), tuple(findings))


def _joint_lines(joint: Joint, parent: str, child: str, values: Mapping[str, float]) -> list[str]:
    bounded = bool(np.isfinite(joint.position_limits).all())
    kind = "prismatic" if joint.is_prismatic else "revolute" if bounded else "continuous"
    low, high = joint.position_limits
    position = f'lower="{text_of(low)}" upper="{text_of(high)}" ' if bounded else ""
    limit = f'{position}effort="{text_of(joint.effort_limit)}" velocity="{text_of(joint.velocity_limit)}"'
    friction = " ".join(f'{ATTRIBUTES[term]}="{text_of(x)}"' for term, x in values.items() if term in ATTRIBUTES)
    return [
        f'  <joint name={quoteattr(joint.name)} type="{kind}">',
        f"    {_origin(joint.placement)}",
        f"    <parent link={quoteattr(parent)}/>",
        f"    <child link={quoteattr(child)}/>",
        f'    <axis xyz="{text_of(*joint.axis)}"/>',
        *([f"    <limit {limit}/>"] if _has_limits(joint) else []),
        *([f"    <dynamics {friction}/>"] if friction else []),
        "  </joint>",
    ]


def _has_stops(joint: Joint) -> bool:
    """True if URDF requires limits for a joint, because it is prismatic or has position limits."""
    return joint.is_prismatic or bool(np.isfinite(joint.position_limits).all())


def _has_limits(joint: Joint) -> bool:
    return math.isfinite(joint.velocity_limit) and math.isfinite(joint.effort_limit)


def _missing(joint: Joint) -> list[str]:
    """Values of the option `--limit` for the limits that a joint lacks, with example numbers."""
    known_limits = {"velocity": math.isfinite(joint.velocity_limit), "effort": math.isfinite(joint.effort_limit)}
    known_limits["position"] = not joint.is_prismatic or bool(np.isfinite(joint.position_limits).all())
    return [f"{joint.name}.{kind}={EXAMPLES[kind]}" for kind, known in known_limits.items() if not known]


EXAMPLES = {"velocity": "2", "effort": "100", "position": "-0.5:0.5"}
"""Example values of limits, which are proposed in an option."""


def _example(joints: Sequence[Joint]) -> str:
    return "--limit " + ",".join(each for joint in joints for each in _missing(joint))


def _origin(pose: Array) -> str:
    return f'<origin xyz="{text_of(*pose[:3, 3])}" rpy="{text_of(*rpy_of(pose[:3, :3]))}"/>'
