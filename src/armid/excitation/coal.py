"""Distances of bodies as they are, by Coal, which comes with Pinocchio: primitives, and meshes by their triangles.

Slower by far than capsules, so it has the last word on a plan and no part in the search.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.errors import ArmidError
from armid.robot.shapes import Shape
from armid.values import Array

__all__ = ["between", "distances", "mesh_faces", "mesh_triangles"]


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


def _geometry(shape: Shape) -> Any:
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


def distances(shapes: tuple[Shape, ...], pairs: NDArray[np.intp], poses: tuple[Array, Array]) -> Array:
    """Distance of each pair along a motion.

    Args:
        shapes: Bodies.
        pairs: Indices of two bodies each, shape (m, 2).
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.

    Returns:
        Shape (N, m) [m]; negative where bodies overlap.
    """
    coal = _coal()
    R, p = poses
    bodies = [_geometry(shape) for shape in shapes]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    out = np.empty((len(p), len(pairs)))
    for k in range(len(p)):
        placed: list[Any] = []
        for shape in shapes:
            turn, place = shape.placement[:3, :3], shape.placement[:3, 3]
            if shape.link >= 0:
                turn, place = R[k, shape.link] @ turn, p[k, shape.link] + R[k, shape.link] @ place
            placed.append(coal.Transform3s(turn, place))
        for m, (a, b) in enumerate(pairs):
            result.clear()
            out[k, m] = coal.distance(bodies[a], placed[a], bodies[b], placed[b], request, result)
    return out


def between(shapes: tuple[Shape, ...]) -> Callable[[int, int, tuple[Array, Array]], tuple[float, Array]]:
    """How far two of some bodies are apart in one pose, and where they are nearest.

    Args:
        shapes: Bodies.

    Returns:
        A function of the indices of two bodies and of rotations (n, 3, 3) and origins (n, 3) of the links; it gives
        the distance [m], negative where they overlap, and the nearest points of both in the base frame, (2, 3).
    """
    coal = _coal()
    bodies = [_geometry(shape) for shape in shapes]
    request, result = coal.DistanceRequest(), coal.DistanceResult()

    def placed(k: int, poses: tuple[Array, Array]) -> Any:
        shape = shapes[k]
        turn, place = shape.placement[:3, :3], shape.placement[:3, 3]
        if shape.link >= 0:
            turn, place = poses[0][shape.link] @ turn, poses[1][shape.link] + poses[0][shape.link] @ place
        return coal.Transform3s(turn, place)

    def measure(a: int, b: int, poses: tuple[Array, Array]) -> tuple[float, Array]:
        result.clear()
        distance = coal.distance(bodies[a], placed(a, poses), bodies[b], placed(b, poses), request, result)
        return distance, np.array([result.getNearestPoint1(), result.getNearestPoint2()])

    return measure
