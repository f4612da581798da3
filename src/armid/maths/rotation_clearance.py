"""Proof that two bodies keep a distance from each other at all angles of a rotation about one axis.

A point that turns about the axis keeps its distance r from the axis (radius) and its coordinate z along the axis
(height). The profile of a body is the set of all (r, z) of its surface. The distance between the profiles of two
bodies is a lower bound of the distance between the bodies at all angles. Each triangle is enclosed by a rectangle in
the plane of r and z; for the faces of a flange, this is exact.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array

CHUNK = 256
"""Number of triangles of one body that are compared at a time with the triangles of the other body at about the same
height."""


@dataclass(frozen=True, eq=False, slots=True)
class SweptProfile:
    """Profile of a body that turns about an axis: rectangles that enclose its triangles.

    The rectangles lie in the plane of radius and height.

    Attributes:
        radius: Smallest and largest distance of each triangle from the axis, shape (t, 2) [m].
        height: Smallest and largest coordinate of each triangle along the axis, shape (t, 2) [m].
    """

    radius: Array
    height: Array

    def closer_than(self, other: SweptProfile, distance: float) -> bool:
        """Checks whether rectangles of this and another profile are less than a distance [m] from each other."""
        order = self.height[:, 0].argsort()
        for begin in range(0, len(order), CHUNK):
            own = order[begin : begin + CHUNK]
            low, high = self.height[own, 0].min() - distance, self.height[own, 1].max() + distance
            near = np.flatnonzero((other.height[:, 1] > low) & (other.height[:, 0] < high))
            across = _gap(self.radius[own], other.radius[near])
            along = _gap(self.height[own], other.height[near])
            if (np.hypot(across, along) < distance).any():
                return True
        return False


def swept_profile(triangles: Array, axis: Array, origin: Array) -> SweptProfile:
    """Computes the profile of a body that turns about an axis.

    Args:
        triangles: Corners of the triangles, shape (t, 3, 3) [m].
        axis: Unit vector along the axis, shape (3,).
        origin: Point of the axis, shape (3,) [m].
    """
    corners = triangles - origin
    height = corners @ axis
    side = np.linalg.svd(axis[None])[2][1]
    flat = np.stack([corners @ side, corners @ np.cross(axis, side)], axis=-1)
    largest = np.linalg.norm(flat, axis=2).max(axis=1)
    smallest = np.full(len(flat), np.inf)
    turns = np.empty((3, len(flat)))
    for k, (a, b) in enumerate(itertools.pairwise((0, 1, 2, 0))):
        first, edge = flat[:, a], flat[:, b] - flat[:, a]
        length = np.maximum((edge**2).sum(axis=1), np.finfo(float).tiny)
        share = np.clip(-(first * edge).sum(axis=1) / length, 0.0, 1.0)
        smallest = np.minimum(smallest, np.linalg.norm(first + share[:, None] * edge, axis=1))
        turns[k] = flat[:, a, 0] * flat[:, b, 1] - flat[:, a, 1] * flat[:, b, 0]
    inside = (turns >= 0.0).all(axis=0) | (turns <= 0.0).all(axis=0)  # the axis passes through the triangle
    radius = np.column_stack([np.where(inside, 0.0, smallest), largest])
    return SweptProfile(radius, np.column_stack([height.min(axis=1), height.max(axis=1)]))


def _gap(own: Array, other: Array) -> Array:
    """Gap between each of s intervals (s, 2) and each of t intervals (t, 2), shape (s, t); zero if they overlap."""
    return np.maximum(0.0, np.maximum(own[:, None, 0] - other[:, 1], other[:, 0] - own[:, None, 1]))
