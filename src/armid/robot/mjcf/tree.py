"""Tree of bodies of an MJCF in plain form."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from armid.checked_array import Array
from armid.maths.rotations import axis_rotation, homogeneous
from armid.robot.body_tree import BodyTree
from armid.robot.mjcf.plain_document import Plain
from armid.robot.mjcf.poses import placement_of


def tree_of_mjcf(plain: Plain) -> BodyTree:
    """Tree of bodies, with the sites of the document.

    Args:
        plain: Plain form of the document.
    """
    tree = BodyTree()
    frames: dict[str, int] = {}

    def add(body: ET.Element, above: int, place: Array) -> None:
        name, joint = body.get("name", ""), body.find("joint")
        offset = np.eye(4)
        if joint is not None:
            step, axis, offset = _joint(joint)
            is_prismatic = joint.get("type") == "slide"
            above = tree.add_joint(above, joint.get("name", ""), place @ step, axis, is_prismatic=is_prismatic)
        elif above >= 0:
            above = tree.add_frame(above, "", "fixed", place)
        frames[name] = tree.add_frame(above, name, "body", offset)
        if name in plain.inertias:
            tree.add_inertia(frames[name], plain.inertias[name])
        for child in body.findall("body"):
            add(child, frames[name], placement_of(child))

    for world in plain.root.iter("worldbody"):
        for body in world.findall("body"):
            add(body, -1, np.eye(4))
    for body, site in plain.sites:
        tree.add_frame(frames[body], site.get("name", ""), "site", placement_of(site))
    return tree


def _joint(joint: ET.Element) -> tuple[Array, Array, Array]:
    """Frame of a joint, axis, and pose of its body in this frame.

    The body has the pose of the document if the joint is at its reference position.

    Returns:
        Pose (4, 4) of the frame at position zero, relative to the pose of the body in the document; axis (3,); pose
        (4, 4) of the body in the frame, which moves with the body.
    """
    text = {"axis": "0 0 1", "pos": "0 0 0", **joint.attrib}
    axis, position = (np.array([float(x) for x in text[key].split()]) for key in ("axis", "pos"))
    axis = axis / np.linalg.norm(axis)
    reference = float(joint.get("ref", "0"))
    turned, moved = np.eye(3), position
    if joint.get("type") == "slide":
        moved = position - reference * axis
    elif reference:
        turned = axis_rotation(axis, np.asarray(-reference))
    return homogeneous(turned, moved), axis, homogeneous(np.eye(3), -position)
