"""Visual and collision geometry of an MJCF and its sites; each is placed on the link that carries it.

A geom is visual if it has no contacts (contype and conaffinity are 0). By MuJoCo's convention, groups from 3 on are
hidden. In a tree of bodies without hinges and slides, a visual geom is a marker if it is see-through, small, or moved
by the simulation (mocap and free bodies). Meshes are searched in the folders of the compiler settings; the files are
not opened here.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError, Finding
from armid.maths.rotations import homogeneous
from armid.robot.body_tree import BodyTree
from armid.robot.collision_body_names import BodyName
from armid.robot.mjcf.plain_document import Plain
from armid.robot.mjcf.poses import placement_of
from armid.robot.shapes import (
    Kind,
    Shape,
    capsule_between,
    looks_missing,
    meshes_missing,
    rotation_with_z,
    shapes_unknown,
)

FIRST_HIDDEN = 3.0
"""First group of geoms that the viewer of MuJoCo hides by default."""

WORLD = "world"
"""Name of the group of geoms that belong to no body."""

SIZED = ("sphere", "ellipsoid", "capsule", "cylinder", "box")
"""Types of geoms that are given by their sizes."""

MARKER = 0.1
"""Extent below which a primitive without contacts that belongs to no robot of a scene is taken for a marker [m]."""


def carriers_of(tree: BodyTree) -> dict[str, tuple[int, Array]]:
    """For each body, by name: index of the joint that moves it (-1 for none), and its pose in the link frame."""
    return {frame.name: (frame.joint, frame.placement) for _, frame in tree.bodies()}


def shapes_of_mjcf(
    root: ET.Element, plain: Plain, carriers: Mapping[str, tuple[int, Array]]
) -> tuple[tuple[Shape, ...], tuple[Shape, ...], tuple[Shape, ...], tuple[Finding, ...]]:
    """Collision geometry, visual geometry, markers among the visual geometry, and findings about missing geometry.

    Args:
        root: The document with includes resolved.
        plain: Plain form of the document, with all geoms.
        carriers: Joint and pose of each body, from `carriers_of`.
    """
    meshes = {} if plain.meshes is None else plain.meshes.existing()
    lost = {} if plain.meshes is None else plain.meshes.unusable()
    shapes: list[Shape] = []
    visuals: list[Shape] = []
    markers: list[Shape] = []
    moved, beside, glass = *_scenery(root), _see_through(root)
    missing, unseen, unknown, undrawn = (dict[str, str]() for _ in range(4))
    count: Counter[tuple[str, bool]] = Counter()
    for body, geom in plain.geoms:
        link, placement = carriers.get(body, (-1, np.eye(4)))
        touches = (geom.get("contype", "1"), geom.get("conaffinity", "1")) != ("0", "0")
        count[body, touches] += 1
        name = BodyName(body or WORLD, count[body, touches])
        shape = shape_of(name, geom, meshes)
        if shape is None:
            mesh = geom.get("mesh", "")
            if _kind_of(geom) == "mesh" and not lost.get(mesh):
                (missing if touches else unseen)[name] = mesh
            else:
                (unknown if touches else undrawn)[name] = _in_words(geom, lost)
            continue
        shape = shape.on(link, placement)
        if touches:
            shapes.append(shape)
        if float(geom.get("group", "0")) < FIRST_HIDDEN:
            visuals.append(shape)
            seen_through = glass.get(geom.get("material", ""), False) if "rgba" not in geom.attrib else _clear(geom)
            marks = body in moved or (body in beside and (seen_through or _is_small(shape)))
            markers += [shape] * (marks and not touches and shape.kind != "half-space")
    findings = (*meshes_missing(missing), *looks_missing(unseen))
    findings += (*shapes_unknown(unknown), *shapes_unknown(undrawn, drawn=True))
    return tuple(shapes), tuple(visuals), tuple(markers), findings


def _in_words(geom: ET.Element, lost: Mapping[str, str]) -> str:
    """Text with the kind of a geom that is not read, and for a mesh with the reason."""
    kind, mesh = _kind_of(geom), geom.get("mesh", "")
    if kind == "mesh":
        return f"the mesh {mesh!r}, {lost[mesh]},"
    if mesh:
        return f"a {kind} that is fitted to the mesh {mesh!r}"
    return f"a {kind} of size {geom.get('size', '')!r}" if kind in SIZED else f"a geom of type {kind!r}"


def _scenery(root: ET.Element) -> tuple[set[str], set[str]]:
    """Names of the bodies that do not belong to a robot: bodies that a simulation moves, and fixed bodies.

    An empty name stands for the world.
    """
    moved, standing = set[str](), {""}
    for tree in (body for worldbody in root.findall("worldbody") for body in worldbody.findall("body")):
        joints = [*tree.iter("joint"), *tree.iter("freejoint")]
        if any(joint.tag == "joint" and joint.get("type", "hinge") in ("hinge", "slide") for joint in joints):
            continue
        dragged = bool(joints) or tree.get("mocap") == "true"
        (moved if dragged else standing).update(body.get("name", "") for body in tree.iter("body"))
    return moved, standing


def _see_through(root: ET.Element) -> dict[str, bool]:
    """For each material, by name: true if the material is see-through."""
    return {material.get("name", ""): _clear(material) for asset in root.findall("asset") for material in asset}


def _clear(element: ET.Element) -> bool:
    """Tests whether the colour of an element is see-through."""
    colour = element.get("rgba", "").split()
    return len(colour) == 4 and float(colour[3]) < 1.0


def _is_small(shape: Shape) -> bool:
    """Tests whether a primitive is as small as a marker."""
    radius, length, _ = shape.size
    extent = {
        "sphere": 2.0 * radius,
        "box": float(shape.size.max()),
        "ellipsoid": 2.0 * float(shape.size.max()),
        "cylinder": max(2.0 * radius, length),
        "capsule": 2.0 * radius + length,
    }
    return bool(extent.get(shape.kind, MARKER) < MARKER)


def _kind_of(geom: ET.Element) -> str:
    return geom.get("type", "mesh" if "mesh" in geom.attrib else "sphere")


def shape_of(name: str, geom: ET.Element, meshes: Mapping[str, tuple[str, Array, Array]]) -> Shape | None:
    """Geom as a shape in the frame of its body; `None` if its kind is not supported."""
    kind, pose = _kind_of(geom), placement_of(geom)
    if kind == "mesh":
        path, scale, placed = meshes.get(geom.get("mesh", ""), ("", np.ones(3), np.eye(4)))
        return Shape(name, -1, "mesh", scale, pose @ placed, path) if path else None
    if "mesh" in geom.attrib:
        return None  # it is fitted to the mesh, whatever its size
    try:
        size = [float(x) for x in geom.get("size", "").split()]
        if kind in ("capsule", "cylinder") and "fromto" in geom.attrib:
            between = capsule_between(name, -1, *_ends(geom), size[0])
            return Shape(name, -1, kind, between.size, between.placement)
        if kind in ("box", "ellipsoid") and "fromto" in geom.attrib:
            begin, end = _ends(geom)
            size = [size[0], size[0], 0.5 * float(np.linalg.norm(end - begin))]
            pose = homogeneous(rotation_with_z(end - begin), 0.5 * (begin + end))
        simple: dict[str, tuple[Kind, list[float]]] = {
            "plane": ("half-space", [0.0]),
            "sphere": ("sphere", size[:1]),
            "ellipsoid": ("ellipsoid", size),
            "capsule": ("capsule", [size[0], 2.0 * size[1]] if size[1:] else []),
            "cylinder": ("cylinder", [size[0], 2.0 * size[1]] if size[1:] else []),
            "box": ("box", [2.0 * x for x in size]),
        }
        form, edges = simple[kind]
        return Shape(name, -1, form, np.array(edges), pose)
    except (IndexError, KeyError, ValueError, ArmidError):  # a height field, or an invalid size
        return None


def _ends(geom: ET.Element) -> tuple[Array, Array]:
    """The two points (3,) [m] between which a geom is placed."""
    begin, end = np.array([float(x) for x in geom.get("fromto", "").split()]).reshape(2, 3)
    return begin, end
