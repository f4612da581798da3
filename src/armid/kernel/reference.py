"""NumPy twin of the kernel: rigid-body dynamics of a tree, for N samples at once.

This module defines the results of the compiled kernel. All functions use three spatial quantities of each link i,
taken at the origin of the link frame, in its axes, angular part first [Featherstone2008]: the Jacobian J_i (v_i = J_i
q̇), its time derivative D_i (acceleration = J_i q̈ + D_i q̇), and the acceleration of gravity G_i. Gravity is
included as an additional acceleration -G_i of every link.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.kernel.tree import Tree
from armid.maths.inertia import spatial_inertia
from armid.maths.rotations import axis_rotation, skew

_UNIT_BODIES = np.array([spatial_inertia(e) for e in np.eye(10)])


@dataclass(slots=True)
class _Link:
    """Link i at N samples: its pose in the base frame, its Jacobian J_i with the derivative D_i, gravity G_i."""

    rotation: Array  # (N, 3, 3)
    origin: Array  # (N, 3)
    jacobian: Array  # (N, 6, n)
    derivative: Array  # (N, 6, n)
    gravity: Array  # (N, 6)


def regressor(tree: Tree, q: Array, dq: Array, ddq: Array) -> Array:
    """Regressor Y with torque = Y · parameters, shape (N, n, 10 n); the 10 n parameters are ordered link by link."""
    Y = np.empty((len(q), tree.n, 10 * tree.n))
    for i, link in enumerate(_links(tree, q, dq)):
        v, a = _velocity_acceleration(link, dq, ddq)
        body = _momentum_columns(a) + _cross_force(v) @ _momentum_columns(v)
        Y[:, :, 10 * i : 10 * i + 10] = _transpose(link.jacobian) @ body
    return Y


def inverse_dynamics(tree: Tree, inertial: Array, q: Array, dq: Array, ddq: Array) -> Array:
    """Joint torque (N, n) of rigid links with inertial parameters (n, 10).

    It is the sum of J_iᵀ (I_i a_i + v_i ×* I_i v_i) over the links i, with the spatial inertia I_i, the spatial
    velocity v_i, and the spatial acceleration a_i minus gravity.
    """
    tau = np.zeros((len(q), tree.n))
    for link, inertia in zip(_links(tree, q, dq), map(spatial_inertia, inertial), strict=True):
        v, a = _velocity_acceleration(link, dq, ddq)
        force = a @ inertia + _apply(_cross_force(v), v @ inertia)
        tau += _apply(_transpose(link.jacobian), force)
    return tau


def mass_matrix(tree: Tree, inertial: Array, q: Array) -> Array:
    """Mass matrix M(q) = Σ J_iᵀ I_i J_i with the spatial inertia I_i of each link i, shape (N, n, n)."""
    M = np.zeros((len(q), tree.n, tree.n))
    for link, inertia in zip(_links(tree, q, np.zeros_like(q)), map(spatial_inertia, inertial), strict=True):
        M += _transpose(link.jacobian) @ inertia @ link.jacobian
    return M


def coriolis_matrix(tree: Tree, inertial: Array, q: Array, dq: Array) -> Array:
    """Coriolis matrix C(q, q̇) with Christoffel symbols, shape (N, n, n) [Echeandia2021].

    It is the sum of J_iᵀ (I_i D_i + B_i J_i) over the links i, with the spatial inertia I_i and a matrix B_i that is
    linear in I_i and in the velocity of the link.
    """
    C = np.zeros((len(q), tree.n, tree.n))
    for link, inertia in zip(_links(tree, q, dq), map(spatial_inertia, inertial), strict=True):
        v = _apply(link.jacobian, dq)
        # B = ½ (v×* I - I v× + (I v)×̄*) makes the product of velocities symmetric.
        B = _cross_force(v) @ inertia - inertia @ _cross_motion(v) + _momentum_cross(v @ inertia)
        C += _transpose(link.jacobian) @ (inertia @ link.derivative + 0.5 * B @ link.jacobian)
    return C


def gravity_torque(tree: Tree, inertial: Array, q: Array) -> Array:
    """Gravity torque g(q), shape (N, n): the joint torque that holds the arm at rest."""
    still = np.zeros_like(q)
    return inverse_dynamics(tree, inertial, q, still, still)


def kinetic_energy(tree: Tree, inertial: Array, q: Array, dq: Array) -> Array:
    """Kinetic energy of rigid links with inertial parameters (n, 10) at N samples, shape (N,) [J]."""
    velocities = (_apply(link.jacobian, dq) for link in _links(tree, q, dq))
    pairs = zip(velocities, map(spatial_inertia, inertial), strict=True)
    return sum((0.5 * np.sum(v * (v @ inertia), -1) for v, inertia in pairs), np.zeros(len(q)))


def potential_energy(tree: Tree, inertial: Array, q: Array) -> Array:
    """Potential energy of gravity, shape (N,) [J]; a mass at the origin of the base frame has energy zero."""
    links = _links(tree, q, np.zeros_like(q))
    moments = (b[0] * link.origin + link.rotation @ b[1:4] for link, b in zip(links, inertial, strict=True))
    return sum((-moment @ tree.gravity for moment in moments), np.zeros(len(q)))


def _links(tree: Tree, q: Array, dq: Array) -> list[_Link]:
    """Computes rotation, origin, Jacobian, its derivative and gravity of all links, from base to tips."""
    samples, n = q.shape
    still = np.zeros((samples, 6, n))
    gravity = np.broadcast_to(np.concatenate([np.zeros(3), tree.gravity]), (samples, 6))
    base = _Link(np.broadcast_to(np.eye(3), (samples, 3, 3)), np.zeros((samples, 3)), still, still, gravity)
    links: list[_Link] = []
    for i in range(n):
        parent = links[tree.parent[i]] if tree.parent[i] >= 0 else base
        R, p = _placement(tree, i, q[:, i])
        X = _motion_transform(R, p)
        axis = tree.axis[i]
        subspace = np.concatenate([0.0 * axis, axis] if tree.prismatic[i] else [axis, 0.0 * axis])
        jacobian, derivative = X @ parent.jacobian, X @ parent.derivative
        jacobian[:, :, i] = subspace
        derivative[:, :, i] = _cross_motion(_apply(jacobian, dq)) @ subspace
        origin = parent.origin + _apply(parent.rotation, p)
        links.append(_Link(parent.rotation @ R, origin, jacobian, derivative, _apply(X, parent.gravity)))
    return links


def _placement(tree: Tree, i: int, q: Array) -> tuple[Array, Array]:
    """Rotation (N, 3, 3) and origin (N, 3) of frame i in its parent's frame."""
    R, p = tree.rotation[i], tree.translation[i]
    if tree.prismatic[i]:
        return np.broadcast_to(R, (len(q), 3, 3)), p + q[:, None] * (R @ tree.axis[i])
    return R @ axis_rotation(tree.axis[i], q), np.broadcast_to(p, (len(q), 3))


