"""Reader of MJCF, which first converts it to its plain form; meshes are opened if inertia depends on them.

Bodies with several hinges or slides become a chain of massless links. If a joint has no effort limit, the effort
limit of its actuator is used. The acceleration of gravity is read from the file.
"""

from __future__ import annotations

import hashlib
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace

from armid.errors import Finding, RobotError
from armid.robot.body_tree import robot_from_tree
from armid.robot.collision_from_visual import with_bodies
from armid.robot.joint_selection import JointOutline
from armid.robot.missing_inertia import impossible_inertias, point_masses
from armid.robot.mjcf.joints import joint_names, outline_of
from armid.robot.mjcf.plain_document import Uncomputed, flatten, plain_mjcf
from armid.robot.mjcf.settings import settings_of
from armid.robot.mjcf.shapes import WORLD, carriers_of, shapes_of_mjcf
from armid.robot.mjcf.tree import tree_of_mjcf
from armid.robot.robot import Robot
from armid.robot.xml import check_locked, parse_xml, root_tag

LISTED = 5
"""Number of reasons that one finding names; the others are counted."""


def recognises(text: str) -> bool:
    """Tests whether a text looks like MJCF."""
    return root_tag(text) == "mujoco"


def read(text: str, *, source: str, locked: Mapping[str, float], tip: str | None) -> Robot:
    """Reads the robot of an MJCF text.

    Args:
        text: The MJCF text.
        source: Path of the text. Included files are searched in its folder. The digest depends on them, too, and on
            files of meshes from which inertia is computed.
        locked: Joints to be locked, with positions [rad or m]. Joints with more than one degree of freedom are
            removed here; the others are still joints of the result.
        tip: Name of the body or site that is the flange; if `None`, a body is searched (see `find_tip`).

    Raises:
        RobotError: The text is not an MJCF, or not a tree of joints with one degree of freedom.
    """
    root = _root(text, source)
    included = root.find(".//include") is not None
    root = flatten(root, source)
    check_locked(locked, joint_names(root), source)
    plain = plain_mjcf(root, source, locked)

    tree = tree_of_mjcf(plain)
    carriers = carriers_of(tree)
    still = {body for body, (joint, _) in carriers.items() if not tree.is_moved(joint, locked)}
    unknown = {body: why for body, why in plain.uncomputed.items() if body not in still}
    moving = {body: vector for body, vector in plain.inertias.items() if body not in still}
    faults = (*impossible_inertias(moving), *point_masses(moving))
    shapes, visuals, markers, missing = shapes_of_mjcf(root, plain, carriers)
    robot = robot_from_tree(
        tree,
        name=root.get("model") or "robot",
        limits=plain.limits,
        source=source,
        locked=locked,
        tip=tip,
        gravity=plain.gravity,
        drives=plain.drives,
        findings=(*plain.findings, *faults, *_unknown_inertia(unknown), *missing),
    )
    drawn = dict.fromkeys(body or WORLD for body, _ in plain.geoms)
    robot = with_bodies(replace(robot, shapes=shapes, visuals=visuals), described=drawn, markers=markers, world=WORLD)
    files = [] if plain.meshes is None else plain.meshes.inertia_files()
    if not included and not files:
        return robot
    state = hashlib.sha256(ET.tostring(root) if included else text.encode())
    for path in files:
        state.update(path.read_bytes())
    return replace(robot, sha256=state.hexdigest())


def digest_without_meshes(text: str, *, source: str) -> str:
    """Digest of an MJCF text and its included files alone, which earlier versions stored in a run.

    Args:
        text: The MJCF text.
        source: Path of the text; included files are searched in its folder.

    Raises:
        RobotError: The text is not an MJCF, or an included file cannot be read.
    """
    root = _root(text, source)
    included = root.find(".//include") is not None
    return hashlib.sha256(ET.tostring(flatten(root, source)) if included else text.encode()).hexdigest()


def outline(text: str, *, source: str) -> JointOutline:
    """Joints of an MJCF text, and the joint that moves each body and site.

    Raises:
        RobotError: The text is not an MJCF, or an element has no plain form.
    """
    root = flatten(_root(text, source), source)
    plain = plain_mjcf(root, source, dict.fromkeys(joint_names(root), 0.0))
    drawn = {joint.get("name", ""): float(joint.get("ref", "0")) for joint in plain.root.iter("joint")}
    return outline_of(root, settings_of(root, source), plain.limits, drawn)


def _unknown_inertia(bodies: Mapping[str, Uncomputed]) -> tuple[Finding, ...]:
    """Finding that names the bodies whose inertia is unknown, the reasons, and the masses that their geoms state."""
    if not bodies:
        return ()
    why: dict[str, list[str]] = {}
    for body, each in bodies.items():
        why.setdefault(each.reason, []).append(body)
    told = [f"{', '.join(names)} ({reason})" for reason, names in why.items()]
    more = f"; and {len(told) - LISTED} more" if len(told) > LISTED else ""
    stated = ", ".join(f"{body} {each.mass:.4g} kg" for body, each in bodies.items() if each.mass is not None)
    evidence = (
        "the inertia of these bodies follows from their geoms, but cannot be computed: "
        + "; ".join(told[:LISTED])
        + more
        + (f"; the geoms state masses ({stated}), but without inertias no torque follows from them" if stated else "")
    )  # fmt: skip
    remedy = (
        "put missing files in place, or give these bodies an <inertial>: MuJoCo computes their mass, ipos, iquat and "
        "inertia (body_mass, body_ipos, body_iquat and body_inertia of the loaded model)"
    )
    return (Finding("inertial-missing", "info", ", ".join(bodies), evidence, remedy),)


def _root(text: str, source: str) -> ET.Element:
    """Root element of an MJCF."""
    root = parse_xml(text, source)
    if root.tag != "mujoco":
        raise RobotError(
            f"{source} is not an MJCF: its root is <{root.tag}>, not <mujoco>.",
            remedy="give a robot description, or give the file the suffix of its format.",
        )
    return root
