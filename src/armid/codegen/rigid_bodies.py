"""Symbolic rigid-body dynamics of an arm whose links form a tree.

The algorithm is the recursion of Newton and Euler. Inertia is given about the origin of the link frame, so that
forces and moments are linear in the ten inertial parameters of a link [Khalil2004]. Let ω be the angular velocity of
a link, α its angular acceleration, a the acceleration of the origin of its frame minus gravity, and U = [α]× +
[ω]×[ω]×. Here [ω]× is the matrix with [ω]× v = ω × v. A link of mass m and first moment h needs the force m a + U h,
and a moment that is also linear in the inertial parameters. `_columns` computes force and moment for a unit value of
each parameter, from which both torque and regressor follow. Vectors are object arrays of scalars.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.codegen.graph import Scalar, call
from armid.kernel.tree import Tree

Symbols = NDArray[Any]
"""Type of an object array of scalars."""

ROUNDING = 4e-16
"""Tolerance with which elements of a rotation are rounded to -1, 0 or 1: two units in the last place of 1."""


@dataclass(frozen=True, eq=False, slots=True)
class Geometry:
    """Kinematic tree whose lengths, directions and gravity are scalars: numbers or nodes of a graph.

    Attributes:
        parent: Index of the joint whose link carries the joint; -1 for the base.
        prismatic: For each joint, true if it is prismatic.
        axis: Unit vectors of the axes in the frames of the joints, shape (n, 3).
        rotation: Rotation of frame i in the frame of its parent at q_i = 0, shape (n, 3, 3).
        translation: Origin of frame i in the frame of its parent at q_i = 0, shape (n, 3) [m].
        gravity: Acceleration of gravity in the base frame, shape (3,) [m/s²].
    """

    parent: tuple[int, ...]
    prismatic: tuple[bool, ...]
    axis: Symbols
    rotation: Symbols
    translation: Symbols
    gravity: Symbols

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.parent)

    def chain(self, i: int) -> list[int]:
        """Indices of the joints between link i and the base, beginning with joint i."""
        joints: list[int] = []
        while i >= 0:
            joints.append(i)
            i = self.parent[i]
        return joints


def numbers(tree: Tree) -> Geometry:
    """Geometry with the numbers of a robot; elements of rotations within `ROUNDING` of -1, 0 or 1 are rounded."""
    return Geometry(
        tuple(tree.parent.tolist()),
        tuple(bool(p) for p in tree.prismatic),
        _objects(_rounded(tree.axis)),
        _objects(_rounded(tree.rotation)),
        _objects(tree.translation),
        _objects(tree.gravity),
    )


def without_gravity(geometry: Geometry) -> Geometry:
    """The same geometry with gravity zero."""
    return replace(geometry, gravity=_ZERO)


def inverse_dynamics(
    geometry: Geometry,
    bodies: Sequence[Sequence[Scalar]],
    q: Sequence[Scalar],
    dq: Sequence[Scalar],
    ddq: Sequence[Scalar],
    other: Sequence[Scalar] | None = None,
) -> list[Scalar]:
    """Torque of each joint that a motion requires, for links with ten inertial parameters each (`bodies`).

    With a second velocity `other`, the torque is M(q) q̈ + C(q, q̇) q̇_other + g(q), where the Coriolis matrix C has
    the Christoffel symbols.
    """
    joints = _joints(geometry, q)
    states = _states(geometry, joints, dq, ddq, other)
    forces = [_weighted(_columns(state), body) for state, body in zip(states, bodies, strict=True)]
    return _gathered(geometry, joints, forces)


def mass_matrix(geometry: Geometry, bodies: Sequence[Sequence[Scalar]], q: Sequence[Scalar]) -> list[list[Scalar]]:
    """Mass matrix M(q), n rows of n scalars, computed by the composite-rigid-body algorithm."""
    n, joints = geometry.n, _joints(geometry, q)
    composites = [_Body.of(body) for body in bodies]
    M: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
    for i in reversed(range(n)):
        body, axis, parent = composites[i], geometry.axis[i], geometry.parent[i]
        if geometry.prismatic[i]:
            wrench = body.mass * axis, _cross(body.moment, axis)
        else:
            wrench = _cross(axis, body.moment), body.inertia @ axis
        for j in geometry.chain(i):
            M[i][j] = M[j][i] = _along(geometry, j, wrench)
            wrench = joints[j].wrench_to_parent(*wrench)
        if parent >= 0:
            composites[parent] = composites[parent].joined(body.seen_from(joints[i]))
    return M


def regressor(
    geometry: Geometry,
    kept: Sequence[Sequence[int]],
    q: Sequence[Scalar],
    dq: Sequence[Scalar],
    ddq: Sequence[Scalar],
    other: Sequence[Scalar] | None = None,
) -> dict[tuple[int, int, int], Scalar]:
    """Nonzero elements of the regressor of `inverse_dynamics`.

    A key contains the indices of joint, link and inertial parameter of the link.

    Args:
        geometry: The arm.
        kept: Indices of the inertial parameters whose columns are computed, for each link.
        q: Joint positions.
        dq: Joint velocities.
        ddq: Joint accelerations.
        other: Second velocity, with which the Coriolis matrix is multiplied; if not given, dq.
    """
    joints = _joints(geometry, q)
    entries: dict[tuple[int, int, int], Scalar] = {}
    jacobians: list[dict[int, tuple[Symbols, Symbols]]] = []
    for i, state in enumerate(_states(geometry, joints, dq, ddq, other)):
        parent, axis = geometry.parent[i], geometry.axis[i]
        carried = {} if parent < 0 else jacobians[parent]
        jacobian = {j: joints[i].motion_to_child(w, v) for j, (w, v) in carried.items()}
        jacobian[i] = (_ZERO, axis) if geometry.prismatic[i] else (axis, _ZERO)
        jacobians.append(jacobian)
        columns = _columns(state)
        for j, (w, v) in jacobian.items():
            for k in kept[i]:
                force, moment = columns[k]
                entry: Any = w @ moment + v @ force
                if entry != 0.0:
                    entries[j, i, k] = entry
    return entries


@dataclass(frozen=True, eq=False, slots=True)
class _Joint:
    """Pose of the frame of a joint in the frame of its parent, as a function of the joint position.

    If the joint rotates about an axis of its frame, `turn` is this rotation, and `rotation` is the constant rotation
    before it, which for most arms needs no operations. Otherwise `rotation` is the product of both, and `turn` is
    `None`.
    """

    rotation: Symbols  # (3, 3)
    turn: tuple[int, Scalar, Scalar] | None  # axis, cosine, sine
    translation: Symbols  # (3,) in the parent's frame

    def to_parent(self, v: Symbols) -> Symbols:
        """Transforms a vector v from this frame to the frame of the parent: R v, where R is the rotation."""
        if self.turn is not None:
            axis, c, s = self.turn
            v = _turned(v, axis, c, s)
        return self.rotation @ v

    def to_child(self, v: Symbols) -> Symbols:
        """Transforms a vector v from the frame of the parent to this frame: Rᵀ v, where R is the rotation."""
        v = self.rotation.T @ v
        if self.turn is None:
            return v
        axis, c, s = self.turn
        return _turned(v, axis, c, -s)

    def wrench_to_parent(self, force: Symbols, moment: Symbols) -> tuple[Symbols, Symbols]:
        """Transforms a force and a moment from this frame to the frame of the parent.

        The given moment is about the origin of this frame, the result about the origin of the parent's frame.
        """
        force = self.to_parent(force)
        return force, self.to_parent(moment) + _cross(self.translation, force)

    def motion_to_child(self, angular: Symbols, linear: Symbols) -> tuple[Symbols, Symbols]:
        """Transforms angular and linear velocity of the parent link from the frame of the parent to this frame.

        The linear velocity is that of the point of the parent link at the origin of the frame.
        """
        return self.to_child(angular), self.to_child(linear + _cross(angular, self.translation))


@dataclass(frozen=True, eq=False, slots=True)
class _State:
    """Motion of the frame of a link.

    Products of velocities are symmetric in two velocities, which are the same in the usual equations of motion.

    Attributes:
        omega: Angular velocity ω.
        other: Second angular velocity; the same object as `omega` if there is only one velocity.
        alpha: Angular acceleration α.
        acceleration: Acceleration of the origin of the frame minus gravity.
        products: Products xx, yy, zz, xy, xz, yz of the elements of the angular velocities.
        U: Matrix [α]× + [ω]×[ω]×.
    """

    omega: Symbols
    other: Symbols
    alpha: Symbols
    acceleration: Symbols
    products: tuple[Scalar, ...]
    U: Symbols


@dataclass(frozen=True, eq=False, slots=True)
class _Body:
    """Mass, first moment, and inertia about the origin of a frame, of a rigid body."""

    mass: Scalar
    moment: Symbols
    inertia: Symbols

    @classmethod
    def of(cls, body: Sequence[Scalar]) -> _Body:
        m, x, y, z, xx, xy, yy, xz, yz, zz = body
        return cls(m, _vector(x, y, z), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=object))

    def joined(self, other: _Body) -> _Body:
        return _Body(self.mass + other.mass, self.moment + other.moment, self.inertia + other.inertia)

    def seen_from(self, joint: _Joint) -> _Body:
        """The same body with first moment and inertia about the origin of the parent's frame."""
        p, h = joint.translation, joint.to_parent(self.moment)
        half = np.column_stack([joint.to_parent(column) for column in self.inertia.T])
        turned = _symmetric(np.array([joint.to_parent(row) for row in half], dtype=object))
        # [h]ᵀ[p] + [p]ᵀ[h] + m [p]ᵀ[p], the shift by p.
        cross = np.outer(h, p) + np.outer(p, h) + self.mass * np.outer(p, p)
        shifted = _symmetric(turned - cross)
        trace = cross[0, 0] + cross[1, 1] + cross[2, 2]
        for k in range(3):
            shifted[k, k] = turned[k, k] + (trace - cross[k, k])
        return _Body(self.mass, h + self.mass * p, shifted)


