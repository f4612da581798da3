"""Convex bodies that lie closer around bodies than capsules do, and their distances by Coal.

A capsule around a cylinder or a shell sticks out at both ends by its radius, so two of them may overlap in every
pose though the bodies never touch. Such pairs, a few of an arm, are measured here: capsules, spheres, boxes and
half-spaces as they are, a cylinder as a prism around it, a mesh as the convex hulls of its slabs
(`armid.excitation.collision.mesh_hulls`). Coal finds
distance, direction and nearest points of these to rounding, apart or overlapping, so that gradients are exact; of
cylinders themselves it finds them to four digits only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.excitation.collision.coal import distances, geometry, nearest, stamp
from armid.excitation.collision.mesh_hulls import hull_points, outline_of, part_of
from armid.robot.shapes import Kind, Shape
from armid.values import Array

__all__ = ["Hulls", "parts_of", "prism"]

SIDES = 32
"""Of the prism around a cylinder, which is half a percent wider."""


def prism(radius: float, length: float) -> Array:
    """Corners (v, 3) of a prism around a cylinder about z [m]."""
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = radius / np.cos(np.pi / SIDES) * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([np.column_stack([ring, np.full(SIDES, z)]) for z in (-0.5 * length, 0.5 * length)])


def parts_of(shape: Shape) -> tuple[Any, ...]:
    """Convex bodies for Coal, in the frame of a body that lies in them."""
    return _parts_of(shape.kind, tuple(shape.size.tolist()), shape.path, stamp(shape.path))


@lru_cache(maxsize=512)
def _parts_of(kind: Kind, size: tuple[float, float, float], path: str, _stamp: tuple[int, int]) -> tuple[Any, ...]:
    """The same, made once for bodies of one form: a shape that came from another process is a new one."""
    shape = Shape("", -1, kind, np.array(size), np.eye(4), path)
    if kind == "cylinder":
        return (part_of(hull_points(prism(*size[:2]))).solid(),)
    if kind == "mesh":
        return tuple(part.solid() for part in outline_of(shape).parts)
    return (geometry(shape),)


@dataclass(frozen=True, eq=False, slots=True)
class Hulls:
    """Pairs of bodies that are measured by the convex bodies around them.

    Attributes:
        shapes: Bodies.
        pairs: Indices of two of them, shape (r, 2).
        at: Which of some other pairs each stands for, rising, shape (r,).
    """

    shapes: tuple[Shape, ...]
    pairs: NDArray[np.intp]
    at: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.at)

    def distances(self, poses: tuple[Array, Array]) -> Array:
        """Distances (N, r) [m], negative where hulls overlap."""
        return distances(self.shapes, self.pairs, poses, parts_of)

    def nearest(self, poses: tuple[Array, Array]) -> tuple[Array, Array, Array, Array]:
        """Distances (N, r) [m], negative where hulls overlap, nearest points of both and directions from the second.

        Args:
            poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
        """
        return nearest(self.shapes, self.pairs, poses, parts_of)

    def only(self, which: NDArray[np.intp]) -> Hulls:
        """Those that stand for some of the other pairs, which are rising and counted anew."""
        kept = np.isin(self.at, which)
        return Hulls(self.shapes, self.pairs[kept], np.searchsorted(which, self.at[kept]))
