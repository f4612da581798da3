"""Collision geometry from visual geometry, for links without collision geometry."""

from __future__ import annotations

from dataclasses import replace

from armid.errors import Finding
from armid.robot.robot import Robot


def missing_bodies(robot: Robot) -> list[Finding]:
    """Findings about bodies whose files do not exist.

    Visual bodies are included where no link has collision geometry.
    """
    codes = ("mesh-missing",) if robot.shapes else ("mesh-missing", "visual-missing")
    return [finding for finding in robot.findings if finding.code in codes]


def with_bodies(robot: Robot) -> Robot:
    """Robot whose visual geometry replaces missing collision geometry, with a finding about it."""
    known = {shape.link for shape in robot.shapes}
    seen = tuple(each for each in robot.visuals if each.link not in known and each.kind != "half-space")
    if not seen:
        return robot
    names = list(dict.fromkeys(_name(robot, each.link) for each in seen))
    evidence = f"{', '.join(names)} have no collision geometry; their visual geometry is used instead"
    finding = Finding("bodies-from-visuals", "info", "", evidence)
    return replace(robot, shapes=(*robot.shapes, *seen), findings=(*robot.findings, finding))


def _name(robot: Robot, link: int) -> str:
    return "the base" if link < 0 else robot.links[link].name
