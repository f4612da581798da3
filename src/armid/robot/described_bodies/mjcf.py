"""Bodies of an MJCF: each body with an `<inertial>` that MuJoCo uses, in the frame of the body.

Bodies whose inertia MuJoCo computes from their geoms are left out, since such inertias agree with the shapes.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.robot.described_bodies.body import DescribedBody
from armid.robot.mjcf.joints import joint_names
from armid.robot.mjcf.plain_document import flatten, plain_mjcf
from armid.robot.mjcf.poses import placement_of
from armid.robot.mjcf.shapes import shape_of
from armid.robot.shapes import Shape
from armid.robot.xml import parse_xml

FULL = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Row and column of the entries of the attribute `fullinertia`."""


def bodies(text: str, source: str) -> tuple[DescribedBody, ...]:
    """Bodies of an MJCF that state a mass.

    Args:
        text: The MJCF text.
        source: Path of the text; included files and meshes are searched relative to it.

    Raises:
        RobotError: The text is not an MJCF that armid can read.
    """
    root = flatten(parse_xml(text, source), source)
    stating = {body.get("name", "") for body in root.iter("body") if body.find("inertial") is not None}
    plain = plain_mjcf(root, source, dict.fromkeys(joint_names(root), 0.0), folder=Path(source).resolve().parent)
    meshes = {} if plain.meshes is None else plain.meshes.existing()
    shapes: dict[str, list[Shape]] = {}
    missing: dict[str, list[str]] = {}
    for body, geom in plain.geoms:
        shape = shape_of(body, geom, meshes)
        if shape is not None and shape.kind != "half-space":
            shapes.setdefault(body, []).append(shape)
        elif shape is None:
            missing.setdefault(body, []).append(geom.get("mesh") or geom.get("type", "sphere"))
    found: list[DescribedBody] = []
    for element in ET.fromstring(plain.text).iter("body"):
        name, inertial = element.get("name", ""), element.find("inertial")
        if inertial is None or name not in stating or not float(inertial.get("mass", "0")):
            continue
        pose, about = placement_of(inertial), _tensor(inertial)
        R, own = pose[:3, :3], (tuple(shapes.get(name, ())), tuple(missing.get(name, ())))
        found.append(DescribedBody(name, float(inertial.get("mass", "0")), pose[:3, 3], R @ about @ R.T, *own))
    return tuple(found)


def _tensor(inertial: ET.Element) -> Array:
    """Inertia (3, 3) that an element `<inertial>` states in its own axes; zero if it states none."""
    tensor = np.zeros((3, 3))
    if "fullinertia" in inertial.attrib:
        for (i, j), word in zip(FULL, inertial.get("fullinertia", "").split(), strict=True):
            tensor[i, j] = tensor[j, i] = float(word)
    elif "diaginertia" in inertial.attrib:
        np.fill_diagonal(tensor, [float(word) for word in inertial.get("diaginertia", "").split()])
    return tensor
