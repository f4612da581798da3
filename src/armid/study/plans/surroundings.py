"""Surroundings that an arm keeps away from: a floor, a cell from a file, and the floor that is assumed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armid.excitation.collision.capsules import box_triangles, covering
from armid.excitation.collision.coal import mesh_faces
from armid.excitation.collision.distances import floor
from armid.excitation.collision.environment import load_environment
from armid.robot.robot import Robot
from armid.robot.shapes import Shape
from armid.robot.visual_bodies import missing_bodies

__all__ = ["AssumedFloor", "assumed_floor", "meshes_are_missing", "surroundings_of"]

UPRIGHT = 0.996
"""Cosine of the angle, five degrees, that gravity may be off -z of the base of an arm that stands."""

STANDS = (-0.05, 0.1)
"""Height [m] of the lowest point of what is fixed to the base, over its origin, of an arm that stands there."""


@dataclass(frozen=True, eq=False, slots=True)
class AssumedFloor:
    """A floor where nobody says whether there is one.

    Attributes:
        shape: The floor; nothing where none is assumed.
        why: Why none is; empty where one is.
    """

    shape: Shape | None
    why: str = ""


def surroundings_of(options: Mapping[str, Any], robot: Robot) -> tuple[Shape, ...]:
    """Floor and environment of the options of a command."""
    shapes = () if options["environment"] is None else load_environment(options["environment"], robot)
    return shapes if options["floor"] is None else (*shapes, floor(options["floor"], robot.gravity))


def assumed_floor(robot: Robot, options: Mapping[str, Any]) -> AssumedFloor | None:
    """The plane through the base's origin, for an arm that stands on it; nothing where a floor is given.

    An arm stands there if gravity points along -z of its base and what is fixed to the base reaches down to about
    the origin and no further. A humanoid's torso does not, nor the carriage of a gantry.
    """
    if options["floor"] is not None:
        return None
    if options["no_floor"]:
        return AssumedFloor(None, "--no-floor")
    if options["environment"] is not None:
        return AssumedFloor(None, "--environment says what stands around")
    down = robot.gravity / max(float(np.linalg.norm(robot.gravity)), 1e-12)
    if down[2] > -UPRIGHT:
        return AssumedFloor(None, "gravity does not point along -z of the base")
    if any(shape.kind == "half-space" for shape in robot.shapes):
        return AssumedFloor(None, "the description has a plane of its own")
    lowest = min((_lowest(shape) for shape in robot.shapes if shape.link < 0), default=None)
    if lowest is None:
        return AssumedFloor(None, "the description has no body that is fixed to the base")
    if not STANDS[0] <= lowest <= STANDS[1]:
        said = f"what is fixed to the base reaches down to {1000.0 * lowest:.0f} mm and does not stand on its origin"
        return AssumedFloor(None, said)
    return AssumedFloor(replace(floor(0.0, robot.gravity), name="assumed floor"))


def meshes_are_missing(robot: Robot) -> bool:
    """Tell whether the description has bodies that could not be read."""
    return bool(missing_bodies(robot))


def _lowest(shape: Shape) -> float:
    """Height of the lowest point of a body that the base carries [m]."""
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
