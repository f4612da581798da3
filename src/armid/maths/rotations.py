"""Rotations and cross products.

R_AB is the rotation matrix from frame B to frame A; p_AB is the origin of B in frame A. Angles are in radians.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array


def skew(v: ArrayLike) -> Array:
    """Skew-symmetric matrices S(v), shape (..., 3, 3), of vectors v (..., 3), with S(v) w = v × w."""
    x, y, z = np.moveaxis(np.asarray(v, dtype=np.float64), -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], -2)


def axis_rotation(axis: Array, angle: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) about a unit axis (3,) by angles (...,), by Rodrigues' formula."""
    S = skew(axis)
    s, c = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.eye(3) + s * S + (1.0 - c) * (S @ S)


def rotation_x(angle: float) -> Array:
    """Rotation matrix (3, 3) about the x axis by an angle [rad], exact if the angle is a multiple of 15°."""
    c, s = _cos_sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_y(angle: float) -> Array:
    """Rotation matrix (3, 3) about the y axis by an angle [rad], exact if the angle is a multiple of 15°."""
    c, s = _cos_sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_z(angle: float) -> Array:
    """Rotation matrix (3, 3) about the z axis by an angle [rad], exact if the angle is a multiple of 15°."""
    c, s = _cos_sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rpy_rotation(rpy: ArrayLike) -> Array:
    """Rotation matrix Rz(yaw) Ry(pitch) Rx(roll) for the angles (roll, pitch, yaw) [rad], as in URDF."""
    roll, pitch, yaw = np.asarray(rpy, dtype=np.float64)
    return rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)


def homogeneous(rotation: Array, translation: ArrayLike) -> Array:
    """Homogeneous transform (4, 4) made from the rotation R_AB (3, 3) and the translation p_AB (3,) [m]."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, translation
    return T


def _cos_sin(angle: float) -> tuple[float, float]:
    """Cosine and sine of an angle; for multiples of 15° they are exact or correctly rounded."""
    steps = angle / (np.pi / 12.0)
    nearest = round(steps)
    if abs(steps - nearest) <= 4.0 * np.finfo(float).eps * max(1, abs(nearest)):
        return _cos_of_steps(nearest), _cos_of_steps(nearest - 6)
    return float(np.cos(angle)), float(np.sin(angle))


def _cos_of_steps(steps: int) -> float:
    """Cosine of `steps` times 15°."""
    steps = abs((steps + 12) % 24 - 12)
    return COSINES[steps] if steps <= 6 else -COSINES[12 - steps]


COSINES = (
    1.0,
    (math.sqrt(6.0) + math.sqrt(2.0)) / 4.0,
    math.sqrt(3.0) / 2.0,
    math.sqrt(0.5),
    0.5,
    (math.sqrt(6.0) - math.sqrt(2.0)) / 4.0,
    0.0,
)
"""Cosines of 0°, 15°, ... 90°."""
