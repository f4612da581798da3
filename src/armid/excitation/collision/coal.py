"""Distances of bodies, and of convex bodies around them, computed with Coal (extra `collision`).

Coal is much slower than the capsules of armid. Distances of the bodies themselves are therefore computed only after a
plan is finished. Distances of convex bodies (`armid.excitation.collision.hull_distances`) are computed only for
bodies for which capsules are too wide.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import lru_cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError, MissingExtraError
from armid.robot.collada_unit import collada_unit
from armid.robot.shapes import Shape

Parts = Callable[[Shape], Sequence[Any]]
"""Function that returns the Coal geometries that represent a body, in the frame of the body."""


Tell = Callable[[str], None]

_tell: ContextVar[Tell] = ContextVar("_tell", default=lambda path: None)


@contextmanager
def telling_of_meshes(tell: Tell) -> Generator[None]:
    """Context manager in which the function `tell` is called with the path of each mesh before the mesh is read."""
    token = _tell.set(tell)
    try:
        yield
    finally:
        _tell.reset(token)


def _coal() -> Any:
    """Returns the module coal, which is imported on first use.

    Raises:
        MissingExtraError: Coal is not installed.
    """
    try:
        return import_module("coal")
    except ImportError as error:
        raise MissingExtraError("coal", "Measuring distances of bodies and reading meshes", "collision") from error


def stamp(path: str) -> tuple[int, int]:
    """Size and modification time of a file, by which a change of the file is detected; zeros if it does not exist."""
    try:
        about = os.stat(path)
    except OSError:
        return 0, 0
    return about.st_size, about.st_mtime_ns


@lru_cache(maxsize=64)
def _mesh(path: str, scale: tuple[float, float, float], _stamp: tuple[int, int]) -> Any:
    """Reads the triangle mesh in a file, in metres; the result is cached.

    Raises:
        ArmidError: Coal cannot read the file, or its unit of length is invalid.
    """
    coal = _coal()
    _tell.get()(path)
    unit = collada_unit(path)
    try:
        return coal.MeshLoader().load(path, unit * np.array(scale))
    except (ValueError, RuntimeError) as error:
        raise ArmidError(
            f"The mesh {path} cannot be read: {error}.", remedy="convert it to STL, DAE or OBJ, or remove it."
        ) from error


def mesh_triangles(shape: Shape) -> Array:
    """Corners of the triangles of a mesh in the frame of the mesh, shape (t, 3, 3) [m]."""
    corners, faces = mesh_faces(shape)
    return corners[faces]


def mesh_faces(shape: Shape) -> tuple[Array, NDArray[np.intp]]:
    """Corners (v, 3) [m] of a mesh in its own frame, and indices (t, 3) of the three corners of each triangle.

    The corners of a triangle are ordered counter-clockwise as seen from outside, also if the scale mirrors the mesh.
    """
    a, b, c = shape.size.tolist()
    corners, index = _faces(shape.path, (a, b, c), stamp(shape.path))
    return corners.copy(), index.copy()


@lru_cache(maxsize=64)
def _faces(path: str, scale: tuple[float, float, float], written: tuple[int, int]) -> tuple[Array, NDArray[np.intp]]:
    """Corners and triangles as `mesh_faces` returns them; cached, because Coal returns one triangle at a time."""
    mesh = _mesh(path, scale, written)
    faces = (mesh.tri_indices(k) for k in range(mesh.num_tris))
    index = np.array([(face[0], face[1], face[2]) for face in faces], dtype=np.intp).reshape(-1, 3)
    index = index[:, ::-1] if np.prod(scale) < 0.0 else index
    return np.array(mesh.vertices(), dtype=np.float64).reshape(-1, 3), np.ascontiguousarray(index)


def geometry(shape: Shape) -> Any:
    """Coal geometry of a body; primitive shapes have the same frames in Coal and in armid."""
    coal = _coal()
    a, b, c = (float(x) for x in shape.size)
    if shape.kind == "mesh":
        return _mesh(shape.path, (a, b, c), stamp(shape.path))
    made = {
        "capsule": lambda: coal.Capsule(a, b),
        "sphere": lambda: coal.Sphere(a),
        "cylinder": lambda: coal.Cylinder(a, b),
        "box": lambda: coal.Box(a, b, c),
        "ellipsoid": lambda: coal.Ellipsoid(a, b, c),
        "half-space": lambda: coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0),
    }
    return made[shape.kind]()


def version() -> str:
    """Version of the installed Coal."""
    return str(_coal().__version__)


def convex(corners: Array, faces: NDArray[np.intp], beyond: float = 0.0) -> Any:
    """Coal geometry of a convex body.

    Args:
        corners: Corners of the body, shape (v, 3) [m].
        faces: Indices of the three corners of each triangle, counter-clockwise from outside, shape (t, 3).
        beyond: Distance by which the body is enlarged in all directions [m].
    """
    coal = _coal()
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in corners:
        points.append(corner)
    for face in faces.tolist():
        triangles.append(coal.Triangle(*face))
    made = coal.Convex(points, triangles)
    if beyond:
        made.setSweptSphereRadius(beyond)
    return made


def apart(body: Any, points: Array) -> Array:
    """Distances of points (v, 3) [m] from a Coal geometry, shape (v,) [m]; negative inside."""
    coal = _coal()
    request, result, here = coal.DistanceRequest(), coal.DistanceResult(), coal.Transform3s()
    ball, turn = coal.Sphere(0.0), np.eye(3)  # Coal does not keep what it is given alive
    measure = coal.ComputeDistance(body, ball)

    def distance(point: Array) -> float:
        result.clear()
        return measure(here, coal.Transform3s(turn, point), request, result)

    return np.array([distance(point) for point in points])


def _placed(shape: Shape, poses: tuple[Array, Array]) -> list[Any]:
    """Placements of a body as transforms of Coal, one for each pose of a motion.

    A pose is given by the rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
    """
    transform = _coal().Transform3s
    turn, place = shape.placement[:3, :3], shape.placement[:3, 3]
    R, p = poses
    if shape.link < 0:
        return [transform(turn, place)] * len(p)
    turns, places = R[:, shape.link] @ turn, p[:, shape.link] + R[:, shape.link] @ place
    return list(map(transform, turns, places))


def whole(shape: Shape) -> tuple[Any, ...]:
    """Coal geometry of a whole body, as a tuple of length one; for the argument `parts` of `distances`."""
    return (geometry(shape),)


def _measured(
    shapes: Sequence[Shape], parts: Parts, pairs: NDArray[np.intp], poses: tuple[Array, Array]
) -> Iterator[tuple[int, int, float, Any]]:
    """Yields the distance of each two parts of a pair of bodies in each pose.

    Each item consists of index of the pair, index of the pose, distance [m] and result of Coal.
    """
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
    """Distances of pairs of bodies along a motion.

    Args:
        shapes: Bodies.
        pairs: Indices of the two bodies of each pair, shape (m, 2).
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
        parts: Function that gives the Coal geometries that represent each body.

    Returns:
        Distances, shape (N, m) [m]; negative where bodies overlap.
    """
    out = np.full((len(poses[1]), len(pairs)), np.inf)
    for m, k, distance, _ in _measured(shapes, parts, pairs, poses):
        out[k, m] = min(out[k, m], distance)
    return out


def nearest(
    shapes: Sequence[Shape], pairs: NDArray[np.intp], poses: tuple[Array, Array], parts: Parts
) -> tuple[Array, Array, Array, Array]:
    """Distances and nearest points of bodies along a motion.

    Args:
        shapes: Bodies.
        pairs: Indices of the two bodies of each pair, shape (m, 2).
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.
        parts: Function that gives the convex Coal geometries that represent each body.

    Returns:
        Distances, shape (N, m) [m], negative where parts overlap; then, shape (N, m, 3) each, nearest point of the
        first body, nearest point of the second body, and unit vector from the second to the first body, which is the
        direction in which the bodies separate.
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
    """Mask of the poses in which two bodies are closer than a margin, shape (N,); faster than `distances`.

    Args:
        shapes: Bodies.
        pair: Indices of the two bodies, shape (2,).
        margin: Distance with which the distance of the bodies is compared [m].
        poses: Rotations (N, n, 3, 3) and origins (N, n, 3) of the links.

    Returns:
        Mask of the poses in which the bodies are too close, shape (N,).
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
