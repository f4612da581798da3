"""Writer of SDF 1.8: makes new files with links, joints, inertias and joint friction, without shapes.

Every pose is relative to the link or joint that carries the element. The format has no element for rotor inertia.
Gravity belongs to the world and not to the model. A fixed joint connects the arm to the world.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from armid.checked_array import Array
from armid.errors import OutputError
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
from armid.maths.rotations import homogeneous, rpy_rotation
from armid.robot.robot import Frame, InertialParameters, Joint, Link, Robot

SUFFIX: str = ".sdf"

TENSOR = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
TAGS = {"viscous": "damping", "coulomb": "friction"}
PLACES: Sequence[str] = tuple(TAGS)
NOT_READ = "no installed program reads SDF; only armid read the file back"


def open_description(path: Path, data: bytes) -> OpenedDescription | None:
    """Returns `None`, because SDF is only written."""
    del path, data


def bodies(source: DescriptionSource, raw: Robot, robot: Robot) -> list[Body]:
    """Returns an empty list, because descriptions in SDF are not read."""
    del source, raw, robot
    return []


def write(content: Content) -> WrittenDescription:
    """Makes a new SDF model; a description is never edited."""
    robot = content.robot
    # Links, joints and frames share one namespace.
    base, tip, *links = unique_names(
        ["base_link", robot.tip.name, *(link.name for link in robot.links)], robot.joint_names
    )
    lines = [
        '<?xml version="1.0"?>',
        '<sdf version="1.8">',
        f'  <model name={quoteattr(robot.name)} canonical_link="{escape(base)}">',
        f"    <link name={quoteattr(base)}/>",
        f'    <joint name={quoteattr(unique_names(["world_fixed"], [*robot.joint_names, *links])[0])} type="fixed">',
        f"      <parent>world</parent><child>{escape(base)}</child>",
        "    </joint>",
    ]
    for i, joint in enumerate(robot.joints):
        parent = base if joint.parent < 0 else links[joint.parent]
        body = robot.links[i].inertial or InertialParameters.zero()
        lines += _joint_lines(joint, parent, links[i], content.joints.get(joint.name, {}))
        lines += _link_lines(links[i], joint.name, body)
    parent = base if robot.tip.parent < 0 else links[robot.tip.parent]
    lines += [
        f"    <frame name={quoteattr(tip)} attached_to={quoteattr(parent)}>",
        f"      <pose>{_pose(robot.tip.placement)}</pose>",
        "    </frame>",
        "  </model>",
        "</sdf>",
    ]
    return WrittenDescription(("\n".join(lines) + "\n").encode())


def missing_limits(robot: Robot) -> OutputError | None:
    """Returns `None`, because SDF needs no limits."""
    del robot


def read(data: bytes, locked: Mapping[str, float]) -> Robot:
    """Reads the arm from a file that `write` has written.

    Raises:
        OutputError: The file contains no model.
    """
    del locked
    model = ET.fromstring(data).find("model")
    if model is None:
        raise OutputError("The written SDF contains no model.", remedy="this is a fault of armid: report it.")
    moving = [joint for joint in model.findall("joint") if joint.get("type") != "fixed"]
    carried = [joint.findtext("child", "") for joint in moving]
    links = {link.get("name", ""): link for link in model.findall("link")}
    frame = model.find("frame")
    tip = Frame("tip", -1, np.eye(4)) if frame is None else _frame(frame, carried)
    return Robot(
        model.get("name", ""),
        tuple(_joint(joint, carried) for joint in moving),
        tuple(Link(name, _inertial(links[name])) for name in carried),
        tip,
    )


def witnesses(data: bytes, content: Content, q: Array, dq: Array, ddq: Array) -> list[Witness]:
    """Joint parameters that are parsed from the text, because neither Pinocchio nor MuJoCo reads SDF."""
    del content, q, dq, ddq
    parsed: dict[str, dict[str, float]] = {}
    for joint in ET.fromstring(data).iter("joint"):
        dynamics = joint.find("axis/dynamics")
        if dynamics is not None:
            given = {term: dynamics.findtext(tag) for term, tag in TAGS.items()}
            parsed[joint.get("name", "")] = {term: float(text) for term, text in given.items() if text is not None}
    return [Witness("sdf", None, parsed, NOT_READ, is_absent=True)]


def _joint_lines(joint: Joint, parent: str, child: str, values: Mapping[str, float]) -> list[str]:
    bounded = bool(np.isfinite(joint.position_limits).all())
    kind = "prismatic" if joint.is_prismatic else "revolute" if bounded else "continuous"
    limits = {
        "lower": joint.position_limits[0],
        "upper": joint.position_limits[1],
        "effort": joint.effort_limit,
        "velocity": joint.velocity_limit,
    }
    limit = "".join(f"<{key}>{text_of(x)}</{key}>" for key, x in limits.items() if math.isfinite(x))
    friction = "".join(f"<{TAGS[term]}>{text_of(x)}</{TAGS[term]}>" for term, x in values.items() if term in TAGS)
    return [
        f'    <joint name={quoteattr(joint.name)} type="{kind}">',
        f"      <pose relative_to={quoteattr(parent)}>{_pose(joint.placement)}</pose>",
        f"      <parent>{escape(parent)}</parent><child>{escape(child)}</child>",
        "      <axis>",
        f"        <xyz>{text_of(*joint.axis)}</xyz>",
        *([f"        <limit>{limit}</limit>"] if limit else []),
        *([f"        <dynamics>{friction}</dynamics>"] if friction else []),
        "      </axis>",
        "    </joint>",
    ]


def _link_lines(name: str, joint: str, body: InertialParameters) -> list[str]:
    mass, com, about = com_form(body, f"link {name!r}")
    tensor = "".join(f"<{key}>{text_of(about[i, j])}</{key}>" for key, (i, j) in TENSOR.items())
    return [
        f"    <link name={quoteattr(name)}>",
        f"      <pose relative_to={quoteattr(joint)}>0 0 0 0 0 0</pose>",
        "      <inertial>",
        f"        <pose>{text_of(*com)} 0 0 0</pose>",
        f"        <mass>{text_of(mass)}</mass>",
        f"        <inertia>{tensor}</inertia>",
        "      </inertial>",
        "    </link>",
    ]


def _pose(pose: Array) -> str:
    return text_of(*pose[:3, 3], *rpy_of(pose[:3, :3]))


def _numbers(element: ET.Element, path: str) -> list[float]:
    return [float(word) for word in element.findtext(path, "").split()]


def _transform(numbers: list[float]) -> Array:
    return homogeneous(rpy_rotation(numbers[3:]), numbers[:3])


def _index(element: ET.Element | None, attribute: str, carried: list[str]) -> int:
    """Index of the link that an attribute of an element names; -1 for the base.

    Args:
        element: XML element, such as a pose.
        attribute: Attribute that contains the name of the link.
        carried: Names of the moving links.
    """
    name = "" if element is None else element.get(attribute, "")
    return carried.index(name) if name in carried else -1


def _frame(frame: ET.Element, carried: list[str]) -> Frame:
    pose = _transform(_numbers(frame, "pose"))
    return Frame(frame.get("name", ""), _index(frame, "attached_to", carried), pose)


def _joint(joint: ET.Element, carried: list[str]) -> Joint:
    limits = [float(joint.findtext(f"axis/limit/{key}", default)) for key, default in LIMITS.items()]
    kind = joint.get("type")
    return Joint(
        joint.get("name", ""),
        "prismatic" if kind == "prismatic" else "continuous" if kind == "continuous" else "revolute",
        _index(joint.find("pose"), "relative_to", carried),
        np.array(_numbers(joint, "axis/xyz")),
        _transform(_numbers(joint, "pose")),
        np.array(limits[:2]),
        limits[2],
        limits[3],
    )


LIMITS = {"lower": "-inf", "upper": "inf", "velocity": "inf", "effort": "inf"}


def _inertial(link: ET.Element) -> InertialParameters:
    about = np.zeros((3, 3))
    for key, (i, j) in TENSOR.items():
        about[i, j] = about[j, i] = float(link.findtext(f"inertial/inertia/{key}", "nan"))
    com = _numbers(link, "inertial/pose")[:3]
    return InertialParameters.from_com(float(link.findtext("inertial/mass", "nan")), com, about)
