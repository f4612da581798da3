"""Surroundings of an arm: a given floor, an environment from a file, or an assumed floor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armid.excitation.collision.capsules import box_triangles, covering
from armid.excitation.collision.coal import mesh_faces
from armid.excitation.collision.distances import floor
from armid.excitation.collision.environment import load_environment
from armid.robot.collision_from_visual import missing_bodies
from armid.robot.robot import Robot
from armid.robot.shapes import Shape

UPRIGHT = 0.996
"""An arm counts as standing if the angle between gravity and -z of its base is at most five degrees, that is, if the
cosine of this angle is at least this value."""

STANDS = (-0.05, 0.1)
"""An arm counts as standing if the lowest point of the bodies that are fixed to the base is in this range of heights
above the origin of the base [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class AssumedFloor:
    """Floor that is assumed if the user gives no floor.

    Attributes:
        shape: The floor; `None` if no floor is assumed.
        why: Reason why no floor is assumed; empty if a floor is assumed.
    """

    shape: Shape | None
    why: str = ""


def surroundings_of(options: Mapping[str, Any], robot: Robot) -> tuple[Shape, ...]:
    """Bodies around the arm, made from the values of the options `floor` and `environment` of a command."""
    shapes = () if options["environment"] is None else load_environment(options["environment"], robot)
    return shapes if options["floor"] is None else (*shapes, floor(options["floor"], robot.gravity))


def assumed_floor(robot: Robot, options: Mapping[str, Any]) -> AssumedFloor | None:
    """Assumes a floor through the origin of the base for an arm that stands on it; `None` if a floor is given.

    An arm stands on a floor if gravity points along -z of its base and the lowest of the bodies that are fixed to the
    base is close to the origin. The torso of a humanoid and the carriage of a gantry do not stand on the floor.
    """
    if options["floor"] is not None:
        return None
    if options["no_floor"]:
        return AssumedFloor(None, "--no-floor")
    if options["environment"] is not None:
        return AssumedFloor(None, "the surroundings are given by --environment")
    down = robot.gravity / max(float(np.linalg.norm(robot.gravity)), 1e-12)
    if down[2] > -UPRIGHT:
        return AssumedFloor(None, "gravity does not point along -z of the base")
    if any(shape.kind == "half-space" for shape in robot.shapes):
        return AssumedFloor(None, "the description contains a plane")
    lowest = min((_lowest(shape) for shape in robot.shapes if shape.link < 0), default=None)
    if lowest is None:
        return AssumedFloor(None, "the description has no body that is fixed to the base")
    if not STANDS[0] <= lowest <= STANDS[1]:
        reason = (
            f"the lowest body that is fixed to the base is at {1000.0 * lowest:.0f} mm, not at the height of "
            "the origin of the base"
        )
        return AssumedFloor(None, reason)
    return AssumedFloor(replace(floor(0.0, robot.gravity), name="assumed floor"))


def meshes_are_missing(robot: Robot) -> bool:
    """True if the description names meshes that could not be read."""
    return bool(missing_bodies(robot))


def _lowest(shape: Shape) -> float:
    """Height of the lowest point of a body that is fixed to the base [m]."""
    turn, place = shape.placement[:3, :3], shape.placement[:3, 3]
    if shape.kind in ("mesh", "box"):
        points = mesh_faces(shape)[0] if shape.kind == "mesh" else box_triangles(shape.size).reshape(-1, 3)
        return float((points @ turn[2]).min() + place[2])
    if shape.kind == "cylinder":
        radius, length, _ = shape.size
        across = np.sqrt(max(1.0 - turn[2, 2] ** 2, 0.0))
        return float(place[2] - radius * across - 0.5 * length * abs(turn[2, 2]))
    return min(
        float(each.placement[2, 3] - each.size[0] - 0.5 * each.size[1] * abs(each.placement[2, 2]))
        for each in covering(shape)
    )
