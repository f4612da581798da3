"""Collision and visual bodies of a URDF, placed on the links that remain after fixed joints are merged.

Mesh files are not opened here. A path that begins with package:// is searched as `armid.robot.packages` describes.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, RobotError
from armid.maths.rotations import axis_rotation, homogeneous
from armid.robot.collision_body_names import BodyName
from armid.robot.packages import file_of, may_read, option_for, split_reference
from armid.robot.robot import Robot
from armid.robot.shapes import Kind, Shape, looks_missing, meshes_missing, shapes_unknown
from armid.robot.urdf.tree import axis_of, pose_of
from armid.robot.xml import numbers

TAGS = ("box", "sphere", "cylinder", "capsule", "mesh")
"""Tags of shapes; the capsule is an extension of MoveIt and others."""


def shapes_of_urdf(
    root: ET.Element, robot: Robot, locked: Mapping[str, float], source: str, kind: str = "collision"
) -> tuple[tuple[Shape, ...], tuple[Finding, ...]]:
    """Shapes of all tags <collision> or <visual>, and findings about those that cannot be used.

    Args:
        root: The document with its tags <collision> and <visual>.
        robot: The robot of the document, whose joints carry the shapes.
        locked: Positions [rad or m] of the joints that the reader has fixed, by name.
        source: Path of the description.
        kind: `collision` or `visual`.

    Raises:
        RobotError: A tag <collision> is invalid. An invalid <visual> is ignored with a finding.
    """
    above = {joint.find("child").get("link"): joint for joint in root.findall("joint")}  # pyright: ignore
    shapes: list[Shape] = []
    findings: list[Finding] = []
    missing: dict[str, str] = {}
    unknown: dict[str, str] = {}
    for link in root.iter("link"):
        name = link.get("name", "")
        for number, body in enumerate(link.findall(kind), 1):
            geometry = body.find("geometry")
            if geometry is None or not len(geometry):
                continue
            label = BodyName(name, number)
            if geometry[0].tag not in TAGS:
                unknown[label] = f"<{geometry[0].tag}>"
                continue
            joint, placement = _carrier(name, above, robot, locked, source)
            try:
                form, size, path = geometry_of(geometry[0], source, f"the {kind} of {label!r}")
                if form == "mesh" and not path:
                    missing[label] = geometry[0].get("filename", "")
                    continue
                shapes.append(
                    Shape(
                        label, joint, form, size, placement @ pose_of(body, f"the {kind} of {label!r}", source), path
                    )
                )
            except RobotError as error:
                if kind == "collision":
                    raise
                # Only pictures depend on it.
                findings.append(
                    Finding(
                        "visual-left-out",
                        "info",
                        label,
                        error.problem,
                        "correct the tag <visual> if this body is needed in pictures.",
                    )
                )
    option = option_for(missing.values(), source)
    findings += (meshes_missing if kind == "collision" else looks_missing)(missing, option)
    return tuple(shapes), (*findings, *shapes_unknown(unknown, drawn=kind == "visual"))


def _carrier(
    link: str, above: Mapping[str | None, ET.Element], robot: Robot, locked: Mapping[str, float], source: str
) -> tuple[int, Array]:
    """Index of the movable joint that carries a link, and the pose of the link in the link frame of this joint."""
    placement = np.eye(4)
    names = robot.joint_names
    while link in above:
        joint = above[link]
        name = joint.get("name", "")
        if name in names:
            return names.index(name), placement
        step = pose_of(joint, f"joint {name!r}", source)
        if locked.get(name):
            direction = axis_of(joint, source)
            sliding = joint.get("type") == "prismatic"
            turn = np.eye(3) if sliding else axis_rotation(direction, np.asarray(locked[name]))
            step = step @ homogeneous(turn, locked[name] * direction if sliding else np.zeros(3))
        placement = step @ placement
        link = joint.find("parent").get("link", "")  # pyright: ignore[reportOptionalMemberAccess]
    return -1, placement


def geometry_of(shape: ET.Element, source: str, where: str) -> tuple[Kind, Array, str]:
    """Kind, size and file of the shape inside a tag <geometry>, which is one of `TAGS`."""

    def value(key: str, count: int, default: float) -> list[float]:
        return numbers(shape, key, count, source, where) or [default] * count

    if shape.tag == "box":
        return "box", np.array(value("size", 3, 0.0)), ""
    if shape.tag == "sphere":
        return "sphere", np.array(value("radius", 1, 0.0)), ""
    if shape.tag in ("cylinder", "capsule"):
        kind: Kind = "cylinder" if shape.tag == "cylinder" else "capsule"
        return kind, np.array([*value("radius", 1, 0.0), *value("length", 1, 0.0)]), ""
    return "mesh", np.array(value("scale", 3, 1.0)), _mesh_path(shape.get("filename", ""), source)


def _mesh_path(filename: str, source: str) -> str:
    """Path of the file of a mesh that a URDF names; empty if the file is not found or may not be read."""
    folder = Path(source).resolve().parent
    if (reference := split_reference(filename)) is not None:
        return file_of(*reference, source)
    place = folder / filename.removeprefix("file://")
    return str(place) if may_read(place, source) and place.is_file() else ""
