"""Which bodies could meet, and which of them a plan keeps apart: links with each other and with the surroundings."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.errors import ArmidError
from armid.excitation.clearance import Bodies, Clearance, around
from armid.excitation.coal import mesh_points
from armid.excitation.limits import Limits
from armid.maths.spatial import homogeneous, rpy_rotation
from armid.robot.kinematics import forward_kinematics
from armid.robot.robot import Robot
from armid.robot.shapes import Shape, rotation_with_z
from armid.values import Array

__all__ = ["Collision", "collision_of", "load_environment"]

LOOKED = 3000
"""Random poses in which pairs are looked at, to leave out of a search those that never come near each other."""

NEAR = 0.08
"""Distance beyond the margin [m] within which a pair in any of these poses takes part in the search."""

CERTIFICATE = 0.003
"""What a search keeps beyond the margin [m], so that the certificate, which allows for half a step of a millisecond
at the speeds of both bodies, need not draw the plan together."""

NEIGHBOURS = 2
"""Links so many joints apart may touch by construction; further apart they may not."""


@dataclass(frozen=True, eq=False, slots=True)
class Collision:
    """What a plan keeps apart.

    Attributes:
        searched: Pairs that could come near each other, for the search.
        every: All pairs, for the last word.
        skipped: Pairs that touch by construction and are not looked at.
        shapes: The bodies as they are, the surroundings last.
        pairs: Indices into `shapes` of the pairs of `every`, shape (m, 2).
    """

    searched: Clearance | None
    every: Clearance
    skipped: tuple[str, ...]
    shapes: tuple[Shape, ...]
    pairs: NDArray[np.intp]


def collision_of(
    robot: Robot, limits: Limits, start: Array, surroundings: Sequence[Shape] = (), *, margin: float = 0.02
) -> Collision:
    """Pairs of bodies that a plan must keep apart.

    Links next to each other are no pair. Links two joints apart that are closer than the margin in the start pose
    touch by construction, as a ball-shaped shoulder does, and are listed as skipped.

    Args:
        robot: The arm, with shapes.
        limits: Of its joints.
        start: The start pose, shape (n,) [rad or m].
        surroundings: Bodies that do not move.
        margin: Distance that stays between bodies [m].

    Raises:
        ArmidError: No shapes, or bodies too close to each other in the start pose.
    """
    if not robot.shapes:
        raise ArmidError(
            f"The description of {robot.name} does not say what space its links take, so collisions cannot be seen.",
            remedy="give a URDF with <collision> bodies, or a DH table with capsules; or leave out --collision.",
        )
    if not margin >= 0.0:
        raise ArmidError(f"The distance that stays between bodies cannot be negative; found {margin} m.")
    shapes = (*robot.shapes, *surroundings)
    bodies, pairs = _bodies(robot, shapes)
    skipped: list[int] = []
    poses = forward_kinematics(robot, start[None])
    close = bodies.nearest(poses)[0][0] < margin
    for k in np.flatnonzero(close):
        a, b = (shapes[i].link for i in pairs[k])
        on_the_base = pairs[k, 1] >= len(robot.shapes) and a <= 0  # what the arm stands on
        if on_the_base or _joints_between(robot, a, b) <= NEIGHBOURS:
            skipped.append(int(k))
            continue
        distance = float(bodies.nearest(poses)[0][0, k])
        raise ArmidError(
            f"In the start pose {bodies.labels[k]} are {1000 * distance:.0f} mm apart, less than the "
            f"{1000 * margin:.0f} mm that are asked.",
            remedy="choose another start pose with --start, or a smaller --clearance.",
        )
    kept = np.setdiff1d(np.arange(len(pairs)), skipped)
    every = bodies.only(kept)
    near = _near(robot, limits, start, every, margin)
    labels = bodies.labels
    return Collision(
        Clearance("collision", every.only(near), margin + CERTIFICATE) if len(near) else None,
        Clearance("collision", every, margin),
        tuple(labels[k] for k in skipped),
        shapes,
        pairs[kept],
    )


def _bodies(robot: Robot, shapes: Sequence[Shape]) -> tuple[Bodies, NDArray[np.intp]]:
    """Capsules and solids with their pairs, and the pairs as indices into the shapes."""
    capsules: list[Shape] = []
    solids: list[Shape] = []
    place: dict[int, tuple[bool, int]] = {}
    for k, shape in enumerate(shapes):
        if shape.kind in ("box", "half-space") and shape.link < 0:
            place[k] = (True, len(solids))
            solids.append(shape)
        else:
            place[k] = (False, len(capsules))
            capsules.append(around(shape, mesh_points(shape) if shape.kind == "mesh" else None))
    chosen: list[tuple[int, int]] = []
    for a in range(len(shapes)):
        for b in range(a + 1, len(shapes)):
            if _joints_between(robot, shapes[a].link, shapes[b].link) > 1 and not (place[a][0] and place[b][0]):
                chosen.append((b, a) if place[a][0] else (a, b))
    own = [
        [place[i][1] + (len(capsules) if place[i][0] else 0) for i in pair]
        for pair in chosen
    ]  # fmt: skip
    index = np.array(own, dtype=np.intp).reshape(-1, 2)
    return Bodies(tuple(capsules), tuple(solids), index), np.array(chosen, dtype=np.intp).reshape(-1, 2)


def _joints_between(robot: Robot, a: int, b: int) -> int:
    """Joints on the way from one link to another."""
    above_a, above_b = ([*robot.tree.ancestors(k)] if k >= 0 else [] for k in (a, b))
    return len(set(above_a) ^ set(above_b))


def _near(robot: Robot, limits: Limits, start: Array, bodies: Bodies, margin: float) -> NDArray[np.intp]:
    """Pairs that come near each other in any of many random poses."""
    rng = np.random.default_rng(0)
    low = np.where(np.isfinite(limits.lower), limits.lower, start - np.pi)
    high = np.where(np.isfinite(limits.upper), limits.upper, start + np.pi)
    q = rng.uniform(low, high, (LOOKED, robot.n))
    distance = bodies.nearest(forward_kinematics(robot, q))[0]
    return np.flatnonzero(distance.min(axis=0) < margin + NEAR)


ENVIRONMENT = {
    "box": ("name", "size", "xyz", "rpy"),
    "sphere": ("name", "radius", "xyz"),
    "half-space": ("name", "normal", "offset"),
}
"""Tables of an environment, and their keys."""


def load_environment(path: Path | str) -> tuple[Shape, ...]:
    """Bodies that do not move, from a TOML file.

    `[[box]]` has `size` [m], `xyz` of its middle and `rpy`; `[[sphere]]` has `radius` and `xyz`; `[[half-space]]`
    has a `normal` that points out of it and an `offset`, all in the base frame of the arm. Each has a `name`.

    Raises:
        ArmidError: The file is missing or says something else.
    """
    path = Path(path)
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ArmidError(f"{path} is no environment: {error}.", remedy="give a TOML file.") from error
    shapes: list[Shape] = []
    for kind, tables in document.items():
        if kind not in ENVIRONMENT or not isinstance(tables, list):
            raise ArmidError(f"{path}: unknown entry {kind!r}.", possible=", ".join(f"[[{k}]]" for k in ENVIRONMENT))
        for number, table in enumerate(tables, 1):
            unknown = set(table) - set(ENVIRONMENT[kind])
            if unknown:
                raise ArmidError(
                    f"{path}: {kind} {number} has an unknown key {sorted(unknown)[0]!r}.",
                    possible=", ".join(ENVIRONMENT[kind]),
                )
            try:
                shapes.append(_surrounding(kind, number, table))
            except (TypeError, ValueError, KeyError) as error:
                raise ArmidError(f"{path}: {kind} {number} lacks or garbles {error}.") from error
    return tuple(shapes)


def _surrounding(kind: str, number: int, table: dict[str, Any]) -> Shape:
    """One body of an environment."""
    name = str(table.get("name", f"{kind} {number}"))
    if kind == "half-space":
        turned = rotation_with_z(np.array([float(x) for x in table["normal"]]))
        return Shape(name, -1, "half-space", np.zeros(3), homogeneous(turned, float(table["offset"]) * turned[:, 2]))
    turned = rpy_rotation([float(angle) for angle in table.get("rpy", (0.0, 0.0, 0.0))])
    placement = homogeneous(turned, [float(x) for x in table["xyz"]])
    if kind == "box":
        return Shape(name, -1, "box", np.array(table["size"], dtype=np.float64), placement)
    return Shape(name, -1, "sphere", np.array([float(table["radius"])]), placement)