def _velocity_acceleration(link: _Link, dq: Array, ddq: Array) -> tuple[Array, Array]:
    """Spatial velocity of a link, and its spatial acceleration minus gravity, shape (N, 6) each."""
    acceleration = _apply(link.jacobian, ddq) + _apply(link.derivative, dq) - link.gravity
    return _apply(link.jacobian, dq), acceleration


def _momentum_columns(v: Array) -> Array:
    """Matrices (N, 6, 10) by which the inertial parameters of a link are multiplied to obtain its spatial momentum.

    The spatial velocity v of the link has shape (N, 6).
    """
    return np.einsum("kab,nb->nak", _UNIT_BODIES, v)


def _motion_transform(R: Array, p: Array) -> Array:
    """Transforms (N, 6, 6) of spatial motion from the parent's frame to a frame with rotation R and origin p."""
    X = np.zeros((len(R), 6, 6))
    X[:, :3, :3] = X[:, 3:, 3:] = _transpose(R)
    X[:, 3:, :3] = -_transpose(R) @ skew(p)
    return X


def _cross_motion(v: Array) -> Array:
    """Spatial cross product v× for motion vectors, as matrices (N, 6, 6)."""
    X = np.zeros((len(v), 6, 6))
    X[:, :3, :3] = X[:, 3:, 3:] = skew(v[:, :3])
    X[:, 3:, :3] = skew(v[:, 3:])
    return X


def _cross_force(v: Array) -> Array:
    """Spatial cross product v×* for force vectors, as matrices (N, 6, 6)."""
    return -_transpose(_cross_motion(v))


def _momentum_cross(f: Array) -> Array:
    """Matrices f×̄* of spatial forces f (N, 6), shape (N, 6, 6), defined by (f×̄*) v = v ×* f."""
    X = np.zeros((len(f), 6, 6))
    X[:, :3, :3] = -skew(f[:, :3])
    X[:, :3, 3:] = X[:, 3:, :3] = -skew(f[:, 3:])
    return X


def _apply(A: Array, x: Array) -> Array:
    """Products of matrices A_k (N, a, b) and vectors x_k (N, b) for each sample k, shape (N, a)."""
    return (A @ x[..., None])[..., 0]


def _transpose(A: Array) -> Array:
    return np.swapaxes(A, -1, -2)
