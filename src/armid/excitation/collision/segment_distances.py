"""Nearest points of two segments, and of a segment and a box."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array

TINY = 1e-12
"""Squared length [m²] below which a segment is treated as a point."""

ROUNDING = 1e-9
"""Largest distance between a segment and a box at which the segment is treated as one that intersects the box [m]."""


def nearest_on_segments(uu: Array, vv: Array, uv: Array, ur: Array, vr: Array) -> tuple[Array, Array]:
    """Nearest points of two segments a + s u and b + t v, given by their parameters s and t from 0 to 1.

    Args:
        uu: Squared length of u, shape (c,).
        vv: Squared length of v, shape (c,).
        uv: Scalar product of u and v, shape (..., c).
        ur: Scalar product of u and a - b, shape (..., c).
        vr: Scalar product of v and a - b, shape (..., c).

    Returns:
        Parameters s and t of the nearest points, shape (..., c) each.
    """
    across = uu * vv - uv**2
    s = np.clip((uv * vr - ur * vv) / np.maximum(across, TINY * TINY), 0.0, 1.0)
    s = np.where(across > TINY * np.maximum(uu * vv, TINY), s, 0.0)
    t = np.clip((uv * s + vr) / np.maximum(vv, TINY), 0.0, 1.0)
    s = np.clip((uv * t - ur) / np.maximum(uu, TINY), 0.0, 1.0)
    t = np.clip((uv * s + vr) / np.maximum(vv, TINY), 0.0, 1.0)
    return s, t


def nearest_on_box(a: Array, u: Array, half: Array) -> tuple[Array, Array, Array]:
    """Nearest points of segments to a box whose centre is the origin of the frame.

    The edges of the box are parallel to the axes of the frame. The derivative of the squared distance along a segment
    is piecewise linear and increasing, with kinks where a coordinate passes a face, so its zero is computed exactly.
    If a segment intersects the box, its deepest point is taken.

    Args:
        a: Start points of the segments, shape (..., 3).
        u: Vectors from start point to end point, shape (..., 3).
        half: Half the edges of the box, shape (..., 3).

    Returns:
        Positions (...,) of the nearest points along the segments, from 0 to 1, signed distances (...,), and the
        gradients (..., 3) of these distances.
    """
    divisor = np.where(np.abs(u) > TINY, u, np.inf)
    ends = np.zeros((*a.shape[:-1], 2))
    ends[..., 1] = 1.0
    kinks = np.clip(np.concatenate([(-half - a) / divisor, (half - a) / divisor], axis=-1), 0.0, 1.0)
    places = np.sort(np.concatenate([ends, kinks], axis=-1), axis=-1)
    points = a[..., None, :] + places[..., None] * u[..., None, :]
    beyond = points - np.clip(points, -half[..., None, :], half[..., None, :])
    slopes = (beyond * u[..., None, :]).sum(axis=-1)
    after = np.clip((slopes < 0.0).sum(axis=-1), 1, places.shape[-1] - 1)[..., None]
    (s, end), (rise, last) = (
        (np.take_along_axis(x, after - 1, -1)[..., 0], np.take_along_axis(x, after, -1)[..., 0])
        for x in (places, slopes)
    )
    share = np.clip(-rise / np.maximum(last - rise, TINY * TINY), 0.0, 1.0)
    s = s + share * (end - s)
    inside = _box_distance(a + s[..., None] * u, half)[0] <= ROUNDING
    if inside.any():
        s[inside] = _deepest(a[inside], u[inside], np.broadcast_to(half, a.shape)[inside])
    return s, *_box_distance(a + s[..., None] * u, half)


def _deepest(a: Array, u: Array, half: Array) -> Array:
    """Positions (k,), from 0 to 1, along segments (k, 3) of the points that are deepest inside a box.

    Inside the box, the signed distance is the largest of six linear functions. Its minimum is therefore at an end of
    the segment or at a point at which two of the functions are equal.
    """
    value, slope = np.concatenate([a - half, -a - half], axis=-1), np.concatenate([u, -u], axis=-1)
    one, other = np.triu_indices(6, 1)
    relative = slope[:, one] - slope[:, other]
    equal = (value[:, other] - value[:, one]) / np.where(np.abs(relative) > TINY, relative, np.inf)
    places = np.column_stack([np.zeros(len(a)), np.ones(len(a)), np.clip(equal, 0.0, 1.0)])
    height = (value[:, None] + places[..., None] * slope[:, None]).max(axis=-1)
    return np.take_along_axis(places, height.argmin(axis=-1)[:, None], -1)[:, 0]


def _box_distance(point: Array, half: Array) -> tuple[Array, Array]:
    """Signed distance (...,) of points (..., 3) from a box, negative inside the box, and its gradient (..., 3)."""
    offset = np.abs(point) - half
    outside = np.maximum(offset, 0.0)
    length = np.linalg.norm(outside, axis=-1)
    deepest = offset.max(axis=-1)
    distance = np.where(deepest > 0.0, length, deepest)
    slope = np.where(
        (deepest > 0.0)[..., None],
        outside / np.maximum(length, TINY)[..., None],
        np.eye(3)[offset.argmax(axis=-1)],
    )
    return distance, slope * np.where(point < 0.0, -1.0, 1.0)
