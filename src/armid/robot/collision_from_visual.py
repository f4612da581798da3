"""Use of visual geometry for links without collision geometry.

Each link of the description is examined separately, even if it is fixed to another link. For instance, the visual
geometry of a gripper is used although the wrist that carries it has collision geometry.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from armid.errors import Finding
from armid.robot.collision_body_names import BodyName, link_of
from armid.robot.robot import Robot
from armid.robot.shapes import Shape

LIGHT = 0.01
"""Mass below which a link without geometry counts as a frame, which needs no collision check [kg]."""


def missing_bodies(robot: Robot) -> list[Finding]:
    """Findings about bodies whose files do not exist or whose shapes are of an unknown kind.

    If no link has collision geometry, missing files of visual bodies are included.
    """
    codes = ("mesh-missing", "shape-unknown", *(() if robot.shapes else ("visual-missing",)))
    return [finding for finding in robot.findings if finding.code in codes]


def with_bodies(
    robot: Robot, *, described: Collection[str] = (), markers: Sequence[Shape] = (), world: str = ""
) -> Robot:
    """Robot in which links without collision geometry use their visual geometry; findings about this are added.

    Args:
        robot: The robot, with its collision and visual geometry.
        described: Names of the links that have collision or visual geometry in the description.
        markers: Visual geometry that does not represent a body, such as targets in a scene.
        world: Name of the group of bodies that do not belong to a link. Each body of this group is examined
            separately.
    """
    known = {link_of(shape.name) for shape in robot.shapes} - {world}
    apart = {id(shape) for shape in (*markers, *robot.shapes)}
    same = {_key(shape) for shape in robot.shapes}
    taken = [
        each
        for each in robot.visuals
        if link_of(each.name) not in known
        and id(each) not in apart
        and each.kind != "half-space"
        and _key(each) not in same
    ]
    names = list(dict.fromkeys(link_of(each.name) for each in taken))
    count = sum(link_of(shape.name) == world for shape in robot.shapes)
    taken = [
        replace(each, name=_numbered(each.name, count)) if link_of(each.name) == world else each for each in taken
    ]
    findings: list[Finding] = []
    if names:
        verb, whose = ("has", "its") if len(names) == 1 else ("have", "their")
        evidence = f"{', '.join(names)} {verb} no collision geometry; {whose} visual geometry is used instead"
        findings.append(Finding("bodies-from-visuals", "info", "", evidence))
    if markers:
        listed = ", ".join(dict.fromkeys(each.name for each in markers))
        evidence = f"shapes without contacts are treated as markers, through which the arm may move: {listed}"
        remedy = "if any of them stands for a real body, describe this body in a file and give it with --environment."
        findings.append(Finding("markers-unchecked", "info", "", evidence, remedy))
    shapes = (*robot.shapes, *taken)
    passed = {*(link_of(each.name) for each in (*robot.visuals, *shapes)), world}
    unknown = _unknown(robot, shapes, [name for name in described if name not in passed])
    return replace(robot, shapes=shapes, findings=(*robot.findings, *findings, *unknown))


def _unknown(robot: Robot, shapes: Sequence[Shape], lost: Sequence[str]) -> tuple[Finding, ...]:
    """Finding about links that have no usable geometry; there is no finding for a robot without any shapes.

    Args:
        robot: The robot.
        shapes: All bodies that are checked.
        lost: Names of links whose geometry cannot be read.
    """
    carrying = {shape.link for shape in shapes}
    bare = [
        link.name
        for k, link in enumerate(robot.links)
        if k not in carrying and link.inertial is not None and link.inertial.mass >= LIGHT
    ]
    names = list(dict.fromkeys((*bare, *lost)))
    if not names or not shapes:
        return ()
    evidence = f"these links have no geometry that can be checked for collisions: {', '.join(names)}"
    remedy = "give these links geometry in the description, or its package with --package NAME=DIR."
    return (Finding("bodies-unknown", "warning", "", evidence, remedy),)


def _key(shape: Shape) -> tuple[str, int, str, bytes, bytes]:
    """Key that is equal for two shapes that fill the same space."""
    return shape.kind, shape.link, shape.path, shape.size.tobytes(), shape.placement.tobytes()


def _numbered(name: str, count: int) -> str:
    """Name of a body with its number increased by `count`, the number of bodies that the link already has."""
    return BodyName(name.link, name.number + count) if isinstance(name, BodyName) else name
