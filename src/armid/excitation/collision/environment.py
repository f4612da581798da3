"""Surroundings of an arm, read from a TOML file: boxes, spheres and half-spaces, and tools on links."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.errors import ArmidError, did_you_mean
from armid.input_boundary import read_toml
from armid.maths.rotations import homogeneous, rpy_rotation
from armid.robot.robot import Robot
from armid.robot.shapes import Shape, rotation_with_z

ENVIRONMENT = {
    "box": ("name", "link", "size", "xyz", "rpy"),
    "sphere": ("name", "link", "radius", "xyz"),
    "half-space": ("name", "normal", "offset"),
}
"""Tables of an environment file, with the keys of each table."""


def load_environment(path: Path | str, robot: Robot) -> tuple[Shape, ...]:
    """Reads bodies of the surroundings, and bodies that links of the arm carry, from a TOML file.

    `[[box]]` has the keys `size` [m], `xyz` (its centre [m]) and `rpy` (its orientation [rad]). `[[sphere]]` has
    `radius` [m] and `xyz`. `[[half-space]]` has `offset` [m] and `normal`, which points out of the half-space. All
    positions and directions are in the base frame of the arm. Each body can have a `name`. A box or sphere with the
    key `link`, for instance a tool, is carried by this link, and its position and orientation are in the frame of the
    link.

    Args:
        path: The file.
        robot: The arm; its links can carry bodies.

    Raises:
        ArmidError: The file is missing or not a valid environment file.
    """
    path = Path(path)
    document = read_toml(
        path, "an environment", remedy="give a TOML file with tables [[box]], [[sphere]] or [[half-space]]."
    )
    shapes: list[Shape] = []
    for kind, tables in document.items():
        if kind not in ENVIRONMENT or not isinstance(tables, list):
            raise ArmidError(
                f"{path}: unknown entry {kind!r}.",
                possible=", ".join(f"[[{k}]]" for k in ENVIRONMENT),
                remedy="write one of these, with double brackets.",
            )
        for number, table in enumerate(tables, 1):
            if not isinstance(table, dict):
                raise ArmidError(f"{path}: {kind} {number} is not a table.", remedy=f"write [[{kind}]] and its keys.")
            unknown = set(table) - set(ENVIRONMENT[kind])
            if unknown:
                raise ArmidError(
                    f"{path}: {kind} {number} has an unknown key {sorted(unknown)[0]!r}.",
                    possible=", ".join(ENVIRONMENT[kind]),
                    remedy="correct or remove the key.",
                )
            try:
                link = _carrier(robot, f"{path}: {kind} {number}", table.get("link"))
                shapes.append(replace(_surrounding(kind, number, table), link=link))
            except (TypeError, ValueError, KeyError) as error:
                raise ArmidError(
                    f"{path}: in {kind} {number} a key is missing or its value is invalid: {error}.",
                    possible=", ".join(ENVIRONMENT[kind]),
                    remedy="add the key or correct its value; lengths are in metres, angles in radians.",
                ) from error
    return tuple(shapes)


def _carrier(robot: Robot, where: str, name: str | None) -> int:
    """Index of the link with the given name; -1, the base, if no name is given."""
    names = [link.name for link in robot.links]
    if name is None:
        return -1
    if name not in names:
        raise ArmidError(
            f"{where}: {robot.name} has no link {name!r}, so no link can carry this body.",
            possible=", ".join(names),
            remedy=did_you_mean(name, names) or "name one of these links, or leave out `link`.",
        )
    return names.index(name)


def _surrounding(kind: str, number: int, table: dict[str, Any]) -> Shape:
    """Shape that one table of an environment file describes, with link -1 and the placement in the file."""
    name = str(table.get("name", f"{kind} {number}"))
    if kind == "half-space":
        turned = rotation_with_z(np.array([float(x) for x in table["normal"]]))
        return Shape(name, -1, "half-space", np.zeros(3), homogeneous(turned, float(table["offset"]) * turned[:, 2]))
    turned = rpy_rotation([float(angle) for angle in table.get("rpy", (0.0, 0.0, 0.0))])
    placement = homogeneous(turned, [float(x) for x in table["xyz"]])
    if kind == "box":
        return Shape(name, -1, "box", np.array(table["size"], dtype=np.float64), placement)
    return Shape(name, -1, "sphere", np.array([float(table["radius"])]), placement)