def _joints(geometry: Geometry, q: Sequence[Scalar]) -> list[_Joint]:
    return [_joint(geometry, i, q[i]) for i in range(geometry.n)]


def _joint(geometry: Geometry, i: int, q: Scalar) -> _Joint:
    rotation, translation, axis = geometry.rotation[i], geometry.translation[i], geometry.axis[i]
    if geometry.prismatic[i]:
        return _Joint(rotation, None, translation + (rotation @ axis) * q)
    c, s = call("cos", q), call("sin", q)
    along = [k for k in range(3) if isinstance(axis[k], float) and abs(axis[k]) == 1.0]
    if along:
        return _Joint(rotation, (along[0], c, axis[along[0]] * s), translation)
    x, y, z = axis
    spin = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]], dtype=object)
    fixed = np.outer(axis, axis)
    turn = fixed + c * (_objects(np.eye(3)) - fixed) + s * spin
    return _Joint(rotation @ turn, None, translation)


def _states(
    geometry: Geometry,
    joints: Sequence[_Joint],
    dq: Sequence[Scalar],
    ddq: Sequence[Scalar],
    other: Sequence[Scalar] | None = None,
) -> list[_State]:
    """Motion of the frame of every link, computed from the base to the tips.

    With a second velocity `other`, each product of velocities is the symmetric product of both velocities.
    """
    base = _state(_ZERO, _ZERO, _ZERO, -geometry.gravity)
    states: list[_State] = []
    for i, joint in enumerate(joints):
        before = states[geometry.parent[i]] if geometry.parent[i] >= 0 else base
        omega, alpha = joint.to_child(before.omega), joint.to_child(before.alpha)
        omega_other = omega if other is None else joint.to_child(before.other)
        acceleration = joint.to_child(before.acceleration + before.U @ joint.translation)
        velocity = dq[i] * geometry.axis[i]
        velocity_other = velocity if other is None else other[i] * geometry.axis[i]
        along = ddq[i] * geometry.axis[i]
        turned = _cross(omega, velocity_other)
        if other is not None:
            turned = 0.5 * (turned + _cross(omega_other, velocity))
        if geometry.prismatic[i]:
            acceleration = acceleration + along + 2.0 * turned
        else:
            alpha = alpha + along + turned
            omega, omega_other = omega + velocity, omega_other + velocity_other
        states.append(_state(omega, omega if other is None else omega_other, alpha, acceleration))
    return states


