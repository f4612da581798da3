"""Cones that contain the standard parameters of real bodies.

A real body with given inertial parameters exists if and only if its pseudo-inertia is positive semidefinite
[Wensing2018]. Viscous friction, Coulomb friction and rotor inertia are not negative.
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.estimation.problem import StandardParameters
from armid.maths.conic_solver import Cone, upper_triangle
from armid.maths.inertia import PSEUDO_INERTIA_OF, pseudo_inertia

EPSILON = 1e-6
"""Smallest eigenvalue that a pseudo-inertia is required to have [kg and kg·m²]: a milligram, so that no mass is
zero."""


def consistency_cones(
    standard: StandardParameters, variables: int, *, epsilon: float = EPSILON, heaviest: float | None = None
) -> list[Cone]:
    """Cones of the standard parameters of real bodies, in a program whose first p variables are these parameters.

    Args:
        standard: The standard parameters.
        variables: Number of variables of the program.
        epsilon: Lower limit of the eigenvalues of a pseudo-inertia [kg and kg·m²].
        heaviest: Upper bound of the mass of each link [kg]; no bound if not given.
    """
    i, j = upper_triangle(4)
    cones: list[Cone] = []
    for own in standard.inertial:
        matrix = np.zeros((10, variables))
        matrix[:, own] = PSEUDO_INERTIA_OF[:, i, j].T
        cones.append(Cone("semidefinite", matrix, -epsilon * (i == j)))
    bounded = np.flatnonzero(standard.nonnegative)
    if len(bounded):
        cones.append(Cone("nonnegative", np.eye(variables)[bounded], np.zeros(len(bounded))))
    if heaviest is not None and len(standard.inertial):
        masses = standard.inertial[:, 0]
        cones.append(Cone("nonnegative", -np.eye(variables)[masses], np.full(len(masses), heaviest)))
    return cones


def smallest_eigenvalues(standard: StandardParameters, values: Array) -> Array:
    """Smallest eigenvalue of each link's pseudo-inertia, shape (links,)."""
    if not len(standard.inertial):
        return np.zeros(0)
    return np.asarray(np.linalg.eigvalsh(pseudo_inertia(values[standard.inertial]))[:, 0], dtype=np.float64)
