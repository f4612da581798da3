"""Distances by Coal, which comes with Pinocchio: of bodies as they are, meshes by triangles, and of convex ones.

Slower by far than capsules, so bodies as they are have the last word on a plan and no part in the search, and convex
ones (`armid.excitation.hulls`) only where capsules do not do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.errors import ArmidError
from armid.robot.shapes import Shape
from armid.values import Array

__all__ = ["between", "convex", "distances", "geometry", "mesh_faces", "mesh_triangles", "nearest"]


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
    """Corners (v, 3) [m] of a mesh in its own frame, and the three of each triangle, shape (t, 3)."""
    mesh = _mesh(shape.path, tuple(shape.size.tolist()))
    faces = (mesh.tri_indices(k) for k in range(mesh.num_tris))
    index = np.array([(face[0], face[1], face[2]) for face in faces], dtype=np.intp).reshape(-1, 3)
    return np.array(mesh.vertices(), dtype=np.float64).reshape(-1, 3), index


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


def _placed(shape: Shape, pose: tuple[Array, Array]) -> Any:
    """Where a body is, with rotations (n, 3, 3) and origins (n, 3) of the links."""
    turn, place = shape.placement[:3, :3], shape.placement[:3, 3]
    if shape.link >= 0:
        turn, place = pose[0][shape.link] @ turn, pose[1][shape.link] + pose[0][shape.link] @ place
    return _coal().Transform3s(turn, place)


def distances(shapes: Sequence[Shape], pairs: NDArray[np.intp], poses: tuple[Array, Array]) -> Array:
    """Distance of each pair along a motion.

    Args:
        shapes: Bodies.
        pairs: Indices of two bodies each, shape (m, 2).
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.

    Returns:
        Shape (N, m) [m]; negative where bodies overlap.
    """
    coal = _coal()
    bodies = {k: geometry(shapes[k]) for k in np.unique(pairs).tolist()}
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    out = np.empty((len(poses[1]), len(pairs)))
    for k, pose in enumerate(zip(*poses, strict=True)):
        placed = {each: _placed(shapes[each], pose) for each in bodies}
        for m, (a, b) in enumerate(pairs.tolist()):
            result.clear()
            out[k, m] = coal.distance(bodies[a], placed[a], bodies[b], placed[b], request, result)
    return out


def nearest(
    shapes: Sequence[Shape],
    parts: Callable[[Shape], Sequence[Any]],
    pairs: NDArray[np.intp],
    poses: tuple[Array, Array],
) -> tuple[Array, Array, Array, Array]:
    """Distances of bodies of convex parts along a motion, and where they are nearest.

    Args:
        shapes: Bodies.
        parts: The convex parts of each, for Coal.
        pairs: Indices of two bodies each, shape (m, 2).
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.

    Returns:
        Distances (N, m) [m], negative where parts overlap, nearest points of both and the directions from the second
        body to the first in which they come apart, (N, m, 3).
    """
    coal = _coal()
    used = np.unique(pairs).tolist()
    of = {k: parts(shapes[k]) for k in used}
    both = [
        (m, a, b, coal.ComputeDistance(one, other))
        for m, (a, b) in enumerate(pairs.tolist())
        for one in of[a]
        for other in of[b]
    ]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    shape = (len(poses[1]), len(pairs))
    distance = np.full(shape, np.inf)
    first, second, normal = (np.zeros((*shape, 3)) for _ in range(3))
    for k, pose in enumerate(zip(*poses, strict=True)):
        placed = {each: _placed(shapes[each], pose) for each in used}
        for m, a, b, measure in both:
            result.clear()
            found = measure(placed[a], placed[b], request, result)
            if found < distance[k, m]:
                distance[k, m] = found
                first[k, m], second[k, m] = result.getNearestPoint1(), result.getNearestPoint2()
                normal[k, m] = -result.normal
    return distance, first, second, normal


def between(shapes: tuple[Shape, ...]) -> Callable[[int, int, tuple[Array, Array]], tuple[float, Array]]:
    """How far two of some bodies are apart in one pose, and where they are nearest.

    Args:
        shapes: Bodies.

    Returns:
        A function of the indices of two bodies and of rotations (n, 3, 3) and origins (n, 3) of the links; it gives
        the distance [m], negative where they overlap, and the nearest points of both in the base frame, (2, 3).
    """
    coal = _coal()
    bodies = [geometry(shape) for shape in shapes]
    request, result = coal.DistanceRequest(), coal.DistanceResult()

    def measure(a: int, b: int, poses: tuple[Array, Array]) -> tuple[float, Array]:
        result.clear()
        one, other = (_placed(shapes[k], poses) for k in (a, b))
        distance = coal.distance(bodies[a], one, bodies[b], other, request, result)
        return distance, np.array([result.getNearestPoint1(), result.getNearestPoint2()])

    return measure
