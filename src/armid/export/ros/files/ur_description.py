"""Files of the package `ur_description` for ROS 2: `physical_parameters.yaml` and `joint_dynamics.yaml`.

`physical_parameters.yaml` has the mass, the centre of mass, the rotation of the tensor and the tensor of each link,
and two offsets of meshes and the cylinder of the base, which are taken from the URDF. The older form without rotation
and tensor, with cylinders for all links, cannot hold identified inertias.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from typing import Any, cast

from armid.errors import OutputError
from armid.export.ros.package_yaml import (
    TENSOR,
    find_prefix,
    friction_of,
    link_numbers,
    numbers_of_links,
    read_yaml,
    require_axes,
    with_values,
    yaml_lines,
)

NEEDS_DESCRIPTION: bool = True

PACKAGE = "ur_description"
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
RIGHT = math.pi / 2.0
AXES = dict(
    zip(
        JOINTS,
        [(0.0, 0.0, 0.0), (RIGHT, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (RIGHT, 0.0, 0.0), (-RIGHT, 0.0, 0.0)],
        strict=True,
    )
)
"""Roll, pitch and yaw of each joint [rad] in the package; its descriptions for ROS 1 had other frames."""

PHYSICAL, DYNAMICS = "physical_parameters.yaml", "joint_dynamics.yaml"


def write(urdf: bytes, about: str) -> dict[str, str]:
    """Makes `physical_parameters.yaml` and `joint_dynamics.yaml`."""
    root = ET.fromstring(urdf)
    prefix = _prefix(root)
    names = [f"{prefix}{link}_link" for link in LINKS]
    require_axes(root, {f"{prefix}{joint}_joint": rpy for joint, rpy in AXES.items()}, PACKAGE)
    numbers = dict(zip(LINKS, numbers_of_links(root, names, PACKAGE), strict=True))
    base, radius, length = _base(root, prefix)
    inertia: dict[str, Any] = {"base_mass": base, **{f"{link}_mass": each.mass for link, each in numbers.items()}}
    inertia["links"] = {"base": {"radius": radius, "length": length}}
    inertia["center_of_mass"] = {
        f"{link}_cog": dict(zip("xyz", each.com.tolist(), strict=True)) for link, each in numbers.items()
    }
    inertia["rotation"] = {link: {"roll": 0.0, "pitch": 0.0, "yaw": 0.0} for link in numbers}
    inertia["tensor"] = {
        link: {f"i{pair}": float(each.inertia[i, j]) for pair, (i, j) in TENSOR.items()}
        for link, each in numbers.items()
    }
    offsets = {
        "shoulder_offset": _mesh_offset(root, f"{prefix}upper_arm_link"),
        "elbow_offset": _mesh_offset(root, f"{prefix}forearm_link"),
    }
    friction = {f"{joint}_joint": friction_of(root, f"{prefix}{joint}_joint") for joint in JOINTS}
    head = [f"# {about}", "# The offsets of meshes and the base are those of the description."]
    physical = [*head, *yaml_lines({"offsets": offsets, "inertia_parameters": inertia})]
    dynamics = [*head[:1], *yaml_lines({"joint_dynamics": friction})]
    return {PHYSICAL: "\n".join(physical) + "\n", DYNAMICS: "\n".join(dynamics) + "\n"}


def expanded(files: Mapping[str, str], urdf: bytes) -> bytes:
    """Makes the URDF in which inertias and friction are replaced by the values of the files."""
    prefix = _prefix(ET.fromstring(urdf))
    inertia = cast("dict[str, Any]", read_yaml(files[PHYSICAL])["inertia_parameters"])
    dynamics = cast("dict[str, Any]", read_yaml(files[DYNAMICS])["joint_dynamics"])
    links = {
        f"{prefix}{link}_link": (
            str(inertia[f"{link}_mass"]),
            " ".join(inertia["center_of_mass"][f"{link}_cog"][axis] for axis in "xyz"),
            " ".join(inertia["rotation"][link][angle] for angle in ("roll", "pitch", "yaw")),
            {pair: str(inertia["tensor"][link][f"i{pair}"]) for pair in TENSOR},
        )
        for link in LINKS
    }
    return with_values(urdf, links, {prefix + joint: values for joint, values in dynamics.items()})


def _prefix(root: ET.Element) -> str:
    return find_prefix(root, [f"{link}_link" for link in LINKS], PACKAGE)


def _base(root: ET.Element, prefix: str) -> tuple[float, float, float]:
    """Mass [kg], radius [m] and length [m] of the cylinder with the inertia of the base."""
    base = link_numbers(root, f"{prefix}base_link_inertia")
    if base is None or base.mass <= 0.0:
        raise OutputError(
            f"{PACKAGE} needs the mass of the base, and the URDF has no link {prefix}base_link_inertia with a mass.",
            remedy=f"identify with a description of {PACKAGE}, or choose another format with --to.",
        )
    radius = math.sqrt(max(2.0 * float(base.inertia[2, 2]) / base.mass, 0.0))
    return base.mass, radius, math.sqrt(max(12.0 * float(base.inertia[0, 0]) / base.mass - 3.0 * radius**2, 0.0))


def _mesh_offset(root: ET.Element, link: str) -> float:
    """Offset of the mesh of a link in z [m], which is a value of the package; zero if the URDF has no mesh."""
    for each in root.findall("link"):
        if each.get("name") == link:
            origin = each.find("visual/origin")
            words = [] if origin is None else origin.get("xyz", "").split()
            return float(words[2]) if len(words) == 3 else 0.0
    return 0.0
