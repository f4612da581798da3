"""Bounding volumes of a mesh: capsules, and simplified convex hulls of its slices.

The bounding volumes are computed once for each content of a file and each scale, and stored in the user's cache
folder (`armid.excitation.collision.cache`). A hull with many corners is simplified: it is replaced by the hull of
some of its corners, which is then enlarged in all directions by the largest distance of any other corner, at most
half a millimetre. The mesh therefore lies inside the simplified hull.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from armid.checked_array import Array
from armid.excitation.collision.cache import Arrays, read_entry, write_entry
from armid.excitation.collision.capsules import Points, around, covering, cuts_of, smallest, volume_of
from armid.excitation.collision.coal import apart, convex, mesh_faces, stamp, version
from armid.robot.shapes import Shape

FORMAT = 2
"""Version of the entries in the cache folder; it is increased if the computation of the bounding volumes changes."""

ENOUGH = 64
"""Largest number of corners of a hull that is not simplified."""

LIGHT = 5e-4
"""Largest distance by which a simplified hull is enlarged in all directions, so that it contains the mesh [m]."""

CLOSE = 0.8
"""Largest distance of a corner of the mesh from the plane of a face of the simplified hull, outside the hull, divided
by `LIGHT`. Where faces meet, the distance of a corner from the hull is larger than its distance from the planes."""

FURTHEST = 0.6
"""Smallest distance of a corner of the mesh from a simplified hull, divided by the largest such distance, with which
the corner is added to the hull."""

SOLVER = 1e-6
"""Error with which Coal computes the distance of a corner from a hull [m]."""

THIN = 1e-5
"""Half the thickness [m] that is given to a flat part of a mesh."""

WHOLE = (".stl", ".obj", ".dae", ".ply", ".glb", ".off")
"""Suffixes of mesh files that refer to no other files, so that the content of the file identifies the mesh."""

FIRST = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], dtype=float)
"""Directions in which a simplified hull always extends as far as the mesh, shape (26, 3)."""


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """Convex body that encloses a part of a mesh.

    Attributes:
        corners: Corners of the body, shape (v, 3) [m].
        faces: Indices of the three corners of each triangle, counter-clockwise from outside, shape (t, 3).
        beyond: Distance by which the body is enlarged in all directions [m].
    """

    corners: Array
    faces: NDArray[np.intp]
    beyond: float = 0.0

    def solid(self) -> Any:
        """Coal geometry of the body."""
        return convex(self.corners, self.faces, self.beyond)


@dataclass(frozen=True, eq=False, slots=True)
class MeshOutline:
    """Bounding volumes of a mesh, in the frame of the mesh.

    Attributes:
        capsules: Capsules that together contain the mesh.
        parts: Convex bodies that together contain the mesh, more tightly than the capsules.
    """

    capsules: tuple[Shape, ...]
    parts: tuple[Part, ...]


def capsules_of(shape: Shape) -> tuple[Shape, ...]:
    """Capsules that together enclose a body, with its name and link; a capsule is returned unchanged."""
    if shape.kind != "mesh":
        return covering(shape)
    return tuple(
        Shape(shape.name, shape.link, "capsule", each.size, shape.placement @ each.placement)
        for each in outline_of(shape).capsules
    )


def outline_of(shape: Shape) -> MeshOutline:
    """Bounding volumes of a mesh, read from the cache folder if they are stored there.

    Raises:
        ArmidError: The file of the mesh cannot be read.
    """
    a, b, c = shape.size.tolist()
    return _outline(shape.path, (a, b, c), stamp(shape.path))


@lru_cache(maxsize=256)
def _outline(path: str, scale: tuple[float, float, float], _stamp: tuple[int, int]) -> MeshOutline:
    name = _name(path, scale)
    found = _read(read_entry(name)) if name else None
    if found is None:
        found = _made(*mesh_faces(Shape("", -1, "mesh", np.array(scale), np.eye(4), path)))
        if name:
            write_entry(name, _written(found))
    return found


def _name(path: str, scale: tuple[float, float, float]) -> str:
    """Name of the cache entry of a mesh; empty if the mesh depends on other files or cannot be read."""
    if Path(path).suffix.lower() not in WHOLE:
        return ""
    try:
        content = Path(path).read_bytes()
    except OSError:
        return ""
    about = f"{FORMAT} {version()} {ENOUGH} {LIGHT} {scale} {Path(path).suffix.lower()}\n"
    return f"mesh-{hashlib.sha256(about.encode() + content).hexdigest()[:40]}"


def _written(outline: MeshOutline) -> Arrays:
    """Converts bounding volumes to arrays for the cache."""
    arrays = {
        "sizes": np.array([each.size for each in outline.capsules]),
        "placements": np.array([each.placement for each in outline.capsules]),
        "beyond": np.array([part.beyond for part in outline.parts]),
    }
    for k, part in enumerate(outline.parts):
        arrays |= {f"corners{k}": part.corners, f"faces{k}": part.faces}
    return arrays


def _read(arrays: Arrays | None) -> MeshOutline | None:
    """Converts arrays of the cache to bounding volumes; `None` if they are invalid."""
    if arrays is None:
        return None
    try:
        sizes, placements = (np.asarray(arrays[key], dtype=np.float64) for key in ("sizes", "placements"))
        pairs = zip(sizes, placements, strict=True)
        capsules = tuple(Shape("", -1, "capsule", size, placement) for size, placement in pairs)
        parts = tuple(
            Part(
                np.asarray(arrays[f"corners{k}"], dtype=np.float64).reshape(-1, 3),
                np.asarray(arrays[f"faces{k}"], dtype=np.intp).reshape(-1, 3),
                beyond,
            )
            for k, beyond in enumerate(np.asarray(arrays["beyond"], dtype=np.float64).tolist())
        )
    except (KeyError, ValueError, TypeError):
        return None
    return MeshOutline(capsules, parts) if capsules and parts else None


def _made(corners: Array, faces: NDArray[np.intp]) -> MeshOutline:
    """Computes the bounding volumes of a mesh from its corners (v, 3) [m] and triangles (t, 3) of corner indices."""
    cuts = cuts_of(corners, faces)
    hulls: dict[int, ConvexHull] = {}

    def hull(part: Points) -> ConvexHull:
        if id(part) not in hulls:
            hulls[id(part)] = hull_points(part.at)
        return hulls[id(part)]

    def capsule(part: Points) -> Shape:
        return around("", part, hull(part).points[hull(part).vertices])

    hollow = smallest(cuts, hull, lambda made: float(made.volume))
    return MeshOutline(smallest(cuts, capsule, volume_of), tuple(map(lightened, hollow)))


def hull_points(points: Array) -> ConvexHull:
    """Convex hull of points (v, 3) [m]; if the points lie in a plane, the hull is given a small thickness."""
    try:
        return ConvexHull(points)
    except QhullError:
        thick = THIN * np.vstack([np.eye(3), -np.eye(3)])
        return ConvexHull((points[:, None] + thick).reshape(-1, 3))


def lightened(hull: ConvexHull) -> Part:
    """Simplified convex body that encloses a hull.

    Corners furthest outside the hull of the selected corners are added, until no corner is outside by more than
    `LIGHT`. The body is then enlarged in all directions by the largest remaining distance.
    """
    points = hull.points[hull.vertices]
    if len(points) <= ENOUGH:
        return part_of(hull)
    taken = np.unique((points @ FIRST.T).argmax(axis=0))
    while True:
        some = hull_points(points[taken])
        outside = points @ some.equations[:, :3].T + some.equations[:, 3]
        far = outside.max(axis=0)
        more = np.setdiff1d(outside.argmax(axis=0)[far > max(CLOSE * LIGHT, FURTHEST * far.max())], taken)
        if not len(more):
            part = part_of(some)
            which = np.flatnonzero(outside.max(axis=1) > 0.0)
            solid = part.solid()
            away = apart(solid, points[which])
            more = which[away > LIGHT - SOLVER]
            if not len(more):
                return Part(part.corners, part.faces, max(float(away.max(initial=0.0)), 0.0) + SOLVER)
        taken = np.union1d(taken, more)


def part_of(hull: ConvexHull) -> Part:
    """Converts a hull to a `Part` with all of its corners."""
    place = np.full(len(hull.points), -1)
    place[hull.vertices] = np.arange(len(hull.vertices))
    corners = hull.points[hull.simplices]
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = (outwards * hull.equations[:, :3]).sum(axis=1) < 0.0
    faces = place[np.where(inwards[:, None], hull.simplices[:, ::-1], hull.simplices)]
    return Part(hull.points[hull.vertices], faces)
