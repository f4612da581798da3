"""Upper bound of the second time derivative of the torque of rigid links along a series.

Sums of amplitudes bound every time derivative of a joint position along a series. Along the kinematic chain, bounds
of the norms of vectors follow from these sums. A vector u that is fixed in a link has the derivative u' = ω x u.
Bounds of the norms of the derivatives of u therefore follow from bounds of the angular velocity ω and its
derivatives, with Leibniz's rule and the triangle inequality. For a tensor that is fixed in a link, the bound of the
first derivative is twice as large. A jet is the list of such bounds for a quantity and its derivatives in ascending
order, all in the inertial frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np

from armid.checked_array import Array
from armid.kernel import Tree

Jet = Sequence[float]

ORDERS = 4
"""Highest order of the time derivatives of the positions on which the second time derivative of the torque
depends."""


def torque_curvature(tree: Tree, inertial: Array, derivatives: Array) -> Array:
    """Upper bound of the second time derivative of the torque of every joint, shape (n,) [N·m/s² or N/s²].

    Args:
        tree: The arm.
        inertial: Inertial parameters of the links, shape (n, 10); they need not be physically consistent.
        derivatives: Upper bounds of the absolute values of the joint positions and of their first four time
            derivatives, shape (5, n).
    """
    turning, fixed, levers = _chain(tree, derivatives)
    gravity = float(np.linalg.norm(tree.gravity))
    moments: list[Jet] = []
    forces: list[Jet] = []
    reach: list[Jet] = []  # distances of the links' origins from the base
    for i, link in enumerate(inertial):
        parent = int(tree.parent[i])
        reach.append(levers[i] if parent < 0 else _sum(reach[parent], levers[i]))
        acceleration = (reach[i][2] + gravity, reach[i][3], reach[i][4])
        mass, first, second = abs(float(link[0])), float(np.linalg.norm(link[1:4])), _size(link[4:])
        forces.append([mass * a + first * u for a, u in zip(acceleration, fixed[i][2:], strict=True)])
        offset_moment = _product([first * u for u in fixed[i][:3]], acceleration)
        momentum = _product([second * t for t in _tensor(turning[i])], turning[i])
        moments.append(_sum(offset_moment, momentum[1:]))
    result = np.zeros(tree.n)
    for j in range(tree.n):
        parent = int(tree.parent[j])
        axis = _rest() if parent < 0 else fixed[parent]
        total: Jet = (0.0, 0.0, 0.0)
        distance: dict[int, Jet] = {j: (0.0,) * (ORDERS + 1)}
        for i in tree.subtree(j):
            if i != j:
                distance[i] = _sum(distance[int(tree.parent[i])], levers[i])
            load = forces[i] if tree.prismatic[j] else _sum(moments[i], _product(distance[i][:3], forces[i]))
            total = _sum(total, load)
        result[j] = _product(axis[:3], total)[2]
    return result


def _chain(tree: Tree, derivatives: Array) -> tuple[list[Jet], list[Jet], list[Jet]]:
    """Jets of the angular velocities of links, of unit vectors fixed in them, and of origins relative to parents."""
    turning: list[Jet] = []
    fixed: list[Jet] = []
    levers: list[Jet] = []
    for i in range(tree.n):
        parent = int(tree.parent[i])
        before, carried = ((0.0,) * ORDERS, _rest()) if parent < 0 else (turning[parent], fixed[parent])
        q = derivatives[:, i].tolist()
        lever = [float(np.linalg.norm(tree.translation[i])) * u for u in carried]
        if tree.prismatic[i]:
            turning.append(before)
            lever = list(_sum(lever, _product(q, carried)))
        else:
            turning.append(_sum(before, _product(q[1:], carried[:ORDERS])))
        fixed.append(_turned(turning[i], 1.0))
        levers.append(lever)
    return turning, fixed, levers


def _rest() -> Jet:
    """Jet of a constant unit vector: 1 for its norm and zeros for its first `ORDERS` time derivatives."""
    return (1.0, *(0.0,) * ORDERS)


def _sum(a: Jet, b: Jet) -> Jet:
    return [x + y for x, y in zip(a, b, strict=True)]


def _product(a: Jet, b: Jet) -> Jet:
    """Jet of a product, from the jets of both factors, by Leibniz's rule."""
    return [sum(comb(k, i) * a[i] * b[k - i] for i in range(k + 1)) for k in range(len(a))]


def _turned(turning: Jet, factor: float) -> Jet:
    """Jet of a quantity x of norm one that is fixed in a link, with |x'| ≤ factor · |ω| · |x|.

    `turning` is the jet of the angular velocity ω of the link.
    """
    result = [1.0]
    for k in range(len(turning)):
        result.append(factor * sum(comb(k, i) * turning[i] * result[k - i] for i in range(k + 1)))
    return result


def _tensor(turning: Jet) -> Jet:
    """Jet of a tensor T of norm one that is fixed in a link, with T' = ω x T - T x ω."""
    return _turned(turning, 2.0)[: len(turning)]


def _size(second: Array) -> float:
    """Spectral norm of the inertia matrix with the entries Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""
    xx, xy, yy, xz, yz, zz = second
    return float(np.abs(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])).max())
