"""Distances by Coal, which comes with Pinocchio: of bodies as they are, meshes by triangles, and of convex ones.

Slower by far than capsules, so bodies as they are have the last word on a plan and no part in the search, and convex
ones (`armid.excitation.hulls`) only where capsules do not do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.errors import ArmidError
from armid.robot.shapes import Shape
from armid.values import Array

__all__ = ["convex", "distances", "geometry", "mesh_faces", "mesh_triangles", "nearest", "too_close", "whole"]


Parts = Callable[[Shape], Sequence[Any]]
"""Bodies for Coal that stand for a body, in its frame."""


def _coal() -> Any:
    return import_module("coal")


@lru_cache(maxsize=64)
def _mesh(path: str, scale: tuple[float, float, float]) -> Any:
    """The triangles of a file.

    Raises:
        ArmidError: Coal cannot read it.
    """
    coal = _coal()
    try:
        return coal.MeshLoader().load(path, np.array(scale))
    except (ValueError, RuntimeError) as error:
        raise ArmidError(
            f"The mesh {path} cannot be read: {error}.", remedy="convert it to STL, DAE or OBJ, or remove it."
        ) from error


def mesh_triangles(shape: Shape) -> Array:
    """Triangles of a mesh in its own frame, shape (t, 3, 3) [m]."""
    corners, faces = mesh_faces(shape)
    return corners[faces]


def mesh_faces(shape: Shape) -> tuple[Array, NDArray[np.intp]]:
    """Corners (v, 3) [m] of a mesh in its own frame, and the three of each triangle, shape (t, 3).

    They go counter-clockwise seen from outside, as in the file, also where the scale mirrors the mesh.
    """
    mesh = _mesh(shape.path, tuple(shape.size.tolist()))
    faces = (mesh.tri_indices(k) for k in range(mesh.num_tris))
    index = np.array([(face[0], face[1], face[2]) for face in faces], dtype=np.intp).reshape(-1, 3)
    index = index[:, ::-1] if np.prod(shape.size) < 0.0 else index
    return np.array(mesh.vertices(), dtype=np.float64).reshape(-1, 3), np.ascontiguousarray(index)


def geometry(shape: Shape) -> Any:
    """The body for Coal, whose primitives lie as ours do."""
    coal = _coal()
    a, b, c = (float(x) for x in shape.size)
    if shape.kind == "mesh":
        return _mesh(shape.path, (a, b, c))
    made = {
        "capsule": lambda: coal.Capsule(a, b),
        "sphere": lambda: coal.Sphere(a),
        "cylinder": lambda: coal.Cylinder(a, b),
        "box": lambda: coal.Box(a, b, c),
        "half-space": lambda: coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0),
    }
    return made[shape.kind]()


def convex(corners: Array, faces: NDArray[np.intp]) -> Any:
    """A convex body for Coal.

    Args:
        corners: Shape (v, 3) [m].
        faces: Three corners of each triangle, counter-clockwise from outside, shape (t, 3).
    """
    coal = _coal()
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in corners:
        points.append(corner)
    for face in faces.tolist():
        triangles.append(coal.Triangle(*face))
    return coal.Convex(points, triangles)


def _placed(shape: Shape, poses: tuple[Array, Array]) -> list[Any]:
    """Where a body is along a motion, with rotations (N, n, 3, 3) and origins (N, n, 3) of the links."""
    transform = _coal().Transform3s
    turn, place = shape.placement[:3, :3], shape.placement[:3, 3]
    R, p = poses
    if shape.link < 0:
        return [transform(turn, place)] * len(p)
    turns, places = R[:, shape.link] @ turn, p[:, shape.link] + R[:, shape.link] @ place
    return list(map(transform, turns, places))


def whole(shape: Shape) -> tuple[Any, ...]:
    """A body as its only part."""
    return (geometry(shape),)


def _measured(
    shapes: Sequence[Shape], parts: Parts, pairs: NDArray[np.intp], poses: tuple[Array, Array]
) -> Iterator[tuple[int, int, float, Any]]:
    """Pair, pose, distance and Coal's result of each two parts of the bodies of each pair in each pose."""
    coal = _coal()
    used = np.unique(pairs).tolist()
    of = {k: parts(shapes[k]) for k in used}
    placed = {k: _placed(shapes[k], poses) for k in used}
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    for m, (a, b) in enumerate(pairs.tolist()):
        for one in of[a]:
            for other in of[b]:
                measure = coal.ComputeDistance(one, other)
                for k, (first, second) in enumerate(zip(placed[a], placed[b], strict=True)):
                    result.clear()
                    yield m, k, measure(first, second, request, result), result


def distances(
    shapes: Sequence[Shape], pairs: NDArray[np.intp], poses: tuple[Array, Array], parts: Parts = whole
) -> Array:
    """Distance of each pair along a motion.

    Args:
        shapes: Bodies.
        pairs: Indices of two bodies each, shape (m, 2).
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
        parts: What is measured in the place of each body, for Coal.

    Returns:
        Shape (N, m) [m]; negative where bodies overlap.
    """
    out = np.full((len(poses[1]), len(pairs)), np.inf)
    for m, k, distance, _ in _measured(shapes, parts, pairs, poses):
        out[k, m] = min(out[k, m], distance)
    return out


def nearest(
    shapes: Sequence[Shape], pairs: NDArray[np.intp], poses: tuple[Array, Array], parts: Parts
) -> tuple[Array, Array, Array, Array]:
    """Distances of bodies along a motion, and where they are nearest.

    Args:
        shapes: Bodies.
        pairs: Indices of two bodies each, shape (m, 2).
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
        parts: Convex parts in the place of each body, for Coal.

    Returns:
        Distances (N, m) [m], negative where parts overlap, nearest points of both and the directions from the second
        body to the first in which they come apart, (N, m, 3).
    """
    shape = (len(poses[1]), len(pairs))
    out = np.full(shape, np.inf)
    first, second, normal = (np.zeros((*shape, 3)) for _ in range(3))
    for m, k, distance, result in _measured(shapes, parts, pairs, poses):
        if distance < out[k, m]:
            out[k, m] = distance
            first[k, m], second[k, m] = result.getNearestPoint1(), result.getNearestPoint2()
            normal[k, m] = -result.normal
    return out, first, second, normal


def too_close(
    shapes: Sequence[Shape], pair: NDArray[np.intp], margin: float, poses: tuple[Array, Array]
) -> NDArray[np.bool_]:
    """Whether two bodies as they are come closer than a margin [m], pose by pose, which is less work than a distance.

    Args:
        shapes: Bodies.
        pair: Indices of two, shape (2,).
        margin: The distance [m].
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.

    Returns:
        Shape (N,).
    """
    coal = _coal()
    one, other = (shapes[int(k)] for k in pair)
    bodies = geometry(one), geometry(other)
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.security_margin = margin

    def close(first: Any, second: Any) -> bool:
        result.clear()
        return coal.collide(bodies[0], first, bodies[1], second, request, result) > 0

    places = zip(_placed(one, poses), _placed(other, poses), strict=True)
    return np.array([close(first, second) for first, second in places], dtype=np.bool_)
