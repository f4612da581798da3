"""Identifiable combinations of the inertial parameters of a tree, computed from its geometry.

The torque is zero for all motions if and only if, for all q and q̇, the kinetic energy is zero and the potential
energy is constant. Both energies are linear in the parameters. In the frame of link i they are linear functionals of
its ten parameters [Wensing2024]: ½ vᵀ I v with the spatial inertia I and a spatial velocity v that the link can have,
and g·h with the first moment h and a direction of gravity g that is possible in the frame. For joint i, let V_p be
the span of the velocities that the parent link can have, and W_p the span of the functionals of the parent link. S is
the axis of the joint. X(q) transforms velocities from the parent link to link i. K(q) transforms the ten parameters π
from link i to the parent link (π_parent = K π). With v_i = X v_p + S q̇_i, the torque of joint i depends on the
parameters of link i through

    SᵀI S,   SᵀI X(q) v  for v in V_p,   and the part of w K(q) that depends on q, for w in W_p.

All other combinations have the same effect on the torque as a change of the parameters of the parent link. They are
therefore added to the parameters of the parent link: π_parent += K(0) π. K and X are polynomials in cos q and sin q
(or in q), so a condition for all q is a condition on a finite number of coefficients. The possible velocities are a
union of subspaces, not one subspace. It is sufficient to use their spans, because every condition is linear in w or
v.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.kernel.tree import Tree
from armid.maths.inertia import PSEUDO_INERTIA_OF, spatial_inertia, vector_from_pseudo_inertia
from armid.maths.rotations import homogeneous, skew

SPAN_TOLERANCE = 1e-9
"""Singular value below which a direction of a span is a rounding error, with lengths in units of the arm size.
Geometry is exact to 1e-16. A direction of size s has a relative rounding error of 1e-16/s in the next joint. So for
lengths of a millionth of the arm size there is still a margin of a factor 1000."""

PREFERRED_DISTANCE = 1e-4
"""Distance from the span of earlier columns above which a column is preferred to later columns. Small offsets of real
arms are at least a hundredth of the arm size, and their square determines the distance."""

COEFFICIENT_FLOOR = 1e-12
"""Absolute value below which a coefficient of the regrouping is a rounding error, with lengths in units of the arm
size."""

_BODIES = np.array([spatial_inertia(e) for e in np.eye(10)])


# Fourier coefficients (1, cos, sin, cos 2q, sin 2q) of the products of 1, cos q, sin q in this order of pairs: 1·1,
# 1·cos, 1·sin, cos·cos, cos·sin, sin·sin. Powers of a prismatic q are independent already.
_FOURIER = np.array(
    [
        [1.0, 0.0, 0.0, 0.5, 0.0, 0.5],
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.5, 0.0, -0.5],
        [0.0, 0.0, 0.0, 0.0, 0.5, 0.0],
    ]
)


def structural_base(tree: Tree) -> tuple[NDArray[np.intp], Array]:
    """Finds the base parameters of the rigid bodies of a tree.

    Returns:
        Indices of the kept inertial parameters, shape (b,), which are the first independent ones from base to tip;
        and the regrouping matrix, shape (b, 10 n), with base = regrouping · standard.
    """
    length = _unit_of_length(tree)
    joints = [_joint(tree, i, length) for i in range(tree.n)]
    reduced = [echelon(C, SPAN_TOLERANCE) for C in _conditions(tree, joints)]
    # Each link's parameters: its own and those that its children's torques do not depend on.
    seen = np.eye(10 * tree.n).reshape(tree.n, 10, 10 * tree.n)
    for i in range(tree.n - 1, -1, -1):
        if tree.parent[i] >= 0:
            kept, E = reduced[i]
            unseen = seen[i].copy()
            unseen[kept] -= E @ seen[i]
            seen[tree.parent[i]] += joints[i].parameters_at_zero @ unseen
    columns = np.concatenate([10 * i + kept for i, (kept, _) in enumerate(reduced)])
    regrouping = np.vstack([E @ rows for (_, E), rows in zip(reduced, seen, strict=True)])
    units = parameter_units(tree)
    return columns, clean(regrouping) * units[columns, None] / units


def parameter_units(tree: Tree) -> Array:
    """Units 1, l, l² of mass, first moments and inertias, shape (10 n,), for the arm size l as unit of length."""
    length = _unit_of_length(tree)
    return np.tile(np.repeat([1.0, length, length**2], [1, 3, 6]), tree.n)


def echelon(matrix: Array, tolerance: float) -> tuple[NDArray[np.intp], Array]:
    """Finds the first independent columns of a matrix, and expresses all columns by these.

    A column whose distance from the span of earlier columns is less than `PREFERRED_DISTANCE` would give very large
    coefficients. It is kept only if the span is incomplete without it.

    Args:
        matrix: Matrix of shape (m, c) with entries of the order of one.
        tolerance: Largest distance from the span of the kept columns for which a column counts as dependent.

    Returns:
        Indices of the kept columns, shape (r,), and E, shape (r, c), with matrix = matrix[:, kept] · E; E[:, kept] is
        the identity.
    """
    rows, count = matrix.shape
    basis = np.zeros((min(rows, count), rows))
    kept: list[int] = []
    for least in (max(tolerance, PREFERRED_DISTANCE), tolerance):
        for j in range(count):
            rest = matrix[:, j].copy()
            for _ in range(2):  # twice gives orthogonality to rounding
                rest -= (basis[: len(kept)] @ rest) @ basis[: len(kept)]
            distance = float(np.linalg.norm(rest))
            if distance > least and len(kept) < len(basis):
                basis[len(kept)] = rest / distance
                kept.append(j)
    kept.sort()
    Q = basis[: len(kept)]
    E = np.empty((len(kept), count))
    E[:] = np.linalg.solve(Q @ matrix[:, kept], Q @ matrix)
    E[:, kept] = np.eye(len(kept))
    return np.array(kept, dtype=np.intp), clean(E)


def clean(matrix: Array, floor: float = COEFFICIENT_FLOOR) -> Array:
    """Sets entries below `floor` to zero; `floor` is increased in proportion in rows with entries above 100."""
    largest = np.abs(matrix).max(axis=1, keepdims=True, initial=100.0)
    return np.where(np.abs(matrix) < floor * largest / 100.0, 0.0, matrix)


@dataclass(frozen=True, eq=False, slots=True)
class _Joint:
    """Transforms of velocities and inertial parameters by a joint, as coefficients of polynomials in its position q.

    They are polynomials in cos q and sin q for a revolute joint, in q for a prismatic joint. The constant comes
    first.
    """

    subspace: Array  # (6,)
    velocities: Array  # X, (h, 6, 6), parent to link
    parameters: Array  # K, (k, 10, 10), link to parent
    parameters_at_zero: Array  # (10, 10)


def _conditions(tree: Tree, joints: list[_Joint]) -> list[Array]:
    """For each link, orthonormal functionals (r_i, 10) of its parameters on which the torque of its joint depends."""
    nothing = np.zeros((0, 6))
    weight = np.zeros((1, 10))
    if tree.gravity.any():
        weight[0, 1:4] = tree.gravity / np.linalg.norm(tree.gravity)
    velocities: list[Array] = []
    functionals: list[Array] = []
    result: list[Array] = []
    for joint, parent in zip(joints, tree.parent, strict=True):
        V, W = (velocities[parent], functionals[parent]) if parent >= 0 else (nothing, weight)
        S = joint.subspace
        carried = np.concatenate([V @ X.T for X in joint.velocities])
        own = np.einsum("a,kab,b->k", S, _BODIES, S)
        crossed = np.einsum("a,kab,vb->vk", S, _BODIES, carried)
        constant, *varying = (W @ K for K in joint.parameters)
        seen = _span(np.vstack([own, crossed, *varying]))
        result.append(seen)
        velocities.append(_span(np.vstack([carried, S])))
        functionals.append(_span(np.vstack([constant, seen])))
    return result


def _span(rows: Array) -> Array:
    """Orthonormal rows that span the same space as the given rows."""
    _, sizes, directions = np.linalg.svd(rows, full_matrices=False)
    return directions[sizes > SPAN_TOLERANCE]


def _joint(tree: Tree, i: int, length: float) -> _Joint:
    """Computes the transforms of velocities and inertial parameters by joint i, with lengths divided by `length`.

    `length` is the arm size [m].
    """
    R, p, a = tree.rotation[i], tree.translation[i] / length, tree.axis[i]
    placed = homogeneous(R, p)
    if tree.prismatic[i]:
        powers = [placed, placed @ _block(np.zeros((3, 3)), a)]
        velocities = [_velocity_map(R, R.T @ skew(p)), _velocity_map(np.zeros((3, 3)), R.T @ skew(R @ a))]
        subspace = np.concatenate([np.zeros(3), a])
        parameters = np.array(_products(powers))
    else:
        # Rodrigues: aaᵀ + cos q (1 - aaᵀ) + sin q S(a)
        turns = [np.outer(a, a), np.eye(3) - np.outer(a, a), skew(a)]
        powers = [placed @ _block(turn, np.zeros(3)) for turn in turns]
        powers[0][:3, 3], powers[0][3, 3] = p, 1.0
        velocities = [_velocity_map(R @ turn, (R @ turn).T @ skew(p)) for turn in turns]
        subspace = np.concatenate([a, np.zeros(3)])
        parameters = np.einsum("hk,kab->hab", _FOURIER, _products(powers))
    return _Joint(subspace, np.array(velocities), parameters, _products([placed])[0])


def _products(powers: list[Array]) -> list[Array]:
    """Matrices (10, 10) that transform inertial parameters, for all pairs of coefficients of a transform T.

    The pseudo-inertia J is transformed by J' = T J Tᵀ, and T is a polynomial with these coefficients.
    """
    result: list[Array] = []
    for T, U in combinations_with_replacement(powers, 2):
        moved = T @ PSEUDO_INERTIA_OF @ U.T
        if T is not U:
            moved = moved + np.swapaxes(moved, 1, 2)
        result.append(vector_from_pseudo_inertia(moved).T)
    return result


def _velocity_map(rotation: Array, shifted: Array) -> Array:
    """Transform [[Rᵀ, 0], [-RᵀS(p), Rᵀ]] of spatial velocity to a frame with rotation R and origin p."""
    return np.block([[rotation.T, np.zeros((3, 3))], [-shifted, rotation.T]])


def _block(rotation: Array, translation: Array) -> Array:
    """Matrix coefficient (4, 4) of a homogeneous transform that is a polynomial in the joint position.

    The last row is zero.
    """
    return np.block([[rotation, translation[:, None]], [np.zeros((1, 4))]])


def _unit_of_length(tree: Tree) -> float:
    """Arm size [m], the power of two just above the longest offset, so that a division by it is exact."""
    longest = float(np.abs(tree.translation).max())
    return float(2.0 ** np.ceil(np.log2(longest))) if longest > 0.0 else 1.0
