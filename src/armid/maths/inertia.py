"""Ten inertial parameters of a rigid body, and equivalent descriptions of the body.

The parameters always have the order of Pinocchio: m, m·x, m·y, m·z, Ixx, Ixy, Iyy, Ixz, Iyz, Izz. The inertia is
about the origin of the body frame. The pseudo-inertia [Wensing2018] is J = ∫ [p; 1][p; 1]ᵀ dm, a symmetric 4 x 4
matrix; a body is physically consistent exactly when J is positive semidefinite.
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.maths.rotations import skew

INERTIA_INDEX = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
"""Row and column, in the inertia matrix, of each of its six independent entries in parameter order."""


def _of_units() -> Array:
    """Pseudo-inertias (10, 4, 4) of the ten unit vectors in the space of the inertial parameters."""
    result = np.zeros((10, 4, 4))
    result[0, 3, 3] = 1.0
    for k in range(3):
        result[1 + k, k, 3] = result[1 + k, 3, k] = 1.0
    for k, (i, j) in enumerate(INERTIA_INDEX):
        result[4 + k, [0, 1, 2], [0, 1, 2]] = 0.5 if i == j else 0.0
        result[4 + k, i, j] = result[4 + k, j, i] = -0.5 if i == j else -1.0
    result.flags.writeable = False
    return result


PSEUDO_INERTIA_OF: Array = _of_units()
"""Pseudo-inertias (10, 4, 4) of the ten unit vectors of parameters. The pseudo-inertia of a body is the sum of these
matrices, each multiplied by a parameter of the body."""


def inertia_matrix(six: Array) -> Array:
    """Inertia matrices (..., 3, 3) made from their entries Ixx, Ixy, Iyy, Ixz, Iyz, Izz, shape (..., 6) [kg·m²]."""
    xx, xy, yy, xz, yz, zz = np.moveaxis(np.asarray(six), -1, 0)
    return np.stack([np.stack([xx, xy, xz], -1), np.stack([xy, yy, yz], -1), np.stack([xz, yz, zz], -1)], -2)


def inertia_vector(matrix: Array) -> Array:
    """Entries Ixx, Ixy, Iyy, Ixz, Iyz, Izz, shape (..., 6), of inertia matrices (..., 3, 3)."""
    return np.stack([matrix[..., i, j] for i, j in INERTIA_INDEX], -1)


def spatial_inertia(vector: Array) -> Array:
    """Spatial inertia (6, 6) of a body about the origin of its frame, angular part first [Featherstone2008].

    It is [[I_o, S(h)], [S(h)ᵀ, m·1]] with the inertia I_o about the origin, the first moment h, its cross-product
    matrix S(h), and the mass m. The argument contains the ten inertial parameters, shape (10,).
    """
    m, h, inertia = vector[0], vector[1:4], inertia_matrix(vector[4:])
    return np.block([[inertia, skew(h)], [skew(h).T, m * np.eye(3)]])


def pseudo_inertia(vector: Array) -> Array:
    """Pseudo-inertias (..., 4, 4) of inertial parameters (..., 10).

    A pseudo-inertia is [[½ tr(I)·1 - I, h], [hᵀ, m]] with the inertia I about the origin, the first moment h and the
    mass m.
    """
    vector = np.asarray(vector)
    return (vector @ PSEUDO_INERTIA_OF.reshape(10, 16)).reshape(*vector.shape[:-1], 4, 4)


def vector_from_pseudo_inertia(J: Array) -> Array:
    """Inertial parameters (..., 10) from pseudo-inertias (..., 4, 4).

    The inertia about the origin is tr(Σ)·1 - Σ, with the upper left 3 x 3 block Σ of the pseudo-inertia.
    """
    sigma = J[..., :3, :3]
    inertia = np.trace(sigma, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - sigma
    return np.concatenate([J[..., 3:, 3], J[..., :3, 3], inertia_vector(inertia)], -1)


def transform(vector: Array, rotation: Array, translation: Array) -> Array:
    """Inertial parameters of the same body in another frame.

    The pseudo-inertia J is transformed by J' = T J Tᵀ, with the homogeneous transform T between the frames.

    Args:
        vector: Parameters in frame B, shape (..., 10).
        rotation: Rotation matrix R_AB from B to A, shape (3, 3).
        translation: Origin of B in A, shape (3,) [m].

    Returns:
        Parameters in frame A, shape (..., 10).
    """
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, translation
    return vector_from_pseudo_inertia(T @ pseudo_inertia(vector) @ T.T)


def com_inertia_to_vector(mass: float, com: Array, inertia_about_com: Array) -> Array:
    """Inertial parameters (10,) from mass [kg], centre of mass (3,) [m] and inertia (3, 3) about it [kg·m²]."""
    S = skew(np.asarray(com))
    return np.concatenate([[mass], mass * np.asarray(com), inertia_vector(inertia_about_com - mass * S @ S)])


def vector_to_com_inertia(vector: Array) -> tuple[float, Array, Array]:
    """Mass [kg], centre of mass (3,) [m] and inertia (3, 3) about it [kg·m²] of inertial parameters (10,).

    The mass must not be zero.
    """
    mass = float(vector[0])
    com = vector[1:4] / mass
    S = skew(com)
    return mass, com, inertia_matrix(vector[4:]) + mass * S @ S


def about_com(vector: Array) -> Array:
    """Mass, centre of mass and inertia about the centre of mass, in parameter order, from inertial parameters (10,).

    If the mass is not positive, all values except the mass are NaN.
    """
    mass, h = float(vector[0]), np.asarray(vector[1:4])
    if not mass > 0.0:
        return np.concatenate([[mass], np.full(9, np.nan)])
    parallel = (h @ h * np.eye(3) - np.outer(h, h)) / mass
    return np.concatenate([[mass], h / mass, np.asarray(vector[4:]) - inertia_vector(parallel)])


def about_com_slope(vector: Array) -> Array:
    """Derivative (10, 10) of the result of `about_com` by the ten parameters; the mass must be positive."""
    mass, h = float(vector[0]), np.asarray(vector[1:4])
    parallel = (h @ h * np.eye(3) - np.outer(h, h)) / mass
    slope = np.eye(10)
    slope[1:4, 0], slope[1:4, 1:4] = -h / mass**2, np.eye(3) / mass
    slope[4:, 0] = inertia_vector(parallel) / mass
    for k, e in enumerate(np.eye(3)):
        slope[4:, 1 + k] = -inertia_vector(2.0 * h[k] * np.eye(3) - np.outer(e, h) - np.outer(h, e)) / mass
    return slope
