"""Tree of bodies of a URDF: links, joints and inertias.

The children of a link are ordered by the names of their joints, as in the parser of ROS (urdfdom), so the order of
joints does not depend on the order of elements in the file.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Iterable, Mapping

import numpy as np

from armid.checked_array import Array
from armid.errors import RobotError, did_you_mean
from armid.maths.inertia import com_inertia_to_vector
from armid.maths.rotations import homogeneous, rpy_rotation
from armid.robot.body_tree import BodyTree
from armid.robot.xml import numbers

INERTIA_KEYS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
"""Attributes of <inertia>: the upper triangle of the matrix, row by row."""


def tree_of_urdf(root: ET.Element, source: str) -> BodyTree:
    """Tree of bodies of a URDF whose joints are revolute, continuous, prismatic or fixed.

    Args:
        root: The document.
        source: Path of the document, for messages.

    Raises:
        RobotError: Links and joints do not form a tree, or an element is missing or is not made of numbers.
    """
    links = {_name(link, "link", source): link for link in root.findall("link")}
    if not links:
        raise RobotError(f"{source} contains no link.", remedy="give a description with links and joints.")
    _check_unique((link.get("name", "") for link in root.findall("link")), "link", source)
    below = _joints_below(root, links, source)
    tree = BodyTree()
    reached = {start: tree.add_frame(-1, start, "body", np.eye(4)) for start in [_root_link(links, below, source)]}
    waiting = list(reversed(below[next(iter(reached))]))
    while waiting:
        joint = waiting.pop()
        name, child = joint.get("name", ""), _end(joint, "child")
        pose = pose_of(joint, f"joint {name!r}", source)
        carrier = reached[_end(joint, "parent")]
        if joint.get("type") == "fixed":
            frame = tree.add_frame(carrier, name, "fixed", pose)
        else:
            axis = axis_of(joint, source)
            frame = tree.add_joint(carrier, name, pose, axis, is_prismatic=joint.get("type") == "prismatic")
        reached[child] = tree.add_frame(frame, child, "body", np.eye(4))
        inertial = inertial_of(links[child], source)
        if inertial is not None:
            tree.add_inertia(reached[child], inertial)
        waiting.extend(reversed(below[child]))
    inertial_of(links[next(iter(reached))], source)  # only its form is checked, because the base does not move
    return tree


def moving_inertias(root: ET.Element, tree: BodyTree, locked: Collection[str], source: str) -> dict[str, Array]:
    """Inertial parameters (10,) of the links that move, in their own frames, by name.

    Args:
        root: The document.
        tree: Tree of its bodies.
        locked: Names of the joints that are locked.
        source: Path of the document, for messages.
    """
    moved = {frame.name for _, frame in tree.bodies() if tree.is_moved(frame.joint, locked)}
    links = {link.get("name", ""): link for link in root.findall("link")}
    found = {name: inertial_of(link, source) for name, link in links.items() if name in moved}
    return {name: vector for name, vector in found.items() if vector is not None}


def pose_of(element: ET.Element, where: str, source: str) -> Array:
    """Transform (4, 4) in the tag <origin> of an element; the identity if there is none.

    Args:
        element: The element.
        where: Name of the element, for messages.
        source: Path of the document, for messages.

    Raises:
        RobotError: An attribute does not contain three numbers.
    """
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    xyz = numbers(origin, "xyz", 3, source, f"the origin of {where}") or [0.0] * 3
    rpy = numbers(origin, "rpy", 3, source, f"the origin of {where}") or [0.0] * 3
    return homogeneous(rpy_rotation(rpy), xyz)


def axis_of(joint: ET.Element, source: str) -> Array:
    """Direction (3,) of the axis of a joint; the x axis if none is given."""
    axis = joint.find("axis")
    given = None if axis is None else numbers(axis, "xyz", 3, source, f"the axis of joint {joint.get('name', '')!r}")
    return np.array(given or [1.0, 0.0, 0.0])


def _joints_below(root: ET.Element, links: Mapping[str, ET.Element], source: str) -> dict[str, list[ET.Element]]:
    """Joints that each link carries, by the name of the link, in the order of the names of the joints.

    Raises:
        RobotError: A joint has no name, the name of another one, or no existing parent and child; or two joints move
            the same link.
    """
    below: dict[str, list[ET.Element]] = {name: [] for name in links}
    moved_by: dict[str, str] = {}
    joints = {_name(joint, "joint", source): joint for joint in root.findall("joint")}
    _check_unique((joint.get("name", "") for joint in root.findall("joint")), "joint", source)
    for name, joint in sorted(joints.items()):
        for role in ("parent", "child"):
            link = _end(joint, role)
            if not link:
                raise RobotError(
                    f"{source}: joint {name!r} has no {role} link.",
                    remedy=f'add <{role} link="…"/> with the name of a link.',
                )
            if link not in links:
                raise RobotError(
                    f"{source}: the {role} link {link!r} of joint {name!r} does not exist.",
                    possible=", ".join(links),
                    remedy=did_you_mean(link, links) or "correct the name, or add the link.",
                )
        child = _end(joint, "child")
        if child in moved_by:
            raise RobotError(
                f"{source}: link {child!r} is the child of two joints, {moved_by[child]!r} and {name!r}.",
                possible="open chains and trees",
                remedy="remove one of the joints.",
            )
        moved_by[child] = name
        below[_end(joint, "parent")].append(joint)
    return below


def _root_link(links: Mapping[str, ET.Element], below: Mapping[str, list[ET.Element]], source: str) -> str:
    """Name of the only link that no joint moves.

    Raises:
        RobotError: There are several such links, or none, or not all links are connected with this one.
    """
    children = {_end(joint, "child") for joints in below.values() for joint in joints}
    roots = [name for name in links if name not in children]
    if len(roots) > 1:
        raise RobotError(
            f"{source} has several root links, which no joint moves: {', '.join(roots)}.",
            remedy="connect them by fixed joints, or remove the links that do not belong to the arm.",
        )
    reached, waiting = set[str](), list(roots)
    while waiting:
        link = waiting.pop()
        reached.add(link)
        waiting += [_end(joint, "child") for joint in below[link]]
    loop = [name for name in links if name not in reached]
    if loop:
        raise RobotError(
            f"{source}: the joints of these links form a loop: {', '.join(loop)}.",
            possible="open chains and trees",
            remedy="correct the parent or child of one of their joints.",
        )
    return roots[0]


def inertial_of(link: ET.Element, source: str) -> Array | None:
    """Inertial parameters (10,) of a link in its own frame; `None` without the tag <inertial>.

    Raises:
        RobotError: A part of the tag is missing or is not a number.
    """
    inertial, where = link.find("inertial"), f"link {link.get('name', '')!r}"
    if inertial is None:
        return None
    mass = _required(inertial, "mass", ("value",), where, source)
    xx, xy, xz, yy, yz, zz = _required(inertial, "inertia", INERTIA_KEYS, where, source)
    pose = pose_of(inertial, f"the inertial of {where}", source)
    turned = pose[:3, :3] @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ pose[:3, :3].T
    return com_inertia_to_vector(mass[0], pose[:3, 3], turned)


def _required(inertial: ET.Element, tag: str, keys: Iterable[str], where: str, source: str) -> list[float]:
    """Values of all given attributes of an element inside <inertial>."""
    element = inertial.find(tag)
    if element is None:
        raise RobotError(
            f"{source}: the inertial of {where} has no <{tag}>.",
            remedy=f"add <{tag}> with its values, or remove <inertial> if they are not known.",
        )
    values: list[float] = []
    for key in keys:
        value = numbers(element, key, 1, source, f"the {tag} of {where}")
        if value is None:
            raise RobotError(
                f"{source}: the {tag} of {where} has no attribute {key}.", remedy=f"add the attribute {key}."
            )
        values += value
    return values


def _name(element: ET.Element, kind: str, source: str) -> str:
    """Name of a link or joint.

    Raises:
        RobotError: The element has no name.
    """
    name = element.get("name", "")
    if not name:
        raise RobotError(f"{source} contains a {kind} without a name.", remedy=f"give each {kind} its own name.")
    return name


def _check_unique(names: Iterable[str], kind: str, source: str) -> None:
    """Raises an error if a name occurs twice."""
    twice = [name for name, times in Counter(names).items() if times > 1]
    if twice:
        raise RobotError(
            f"{source} has two {kind}s with the name {', '.join(map(repr, twice))}.",
            remedy=f"give each {kind} its own name.",
        )


def _end(joint: ET.Element, role: str) -> str:
    """Name of the `parent` or `child` link of a joint; empty if there is none."""
    element = joint.find(role)
    return "" if element is None else element.get("link", "")