def _state(omega: Symbols, other: Symbols, alpha: Symbols, acceleration: Symbols) -> _State:
    a, b, c = alpha
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    products = tuple(_symmetric_product(omega, other, j, k) for j, k in pairs)
    xx, yy, zz, xy, xz, yz = products
    U = [[-(yy + zz), xy - c, xz + b], [xy + c, -(xx + zz), yz - a], [xz - b, yz + a, -(xx + yy)]]
    return _State(omega, other, alpha, acceleration, products, np.array(U, dtype=object))


def _symmetric_product(a: Symbols, b: Symbols, j: int, k: int) -> Scalar:
    """The product ½ (a_j b_k + a_k b_j), which is a_j a_k if a and b are the same vector."""
    if a is b or j == k:
        return a[j] * b[k]
    return 0.5 * (a[j] * b[k] + a[k] * b[j])


def _columns(state: _State) -> list[tuple[Symbols, Symbols]]:
    """Force, and moment about the origin of the link frame, for a unit value of each inertial parameter."""
    (a, b, c), U = state.alpha, state.U
    u, v, w = state.acceleration
    xx, yy, zz, xy, zx, yz = state.products
    diagonal = [_vector(a, zx, -xy), _vector(-yz, b, xy), _vector(yz, -zx, c)]
    xy_column = _vector(-U[2, 0], U[2, 1], xx - yy)
    xz_column = _vector(U[1, 0], zz - xx, -U[1, 2])
    yz_column = _vector(yy - zz, -U[0, 1], U[0, 2])
    moments = [diagonal[0], xy_column, diagonal[1], xz_column, yz_column, diagonal[2]]
    first = [_vector(0.0, -w, v), _vector(w, 0.0, -u), _vector(-v, u, 0.0)]
    return [
        (state.acceleration, _ZERO),
        *((U[:, k], first[k]) for k in range(3)),
        *((_ZERO, moment) for moment in moments),
    ]


