"""Convex bodies that enclose bodies more tightly than capsules do, and their distances, computed with Coal.

A capsule around a cylinder or a shell extends beyond both ends by its radius. Two capsules may therefore overlap in
every pose although the bodies never touch. An arm has only a few such pairs. For these pairs this module uses tighter
bodies: capsules, spheres, boxes and half-spaces are exact, a cylinder is enclosed in a prism, an ellipsoid in a
polyhedron, and a mesh in the convex hulls of its slices (`armid.excitation.collision.mesh_hulls`). For these bodies
Coal computes distance, direction and nearest points exactly except for rounding, also if the bodies overlap, so the
gradients are exact. A cylinder is not used itself, because Coal's results for it have only four correct digits, and
neither is an ellipsoid, because it is curved, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.excitation.collision.coal import distances, geometry, nearest, stamp
from armid.excitation.collision.mesh_hulls import hull_points, outline_of, part_of
from armid.robot.shapes import Kind, Shape

SIDES = 32
"""Number of sides of the prism around a cylinder, which is half a percent wider than the cylinder."""


def prism(radius: float, length: float) -> Array:
    """Corners (v, 3) [m] of a prism that encloses a cylinder about the z axis with given radius and length [m]."""
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = radius / np.cos(np.pi / SIDES) * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.vstack([np.column_stack([ring, np.full(SIDES, z)]) for z in (-0.5 * length, 0.5 * length)])


def polyhedron(semi_axes: Array) -> Array:
    """Corners (v, 3) [m] of a polyhedron that encloses an ellipsoid with given semi-axes (3,) [m]."""
    up = np.linspace(-0.5 * np.pi, 0.5 * np.pi, SIDES // 2 + 1)[:, None]
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ball = np.stack([np.cos(up) * np.cos(angle), np.cos(up) * np.sin(angle), np.sin(up) + 0.0 * angle], axis=-1)
    points = ball.reshape(-1, 3)
    inner = -hull_points(points).equations[:, 3].max()  # radius of the sphere inside
    return points / inner * semi_axes


def parts_of(shape: Shape) -> tuple[Any, ...]:
    """Convex Coal geometries that together enclose a body, in the frame of the body."""
    return _parts_of(shape.kind, tuple(shape.size.tolist()), shape.path, stamp(shape.path))


@lru_cache(maxsize=512)
def _parts_of(kind: Kind, size: tuple[float, float, float], path: str, _stamp: tuple[int, int]) -> tuple[Any, ...]:
    """Convex bodies that `parts_of` returns; cached by kind and size, because shapes from other processes are new."""
    shape = Shape("", -1, kind, np.array(size), np.eye(4), path)
    if kind == "cylinder":
        return (part_of(hull_points(prism(*size[:2]))).solid(),)
    if kind == "ellipsoid":
        return (part_of(hull_points(polyhedron(np.array(size)))).solid(),)
    if kind == "mesh":
        return tuple(part.solid() for part in outline_of(shape).parts)
    return (geometry(shape),)


@dataclass(frozen=True, eq=False, slots=True)
class Hulls:
    """Pairs of bodies whose distances are computed with convex bodies around them.

    Attributes:
        shapes: Bodies.
        pairs: Indices of the two bodies of each pair, shape (r, 2).
        at: Index of each pair in the list of all pairs, in ascending order, shape (r,).
    """

    shapes: tuple[Shape, ...]
    pairs: NDArray[np.intp]
    at: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.at)

    def distances(self, poses: tuple[Array, Array]) -> Array:
        """Distances of the convex bodies of r pairs in N poses, shape (N, r) [m]; negative if they overlap."""
        return distances(self.shapes, self.pairs, poses, parts_of)

    def distances_below(self, reach: Array, bound: Array, poses: tuple[Array, Array]) -> Array:
        """Distances of r pairs in N poses, shape (N, r) [m], computed only for pairs that may be close.

        If the lower bound (N, r) of a distance is not less than the `reach` (r,) [m] of the pair, the bound is
        returned.
        """
        result = bound.copy()
        for k, pair in enumerate(self.pairs):
            near = np.flatnonzero(bound[:, k] < reach[k])
            if len(near):
                some = poses[0][near], poses[1][near]
                result[near, k] = distances(self.shapes, pair[None], some, parts_of)[:, 0]
        return result

    def nearest(self, poses: tuple[Array, Array]) -> tuple[Array, Array, Array, Array]:
        """Distances (N, r) [m] of the pairs, nearest points of both bodies, and unit vectors between them.

        Points and vectors have shape (N, r, 3) each. The vectors point from the second to the first body.

        Args:
            poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
        """
        return nearest(self.shapes, self.pairs, poses, parts_of)

    def only(self, which: NDArray[np.intp]) -> Hulls:
        """Hulls of selected pairs, given by ascending indices; the pairs are renumbered in this order."""
        kept = np.isin(self.at, which)
        return Hulls(self.shapes, self.pairs[kept], np.searchsorted(which, self.at[kept]))
