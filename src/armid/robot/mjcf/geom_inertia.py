"""Inertia of a body from its geoms, as MuJoCo computes it for a body without the element <inertial>."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from armid.checked_array import Array
from armid.maths.inertia import com_inertia_to_vector, transform
from armid.maths.rotations import homogeneous
from armid.robot.mjcf.mesh_assets import MeshAssets
from armid.robot.mjcf.mesh_reading import UncomputableError
from armid.robot.mjcf.poses import placement_of
from armid.robot.mjcf.settings import Settings
from armid.robot.shapes import rotation_with_z
from armid.robot.xml import numbers

SIZES = {"sphere": 1, "capsule": 2, "ellipsoid": 3, "cylinder": 2, "box": 3}
"""Number of sizes of each solid primitive."""

MASSLESS = ("plane", "hfield")

POINT = np.eye(10)[0]
"""Inertial parameters of a point mass of 1 kg at the origin."""

DENSITY = 1000.0
"""Density of a geom that states none [kg/m³, or kg/m² for a shell]."""

GROUPS = (0.0, 5.0)
"""First and last group of geoms whose mass is counted, if the compiler settings give no range of groups."""


def heavy_geoms(body: ET.Element, childclass: str, settings: Settings) -> list[ET.Element]:
    """Geoms of a body that have a mass, with the attributes of their default classes."""
    low, high = numbers(
        ET.Element("compiler", settings.compiler), "inertiagrouprange", 2, settings.source, "compiler"
    ) or GROUPS  # fmt: skip

    def is_heavy(geom: ET.Element) -> bool:
        if geom.get("type") in MASSLESS:
            return False
        group, mass, density = (_number(geom, key, settings) for key in ("group", "mass", "density"))
        stated = mass if mass is not None else density  # a stated mass overrides the density
        return low <= (group or 0.0) <= high and stated != 0.0

    geoms = (settings.resolved(geom, childclass) for geom in body.findall("geom"))
    return [geom for geom in geoms if is_heavy(geom)]


def is_solid(geom: ET.Element) -> bool:
    """Tests whether a geom is a solid primitive, that is, neither a mesh nor a shell."""
    return geom.get("type", "sphere") in SIZES and "mesh" not in geom.attrib and geom.get("shellinertia") != "true"


def stated_mass(geoms: Sequence[ET.Element], settings: Settings) -> float | None:
    """Sum of the masses that are stated for geoms [kg]; `None` if no mass is stated for one of them."""
    masses = [_number(geom, "mass", settings) for geom in geoms]
    return None if None in masses else sum(mass for mass in masses if mass is not None)


def inertia_of_geoms(geoms: Sequence[ET.Element], meshes: MeshAssets, settings: Settings, where: str) -> Array:
    """Ten inertial parameters of a body in its own frame, shape (10,).

    Args:
        geoms: Geoms of the body that have a mass, with the attributes of their default classes.
        meshes: Meshes of the document.
        settings: Settings of the document.
        where: Name of the geoms, for messages.

    Raises:
        UncomputableError: A mesh cannot be read, or a geom is of a kind whose inertia is not computed.
    """
    total = np.zeros(10)
    for geom in geoms:
        unit, pose = _unit_inertia(geom, meshes, settings, where)
        mass, density = (_number(geom, key, settings) for key in ("mass", "density"))
        if mass is not None and not unit[0]:
            unit = POINT  # a primitive without volume, which MuJoCo would refuse
        scale = (DENSITY if density is None else density) if mass is None else mass / unit[0]
        total += transform(scale * unit, pose[:3, :3], pose[:3, 3])
    return total


def _unit_inertia(geom: ET.Element, meshes: MeshAssets, settings: Settings, where: str) -> tuple[Array, Array]:
    """Inertial parameters (10,) of a geom of density 1 in its own frame, and its pose (4, 4) in the body."""
    kind = geom.get("type", "mesh" if "mesh" in geom.attrib else "sphere")
    pose = placement_of(ET.Element("geom", settings.pose(geom, where)))
    if kind == "mesh":
        return meshes.unit_inertia(geom.get("mesh", "")), pose
    if "mesh" in geom.attrib:
        raise UncomputableError(f"a {kind} is fitted to the mesh {geom.get('mesh')!r}")
    if kind not in SIZES or geom.get("shellinertia") == "true":
        what = "a shell" if kind in SIZES else f"a geom of the type {kind!r}"
        raise UncomputableError(f"it has {what}, whose inertia is not computed")
    given = numbers(geom, "size", len(geom.get("size", "").split()), settings.source, where)
    size = given or [0.0]
    ends = numbers(geom, "fromto", 6, settings.source, where)
    if ends is not None and kind != "sphere":
        along = np.subtract(ends[3:], ends[:3])
        half = float(np.linalg.norm(along)) / 2.0
        size = [size[0], half] if SIZES[kind] == 2 else [size[0], size[0], half]
        pose = homogeneous(rotation_with_z(along), np.add(ends[3:], ends[:3]) / 2.0)
    return _of_primitive(kind, size), pose


def _of_primitive(kind: str, size: Sequence[float]) -> Array:
    """Ten inertial parameters of a solid primitive of density 1 about its centre; sizes as in MuJoCo [m]."""
    x, y, z = (*size, *[0.0] * 3)[:3]
    if kind in ("box", "ellipsoid"):
        volume, share = (8.0 * x * y * z, 1.0 / 3.0) if kind == "box" else (4.0 / 3.0 * math.pi * x * y * z, 0.2)
        moments = volume * share * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
        return com_inertia_to_vector(volume, np.zeros(3), np.diag(moments))
    radius, half = x, 0.0 if kind == "sphere" else y
    tube = 2.0 * math.pi * radius**2 * half
    ball = 0.0 if kind == "cylinder" else 4.0 / 3.0 * math.pi * radius**3
    along = tube * radius**2 / 2.0 + ball * 0.4 * radius**2
    across = tube * (radius**2 / 4.0 + half**2 / 3.0) + ball * (0.4 * radius**2 + half**2 + 0.75 * radius * half)
    return com_inertia_to_vector(tube + ball, np.zeros(3), np.diag([across, across, along]))


def _number(geom: ET.Element, key: str, settings: Settings) -> float | None:
    found = numbers(geom, key, 1, settings.source, "a geom")
    return None if found is None else found[0]
