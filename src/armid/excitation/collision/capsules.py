"""Capsules around bodies: what is found apart by its capsules is apart.

Exact where the description has capsules and spheres. Other bodies are cut into slabs across one of their axes, and
each slab, cut edges included, lies in the smallest capsule found; more slabs are taken as long as the capsules
become much smaller by it, so that an elbow with an offset is not a balloon.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from armid.robot.shapes import Shape, capsule_between
from armid.values import Array

__all__ = ["Points", "around", "box_triangles", "covering", "cuts_of", "smallest", "volume_of"]

Made = TypeVar("Made")

SLABS = 4
"""A body is cut into no more slabs."""

WORTH = 0.8
"""A further slab is worth having where it brings the volume of what goes around below this share."""

THIN = 1e-6
"""Radius [m] of what has none."""

FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
                  [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 3, 7], [1, 7, 5]])  # fmt: skip
"""Triangles of a box's corners, which are counted with z the fastest."""


@dataclass(frozen=True, eq=False, slots=True)
class Points:
    """Points of a part of a body.

    Attributes:
        at: Shape (v, 3) [m].
        count: How often each was met, which is how much it weighs in the axes of the part, shape (v,).
    """

    at: Array
    count: Array


Cuts = tuple[tuple[tuple[Points, ...], ...], ...]
"""A body whole, then in two slabs, three and more, each in several directions."""


def covering(shape: Shape) -> tuple[Shape, ...]:
    """Capsules that a body lies in; a capsule is itself.

    Args:
        shape: The body, no half-space and no mesh (`armid.excitation.collision.mesh_hulls`).
    """
    radius, length, _ = shape.size
    name, link, placement = shape.name, shape.link, shape.placement
    if shape.kind == "capsule":
        return (shape,)
    if shape.kind == "sphere":
        return (Shape(name, link, "capsule", np.array([radius, 0.0]), placement),)
    if shape.kind == "cylinder":
        return (Shape(name, link, "capsule", np.array([radius, length]), placement),)
    triangles = box_triangles(shape.size)
    cuts = cuts_of(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
    made = smallest(cuts, lambda part: around(name, part, part.at), volume_of)
    return tuple(capsule.on(link, placement) for capsule in made)


def box_triangles(size: Array) -> Array:
    """Triangles of a box of edges (3,) [m], shape (12, 3, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return (0.5 * signs * size)[FACES]


def cuts_of(corners: Array, faces: NDArray[np.intp]) -> Cuts:
    """A body in ever more slabs across its axes.

    Args:
        corners: Of its triangles, shape (v, 3) [m].
        faces: Three corners of each, shape (t, 3).
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
    """Return what goes around a body, cut into slabs as long as that brings the volume down.

    Args:
        cuts: The body.
        make: What goes around points.
        volume: Of that.
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
    """The parts of triangles between parallel planes at even distances."""
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
    """The smallest capsule found around points, carried by the base.

    Args:
        name: Of the capsule.
        part: The points, whose spread gives the directions that are tried.
        outer: Those of them that matter, as corners of their convex hull, shape (k, 3) [m].
    """
    centre = np.average(part.at, axis=0, weights=part.count)
    best: Shape | None = None
    for direction in _principal(part):
        along = (outer - centre) @ direction
        middle = centre + 0.5 * (along.max() + along.min()) * direction
        across = (outer - middle) - np.outer((outer - middle) @ direction, direction)
        # Centring across the axis brings the radius near the smallest.
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
    """Three directions at right angles along which points are spread, one a row."""
    away = part.at - np.average(part.at, axis=0, weights=part.count)
    return np.linalg.eigh((away * part.count[:, None]).T @ away)[1].T


def volume_of(capsule: Shape) -> float:
    """Volume of a capsule [m³]."""
    radius, length, _ = capsule.size
    return float(np.pi * radius**2 * (length + 4.0 / 3.0 * radius))
