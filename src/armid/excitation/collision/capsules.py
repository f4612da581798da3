"""Bounding capsules of bodies: if the capsules of two bodies do not touch, the bodies do not touch.

Capsules and spheres of the description are represented exactly. Other bodies are cut into slices by planes
perpendicular to a principal axis. Each slice is enclosed in the smallest capsule that is found. The number of slices
is increased as long as this clearly reduces the total volume. For an elbow with an offset, for instance, one capsule
would be far too large.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.rotations import homogeneous
from armid.robot.shapes import Shape, capsule_between, rotation_with_z

Made = TypeVar("Made")

SLABS = 4
"""Largest number of slices into which a body is cut."""

WORTH = 0.8
"""Ratio of the total volume of capsules or hulls with more slices to the volume with fewer slices, below which more
slices are used."""

THIN = 1e-6
"""Smallest radius of a capsule [m]."""

FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
                  [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 3, 7], [1, 7, 5]])  # fmt: skip
"""Indices of the three corners of each triangle of a box, shape (12, 3); in the order of the corners, z changes
fastest."""


@dataclass(frozen=True, eq=False, slots=True)
class Points:
    """Points of a body or of a slice of a body, with weights.

    Attributes:
        at: Positions of the points, shape (v, 3) [m].
        count: Number of triangles that use each point, shape (v,). This number is the weight of the point in the
            computation of the principal axes.
    """

    at: Array
    count: Array


Cuts = tuple[tuple[tuple[Points, ...], ...], ...]
"""A whole body, then the body cut into two, three and more slices; each number of slices is tried in several
directions."""


def covering(shape: Shape) -> tuple[Shape, ...]:
    """Capsules that together enclose a body; a body that is a capsule is returned unchanged.

    Args:
        shape: The body; neither a half-space nor a mesh (for a mesh see `armid.excitation.collision.mesh_hulls`).
    """
    radius, length, _ = shape.size
    name, link, placement = shape.name, shape.link, shape.placement
    if shape.kind == "capsule":
        return (shape,)
    if shape.kind == "sphere":
        return (Shape(name, link, "capsule", np.array([radius, 0.0]), placement),)
    if shape.kind == "cylinder":
        return (Shape(name, link, "capsule", np.array([radius, length]), placement),)
    if shape.kind == "ellipsoid":
        # The end spheres touch the tips of the longest semi-axis, and the second one is the largest distance from it.
        _, second, longest = np.sort(shape.size)
        turned = homogeneous(rotation_with_z(np.eye(3)[int(shape.size.argmax())]), np.zeros(3))
        return (Shape(name, link, "capsule", np.array([second, 2.0 * (longest - second)]), placement @ turned),)
    triangles = box_triangles(shape.size)
    cuts = cuts_of(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    made = smallest(cuts, lambda part: around(name, part, part.at), volume_of)
    return tuple(capsule.on(link, placement) for capsule in made)


def box_triangles(size: Array) -> Array:
    """Triangles of a box with edges of lengths (3,) [m], shape (12, 3, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return (0.5 * signs * size)[FACES]


def cuts_of(corners: Array, faces: NDArray[np.intp]) -> Cuts:
    """Cuts a body by planes perpendicular to each of its principal axes, into one to `SLABS` slices.

    Args:
        corners: Corners of the triangles of the body, shape (v, 3) [m].
        faces: Indices of the three corners of each triangle, shape (t, 3).
    """
    whole = Points(corners, np.bincount(faces.ravel(), minlength=len(corners)).astype(np.float64))
    used = whole.count > 0.0
    whole = Points(corners[used], whole.count[used])
    faces = (np.cumsum(used) - 1)[faces]
    directions = _principal(whole)
    several = (
        tuple(tuple(_slabs(whole, faces, along, slabs)) for along in directions) for slabs in range(2, SLABS + 1)
    )
    return (((whole,),), *several)


def smallest(cuts: Cuts, make: Callable[[Points], Made], volume: Callable[[Made], float]) -> tuple[Made, ...]:
    """Bounding volumes of the slices of a body, with the number of slices that gives a small total volume.

    The number of slices is increased as long as this clearly reduces the total volume.

    Args:
        cuts: The body and its slices, from `cuts_of`.
        make: Function that computes the bounding volume of points.
        volume: Function that computes the volume of a bounding volume.

    Returns:
        One bounding volume for each slice.
    """

    def total(made: tuple[Made, ...]) -> float:
        return sum(volume(each) for each in made)

    best: tuple[Made, ...] = ()
    for cut in cuts:
        made = min((tuple(make(part) for part in parts) for parts in cut), key=total)
        if not best or total(made) < WORTH * total(best):
            best = made
    return best


def _slabs(whole: Points, faces: NDArray[np.intp], direction: Array, slabs: int) -> list[Points]:
    """Points of the slices of a body between `slabs + 1` equally spaced parallel planes."""
    corners, height = whole.at, whole.at @ direction
    planes = np.linspace(height.min(), height.max(), slabs + 1)
    heights = height[faces]
    parts: list[Points] = []
    crossings: list[Array] = []
    for plane in planes[1:-1]:
        points: list[Array] = []
        for a, b in ((0, 1), (1, 2), (2, 0)):
            below, above = heights[:, a] - plane, heights[:, b] - plane
            through = below * above < 0.0
            share = (below[through] / (below - above)[through])[:, None]
            points.append((1.0 - share) * corners[faces[through, a]] + share * corners[faces[through, b]])
        crossings.append(np.concatenate(points))
    for k in range(slabs):
        inside = (height >= planes[k]) & (height <= planes[k + 1])
        sides = [crossings[i] for i in (k - 1, k) if 0 <= i < len(crossings)]
        points = [corners[inside], *sides]
        counts = [whole.count[inside], *(np.ones(len(side)) for side in sides)]
        if sum(map(len, points)):
            parts.append(Points(np.concatenate(points), np.concatenate(counts)))
    return parts


def around(name: str, part: Points, outer: Array) -> Shape:
    """Smallest of three capsules that enclose points, one along each principal axis, in the frame of the points.

    Args:
        name: Name of the capsule.
        part: Points of the body. Each principal axis of these points is tried as the direction of the axis of the
            capsule.
        outer: Points that the capsule must enclose, for instance the corners of their convex hull, shape (k, 3) [m].
    """
    centre = np.average(part.at, axis=0, weights=part.count)
    best: Shape | None = None
    for direction in _principal(part):
        along = (outer - centre) @ direction
        middle = centre + 0.5 * (along.max() + along.min()) * direction
        across = (outer - middle) - np.outer((outer - middle) @ direction, direction)
        # Centring across the axis brings the radius close to the smallest possible.
        middle = middle + 0.5 * (across.max(axis=0) + across.min(axis=0))
        away = outer - middle
        reach = away @ direction
        wide = np.linalg.norm(away - np.outer(reach, direction), axis=1)
        size = max(float(wide.max()), THIN)
        half = float(np.max(np.abs(reach) - np.sqrt(np.maximum(size**2 - wide**2, 0.0)), initial=0.0))
        made = capsule_between(name, -1, middle - half * direction, middle + half * direction, size)
        if best is None or volume_of(made) < volume_of(best):
            best = made
    assert best is not None
    return best


def _principal(part: Points) -> Array:
    """Principal axes of points, one in each row, shape (3, 3)."""
    away = part.at - np.average(part.at, axis=0, weights=part.count)
    return np.linalg.eigh((away * part.count[:, None]).T @ away)[1].T


def volume_of(capsule: Shape) -> float:
    """Volume of a capsule [m³]."""
    radius, length, _ = capsule.size
    return float(np.pi * radius**2 * (length + 4.0 / 3.0 * radius))
