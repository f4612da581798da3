"""Principal axes of inertia: moments, axes near those of the frame, and intervals of moments and angles."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from armid.checked_array import Array

EQUAL = 1e-12
"""Largest difference of two moments of inertia, divided by the largest one, at which they count as equal. It is above
the rounding error of an eigenvalue, and so small that the tensor of the written axes is that of the load."""

STEP = 1e-6
"""Angle for difference quotients of angles and quaternions [rad]."""

LARGEST_DEVIATION = 0.5
"""Largest half width of the 95 % interval of a rotation of the axes [rad]. If it is larger, the linearisation is
wrong, and the axes count as not determined."""


@dataclass(frozen=True, eq=False, slots=True)
class PrincipalAxes:
    """Principal axes of the inertia of a body about its centre of mass.

    Attributes:
        moments: Principal moments of inertia, shape (3,) [kg·m²].
        axes: Rotation matrix whose columns are the axes, shape (3, 3).
    """

    moments: Array
    axes: Array


def principal_axes(inertia: Array) -> PrincipalAxes:
    """Principal axes of an inertia matrix (3, 3), in the order and with the signs nearest to the axes of the frame.

    If moments are equal, their axes are arbitrary; then axes near those of the frame are taken.
    """
    moments, axes = np.linalg.eigh((inertia + inertia.T) / 2.0)
    near = EQUAL * max(float(np.abs(moments).max()), np.finfo(float).tiny)
    low, high = moments[1] - moments[0] <= near, moments[2] - moments[1] <= near
    if low and high:
        axes = np.eye(3)
    elif low or high:
        axes = _with_free_plane(axes, 2 if low else 0)
    choices = [
        axes[:, list(order)] * signs for order in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)
    ]
    best = max(
        (choice for choice in choices if np.linalg.det(choice) > 0.0), key=lambda choice: float(np.trace(choice))
    )
    return PrincipalAxes(np.maximum(np.einsum("ki,kl,li->i", best, inertia, best), 0.0), best)


def _with_free_plane(axes: Array, single: int) -> Array:
    """Orthonormal axes, columns (3, 3): two axes near those of the frame, and column `single` of the given axes."""
    normal = axes[:, single]
    nearest = int(np.argmin(np.abs(normal)))
    first: Array = np.eye(3)[nearest] - normal[nearest] * normal
    first = first / float(np.linalg.norm(first))
    second: Array = np.cross(normal, first)
    return np.stack([first, second, normal], axis=1)


def rotation_spread(found: PrincipalAxes, tensor_slope: Array, covariance: Array, t: float) -> Array | None:
    """Covariance (3, 3) of the rotation of the principal axes, times the square of a quantile [rad²].

    The rotation is about the axes themselves. To first order, a change dI of the tensor rotates the axes i and j by
    uᵢᵀ dI uⱼ / (Iⱼ - Iᵢ) about the third axis.

    Args:
        found: Principal axes.
        tensor_slope: Derivative of the inertia matrix by the ten parameters, shape (3, 3, 10).
        covariance: Covariance of the parameters, shape (10, 10).
        t: Quantile of Student's t distribution.

    Returns:
        The matrix, or `None` if moments are so nearly equal that the axes are not determined.
    """
    slope: Array = np.zeros((3, 10))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        difference = found.moments[i] - found.moments[j]
        if abs(difference) <= EQUAL * found.moments.max(initial=0.0):
            return None
        slope[k] = np.einsum("k,kln,l->n", found.axes[:, i], tensor_slope, found.axes[:, j]) / difference
    result: Array = t * t * (slope @ covariance @ slope.T)
    return result if math.sqrt(max(float(np.diag(result).max()), 0.0)) <= LARGEST_DEVIATION else None


def numbers_of_rotation(read: Callable[[Array], Array], axes: Array, spread: Array | None) -> tuple[Array, Array]:
    """Numbers that describe a rotation, and their 95 % intervals by difference quotients.

    Args:
        read: Function from a rotation matrix (3, 3) to the numbers, such as angles.
        axes: The rotation matrix.
        spread: Result of `rotation_spread`.

    Returns:
        The m numbers (m,), and their intervals (m, 2), NaN if `spread` is `None`.
    """
    numbers = read(axes)
    if spread is None:
        return numbers, np.full((len(numbers), 2), np.nan)
    slope = np.column_stack(
        [(read(axes @ _turn(k, STEP)) - read(axes @ _turn(k, -STEP))) / (2 * STEP) for k in range(3)]
    )
    half = np.sqrt(np.maximum(np.einsum("ik,kl,il->i", slope, spread, slope), 0.0))
    return numbers, np.stack([numbers - half, numbers + half], axis=1)


def _turn(axis: int, angle: float) -> Array:
    """Rotation matrix (3, 3) about the axis 0, 1 or 2 by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    result = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    result[i, i] = result[j, j] = c
    result[i, j], result[j, i] = -s, s
    return result
