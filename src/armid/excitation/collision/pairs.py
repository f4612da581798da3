"""Pairs of bodies that can collide: links of the arm with each other and with the surroundings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armid.excitation.collision.distances import CollisionBodies
from armid.excitation.collision.mesh_hulls import capsules_of
from armid.robot.robot import Robot
from armid.robot.shapes import Shape


def pairs_of_bodies(robot: Robot, shapes: Sequence[Shape]) -> tuple[CollisionBodies, NDArray[np.intp]]:
    """Bounding volumes of all pairs of bodies that can collide, and the indices (m, 2) of each pair into `shapes`.

    Pairs of adjacent links are not included (`armid.excitation.collision.adjacent_link_collisions`).
    """
    chosen: list[tuple[int, int]] = []
    for a in range(len(shapes)):
        for b in range(a + 1, len(shapes)):
            nearest = 1 if stands(robot, shapes, b) else 2
            if joints_between(robot, shapes[a].link, shapes[b].link) >= nearest:
                chosen.append((a, b))
    return bounding_volumes(shapes, chosen)


def bounding_volumes(
    shapes: Sequence[Shape], chosen: Sequence[tuple[int, int]]
) -> tuple[CollisionBodies, NDArray[np.intp]]:
    """Bounding volumes of chosen pairs of bodies, and the indices (m, 2) of the two bodies of each pair.

    Pairs of two solids of the surroundings are left out.
    """
    solid = [shape.kind in ("box", "half-space") and shape.link < 0 for shape in shapes]
    capsules: list[Shape] = []
    solids = [shape for shape, apart in zip(shapes, solid, strict=True) if apart]
    places: list[list[int]] = []
    for shape, apart in zip(shapes, solid, strict=True):
        made = () if apart else capsules_of(shape)
        places.append(list(range(len(capsules), len(capsules) + len(made))))
        capsules += made
    for number, k in enumerate(np.flatnonzero(solid)):
        places[k] = [len(capsules) + number]
    pairs = [(b, a) if solid[a] else (a, b) for a, b in chosen if not (solid[a] and solid[b])]
    own = [(i, j, group) for group, (a, b) in enumerate(pairs) for i in places[a] for j in places[b]]
    index = np.array(own, dtype=np.intp).reshape(-1, 3)
    bodies = CollisionBodies(tuple(capsules), tuple(solids), index[:, :2], index[:, 2])
    return bodies, np.array(pairs, dtype=np.intp).reshape(-1, 2)


def stands(robot: Robot, shapes: Sequence[Shape], k: int) -> bool:
    """Checks whether body k is a part of the surroundings that no link of the arm carries."""
    return k >= len(robot.shapes) and shapes[k].link < 0


def joints_between(robot: Robot, a: int, b: int) -> int:
    """Number of joints on the path between two links, given by their indices; -1 is the base."""
    return len(joints_on_path(robot, a, b))


def joints_on_path(robot: Robot, a: int, b: int) -> list[int]:
    """Indices of the joints on the path between two links, in ascending order; the link -1 is the base."""
    above_a, above_b = ([*robot.tree.ancestors(k)] if k >= 0 else [] for k in (a, b))
    return sorted(set(above_a) ^ set(above_b))
