"""Bodies of a URDF: each link with an `<inertial>`, in the frame of the link."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from contextlib import suppress

import numpy as np

from armid.errors import RobotError
from armid.robot.described_bodies.body import DescribedBody
from armid.robot.shapes import Shape
from armid.robot.urdf.shapes import TAGS, geometry_of
from armid.robot.urdf.tree import pose_of
from armid.robot.xml import numbers, parse_xml, without_namespace

TENSOR = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
"""Row and column of the attributes of `<inertia>`."""


def bodies(text: str, source: str) -> tuple[DescribedBody, ...]:
    """Links of a URDF that have a mass.

    Args:
        text: The URDF text.
        source: Path of the text; meshes are searched relative to it.

    Raises:
        RobotError: The text is not well-formed, or a number of an `<inertial>` is invalid.
    """
    root = without_namespace(parse_xml(text, source))
    found = (_body(link, source) for link in root.findall("link"))
    return tuple(body for body in found if body is not None)


def _body(link: ET.Element, source: str) -> DescribedBody | None:
    """Body of one link; `None` if the link has no mass."""
    inertial, name = link.find("inertial"), link.get("name", "")
    mass = None if inertial is None else inertial.find("mass")
    value = None if mass is None else numbers(mass, "value", 1, source, f"the mass of {name!r}")
    if inertial is None or not value or not value[0]:
        return None
    pose, tensor = pose_of(inertial, f"the inertial of {name!r}", source), inertial.find("inertia")
    about = np.zeros((3, 3))
    for key, (i, j) in TENSOR.items():
        entry = None if tensor is None else numbers(tensor, key, 1, source, f"the inertia of {name!r}")
        about[i, j] = about[j, i] = entry[0] if entry else 0.0
    shapes, missing = _shapes(link, source)
    R = pose[:3, :3]
    return DescribedBody(name, value[0], pose[:3, 3], R @ about @ R.T, shapes, missing)


def _shapes(link: ET.Element, source: str) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Shapes of a link in its frame, and the names of its meshes that are not found; invalid shapes are left out."""
    shapes: list[Shape] = []
    missing: list[str] = []
    for drawn in (*link.findall("visual"), *link.findall("collision")):
        geometry = drawn.find("geometry")
        if geometry is None or not len(geometry):
            continue
        if geometry[0].tag not in TAGS:
            missing.append(f"<{geometry[0].tag}>")
            continue
        with suppress(RobotError):  # the reader of the description reports it
            kind, size, path = geometry_of(geometry[0], source, "a shape")
            if kind == "mesh" and not path:
                missing.append(geometry[0].get("filename", ""))
            else:
                pose = pose_of(drawn, "a shape", source)
                shapes.append(Shape(link.get("name", ""), -1, kind, size, pose, path))
    return tuple(shapes), tuple(missing)
