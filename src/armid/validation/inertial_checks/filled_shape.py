"""Convex hull of a body's shapes, and the mass distribution of the hull if its density is constant.

Meshes of published descriptions are often open, or consist of parts that overlap or contain each other, so the volume
of the meshes is not defined. The volume of the hull is always defined, and the hull contains all shapes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.excitation.collision.coal import mesh_faces
from armid.robot.described_bodies.body import DescribedBody
from armid.robot.mjcf.mesh_reading import UncomputableError, read_mesh
from armid.robot.shapes import Shape

ROUND = 32
"""Number of corners of the polygon that replaces a circle; its area is 0.6 % smaller than that of the circle."""

DIRECT = (".stl", ".obj", ".msh")
"""Suffixes of mesh files that are read without the library Coal, which is slower."""


@dataclass(frozen=True, eq=False, slots=True)
class FilledShape:
    """Convex hull of the shapes of a body, in the frame of the body.

    Attributes:
        corners: Corners of the hull, shape (v, 3) [m].
        planes: Unit normals and offsets of the f faces, shape (f, 4); normal · p + offset [m] is negative for a point
            p inside the hull.
        volume: Volume of the hull [m³].
        centroid: Centre of the volume, shape (3,) [m].
        second_moment: Mean of (p - centroid)(p - centroid)ᵀ over the volume, shape (3, 3) [m²].
    """

    corners: Array
    planes: Array
    volume: float
    centroid: Array
    second_moment: Array

    @property
    def extent(self) -> float:
        """Length of the diagonal of the box around the hull [m]."""
        return float(np.linalg.norm(np.ptp(self.corners, axis=0)))


def filled_shape(body: DescribedBody) -> tuple[FilledShape | None, tuple[str, ...]]:
    """Convex hull of all shapes of a body, and the mesh files that cannot be read.

    The hull is `None` if no shape can be read, or if the shapes lie in a plane.

    Args:
        body: The body with its visual and collision shapes.
    """
    points: list[Array] = []
    unread: list[str] = []
    for shape in body.shapes:
        try:
            own = corners_of(shape)
        except ArmidError:
            unread.append(shape.path)
            continue
        points.append(own @ shape.placement[:3, :3].T + shape.placement[:3, 3])
    made = hull_of(points) if points else None
    return made, tuple(dict.fromkeys((*body.missing, *unread)))


def corners_of(shape: Shape) -> Array:
    """Points whose convex hull is the hull of a shape, in the frame of the shape, shape (v, 3) [m].

    Circles are replaced by polygons.

    Raises:
        ArmidError: The file of a mesh cannot be read.
    """
    a, b, c = (float(x) for x in shape.size)
    if shape.kind == "mesh":
        return _mesh_corners(shape)
    if shape.kind == "box":
        return 0.5 * np.array([[x * a, y * b, z * c] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    turn = 2.0 * math.pi * np.arange(ROUND) / ROUND
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    if shape.kind == "cylinder":
        ring = a * circle
        return np.array([[x, y, z] for z in (-0.5 * b, 0.5 * b) for x, y in ring])
    length = b if shape.kind == "capsule" else 0.0
    rise = np.linspace(-0.5 * math.pi, 0.5 * math.pi, ROUND // 2 + 1)
    rings = [
        np.column_stack([a * math.cos(up) * circle, np.full(ROUND, a * math.sin(up) + half)])
        for half, part in ((-0.5 * length, rise[rise <= 0.0]), (0.5 * length, rise[rise >= 0.0]))
        for up in part
    ]
    corners = np.concatenate(rings)
    return corners / a * shape.size if shape.kind == "ellipsoid" else corners


def _mesh_corners(shape: Shape) -> Array:
    """Vertices of a mesh, shape (v, 3) [m]; formats in `DIRECT` are read directly, and all others by Coal."""
    suffix = Path(shape.path).suffix.lower()
    if suffix in DIRECT:
        try:
            return read_mesh(Path(shape.path), suffix)[0] * shape.size
        except UncomputableError:  # an STL in text form
            if suffix == ".msh":
                raise
    return mesh_faces(shape)[0]


def hull_of(points: Sequence[Array]) -> FilledShape | None:
    """Convex hull of the points (v, 3) [m] of several shapes; `None` if all points lie in a plane."""
    try:
        hull = ConvexHull(np.unique(np.concatenate(points), axis=0))
    except (QhullError, ValueError):
        return None
    corners = hull.points[hull.vertices]
    middle = corners.mean(axis=0)
    tips = hull.points[hull.simplices] - middle  # tetrahedra from a point inside
    volumes = np.abs(np.linalg.det(tips)) / 6.0
    total = float(volumes.sum())
    if not total > 0.0:
        return None
    sums = tips.sum(axis=1)
    centroid = (volumes @ sums) / (4.0 * total)
    # ∫ p pᵀ over a tetrahedron with one corner at zero is V/20 (Σ a aᵀ + s sᵀ), with s the sum of the corners a.
    about = np.einsum("t,tki,tkj->ij", volumes, tips, tips) + np.einsum("t,ti,tj->ij", volumes, sums, sums)
    second = about / (20.0 * total) - np.outer(centroid, centroid)
    return FilledShape(corners, hull.equations, total, middle + centroid, second)