def _weighted(columns: list[tuple[Symbols, Symbols]], body: Sequence[Scalar]) -> tuple[Symbols, Symbols]:
    """Force and moment that a body requires for its motion: columns weighted with its ten inertial parameters."""
    force, moment = _ZERO, _ZERO
    for (f, m), parameter in zip(columns, body, strict=True):
        force, moment = force + parameter * f, moment + parameter * m
    return force, moment


def _gathered(geometry: Geometry, joints: Sequence[_Joint], wrenches: list[tuple[Symbols, Symbols]]) -> list[Scalar]:
    """Torque of each joint from the forces and moments on the links, which are summed from the tips to the base."""
    total = list(wrenches)
    torque: list[Scalar] = [0.0] * geometry.n
    for i in reversed(range(geometry.n)):
        torque[i] = _along(geometry, i, total[i])
        parent = geometry.parent[i]
        if parent >= 0:
            force, moment = joints[i].wrench_to_parent(*total[i])
            total[parent] = total[parent][0] + force, total[parent][1] + moment
    return torque


def _along(geometry: Geometry, j: int, wrench: tuple[Symbols, Symbols]) -> Scalar:
    """Component along the axis of joint j: of the moment for a revolute joint, of the force for a prismatic joint."""
    return geometry.axis[j] @ (wrench[0] if geometry.prismatic[j] else wrench[1])


def _turned(v: Symbols, axis: int, c: Scalar, s: Scalar) -> Symbols:
    """Vector v rotated about axis x, y or z (0, 1 or 2) by an angle with cosine c and sine s."""
    result = v.copy()
    j, k = (axis + 1) % 3, (axis + 2) % 3
    result[j], result[k] = c * v[j] - s * v[k], s * v[j] + c * v[k]
    return result


def _cross(a: Symbols, b: Symbols) -> Symbols:
    return _vector(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _vector(x: Scalar, y: Scalar, z: Scalar) -> Symbols:
    return np.array([x, y, z], dtype=object)


def _symmetric(matrix: Symbols) -> Symbols:
    """Symmetric matrix with the upper triangle of a matrix."""
    result = matrix.copy()
    for i, j in ((1, 0), (2, 0), (2, 1)):
        result[i, j] = result[j, i]
    return result


def _objects(values: Any) -> Symbols:
    return np.array(np.asarray(values).tolist(), dtype=object)


def _rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    nearest = np.rint(values)
    return np.where(np.abs(values - nearest) <= ROUNDING, nearest, values) + 0.0


_ZERO = _objects(np.zeros(3))
