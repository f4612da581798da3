"""Capsules around bodies: what is found apart by its capsules is apart.

Exact where the description has capsules and spheres. Other bodies are cut into slabs across one of their axes, and
each slab, cut edges included, lies in the smallest capsule found; more slabs are taken as long as the capsules
become much smaller by it, so that an elbow with an offset is not a balloon.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeVar

import numpy as np

from armid.robot.shapes import Shape, capsule_between
from armid.values import Array

__all__ = ["around", "box_triangles", "covering", "in_slabs"]

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


def covering(shape: Shape, triangles: Array | None = None) -> tuple[Shape, ...]:
    """Capsules that a body lies in; a capsule is itself.

    Args:
        shape: The body, no half-space.
        triangles: Of a mesh, in its own frame, shape (t, 3, 3) [m].
    """
    radius, length, _ = shape.size
    name, link, placement = shape.name, shape.link, shape.placement
    if shape.kind == "capsule":
        return (shape,)
    if shape.kind == "sphere":
        return (Shape(name, link, "capsule", np.array([radius, 0.0]), placement),)
    if shape.kind == "cylinder":
        return (Shape(name, link, "capsule", np.array([radius, length]), placement),)
    triangles = box_triangles(shape.size) if shape.kind == "box" else triangles
    assert triangles is not None
    made = in_slabs(triangles, partial(around, name), _volume)
    return tuple(capsule.on(link, placement) for capsule in made)


def box_triangles(size: Array) -> Array:
    """Triangles of a box of edges (3,) [m], shape (12, 3, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return (0.5 * signs * size)[FACES]


def in_slabs(triangles: Array, make: Callable[[Array], Made], volume: Callable[[Made], float]) -> tuple[Made, ...]:
    """What goes around a body, cut into slabs as long as that brings the volume down.

    Args:
        triangles: Of the body, shape (t, 3, 3) [m].
        make: What goes around points (v, 3).
        volume: Of that.
    """

    def total(made: tuple[Made, ...]) -> float:
        return sum(volume(each) for each in made)

    points = triangles.reshape(-1, 3)
    best = (make(points),)
    directions = _principal(points)
    for slabs in range(2, SLABS + 1):
        cut = [tuple(make(part) for part in _slabs(triangles, along, slabs)) for along in directions]
        smallest = min(cut, key=total)
        if total(smallest) < WORTH * total(best):
            best = smallest
    return best


def _slabs(triangles: Array, direction: Array, slabs: int) -> list[Array]:
    """Corners (v, 3) of the parts of triangles between parallel planes at even distances."""
    heights = triangles @ direction
    planes = np.linspace(heights.min(), heights.max(), slabs + 1)
    parts: list[Array] = []
    crossings: list[Array] = []
    for plane in planes[1:-1]:
        points: list[Array] = []
        for a, b in ((0, 1), (1, 2), (2, 0)):
            below, above = heights[:, a] - plane, heights[:, b] - plane
            through = below * above < 0.0
            share = (below[through] / (below - above)[through])[:, None]
            points.append((1.0 - share) * triangles[through, a] + share * triangles[through, b])
        crossings.append(np.concatenate(points))
    for k in range(slabs):
        inside = (heights >= planes[k]) & (heights <= planes[k + 1])
        sides = [crossings[i] for i in (k - 1, k) if 0 <= i < len(crossings)]
        corners = np.concatenate([triangles[inside], *sides])
        if len(corners):
            parts.append(corners)
    return parts


def around(name: str, points: Array) -> Shape:
    """The smallest capsule found around points (v, 3), carried by the base."""
    centre = points.mean(axis=0)
    best: Shape | None = None
    for direction in _principal(points):
        along = (points - centre) @ direction
        middle = centre + 0.5 * (along.max() + along.min()) * direction
        across = (points - middle) - np.outer((points - middle) @ direction, direction)
        # Centring across the axis brings the radius near the smallest.
        middle = middle + 0.5 * (across.max(axis=0) + across.min(axis=0))
        away = points - middle
        reach = away @ direction
        wide = np.linalg.norm(away - np.outer(reach, direction), axis=1)
        size = max(float(wide.max()), THIN)
        half = float(np.max(np.abs(reach) - np.sqrt(np.maximum(size**2 - wide**2, 0.0)), initial=0.0))
        made = capsule_between(name, -1, middle - half * direction, middle + half * direction, size)
        if best is None or _volume(made) < _volume(best):
            best = made
    assert best is not None
    return best


def _principal(points: Array) -> Array:
    """Three directions at right angles along which points (v, 3) are spread, one a row."""
    away = points - points.mean(axis=0)
    return np.linalg.eigh(away.T @ away)[1].T


def _volume(capsule: Shape) -> float:
    radius, length, _ = capsule.size
    return float(np.pi * radius**2 * (length + 4.0 / 3.0 * radius))
