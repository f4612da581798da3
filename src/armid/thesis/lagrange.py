"""Regressor by differentiation of the Lagrangian of the thesis, without a Newton-Euler recursion.

The vectors β of equation (2.33) of the thesis are computed link by link from the frames of Table 3.1 by equation
(3.9), in hyper-dual numbers. The regressor is

    y_ij = d/dt (∂β_i / ∂q̇_j)ᵀ - (∂β_i / ∂q_j)ᵀ

for link i and joint j, with the time derivative along (q̇, q̈). This is equation (2.37) and (3.6a) of the thesis, and
the corrected form of equation (3.42). The compiled kernel is not used, only Table 3.1 and the lengths of the arm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.model.motion import Motion
from armid.thesis.hyperdual import HyperDual, bilinear, constant, cosine, hyper_dual, sine, stacked
from armid.thesis.published import Published

BETA_ORDER = ("M", "MX", "MY", "MZ", "XX", "XY", "XZ", "YY", "YZ", "ZZ")
"""Inertial parameters of a link in the order of equation (3.8) of the thesis."""

STEP = 1e-30
"""Imaginary part of a complex step; the derivative is exact to rounding, because nothing is subtracted."""

ANGLES = {"0": 0.0, "π": np.pi, "-π": -np.pi, "π/2": 0.5 * np.pi}


@dataclass(frozen=True, eq=False, slots=True)
class Frames:
    """Transform of each link frame relative to the frame before it, at joint angles of zero, from Table 3.1.

    Attributes:
        rotation: Rotations R_z(φ) R_x(θ), shape (7, 3, 3).
        translation: Translations [0, d_y, d_z], shape (7, 3) [m].
    """

    rotation: Array
    translation: Array

    def forward(self, q: Array) -> tuple[Array, Array]:
        """Rotations (N, 7, 3, 3) and origins (N, 7, 3) [m] of the frames in the base frame at positions (N, 7).

        This is equation (3.1) of the thesis.
        """
        R, p = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3))
        rotations, origins = [], []
        for k in range(len(self.rotation)):
            c, s, zero = np.cos(q[:, k]), np.sin(q[:, k]), np.zeros(len(q))
            turn = np.stack([c, -s, zero, s, c, zero, zero, zero, zero + 1.0], axis=-1).reshape(-1, 3, 3)
            p = p + R @ self.translation[k]
            R = R @ self.rotation[k] @ turn
            rotations.append(R)
            origins.append(p)
        return np.stack(rotations, axis=1), np.stack(origins, axis=1)


def make_frames(thesis: Published) -> Frames:
    """Converts the rows of Table 3.1 of the thesis to rotations and translations."""

    def length(symbol: str) -> float:
        return 0.0 if symbol == "0" else float(thesis.lengths[int(symbol.removeprefix("d_")) - 1])

    rotations = []
    for _, _, phi, theta, _ in thesis.frames:
        c, s = np.cos(ANGLES[phi]), np.sin(ANGLES[phi])
        about_z = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        c, s = np.cos(ANGLES[theta]), np.sin(ANGLES[theta])
        rotations.append(about_z @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]))
    translation = np.array([[0.0, length(y), length(z)] for y, z, *_ in thesis.frames])
    return Frames(np.array(rotations), translation)


def lagrangian_terms(frames: Frames, q: HyperDual, dq: HyperDual, gravity: Array) -> HyperDual:
    """Vectors β of equation (2.33) of the thesis for every link i, with which the Lagrangian is L_i = β_iᵀ π'_i.

    Args:
        frames: Transforms between the link frames, from Table 3.1 of the thesis.
        q: Positions, shape (..., 7).
        dq: Velocities, shape (..., 7).
        gravity: Acceleration of gravity in the base frame, shape (3,) [m/s²]; the thesis prints the opposite sign.

    Returns:
        Vectors β, shape (..., 7, 10), in the order of equation (3.8) of the thesis.
    """
    zero = q.at(0).times(0.0)
    nothing = stacked([zero, zero, zero])
    velocity, turning, origin = nothing, nothing, nothing
    R = constant(np.broadcast_to(np.eye(3), (*zero.parts.shape[1:], 3, 3)))
    links: list[HyperDual] = []
    for k in range(len(frames.rotation)):
        arm = constant(frames.translation[k])
        inward = _transposed(_turned(constant(frames.rotation[k]), q.at(k)))
        origin = origin + _apply(R, arm)
        velocity = _apply(inward, velocity + _cross(turning, arm))  # (3.9)
        turning = _apply(inward, turning) + stacked([zero, zero, dq.at(k)])
        R = bilinear(np.matmul, R, _transposed(inward))
        links.append(_beta(velocity, turning, origin, R, gravity))
    parts = np.stack([link.parts for link in links], axis=-2)
    return HyperDual(parts)


def _beta(velocity: HyperDual, turning: HyperDual, origin: HyperDual, R: HyperDual, gravity: Array) -> HyperDual:
    """Vector β of equation (2.33) of the thesis for one link, shape (..., 10).

    Args:
        velocity: Velocity of the origin of the link frame, in the axes of this frame.
        turning: Angular velocity, in the axes of the link frame.
        origin: Origin of the link frame, in the base frame.
        R: Rotation from the link frame to the base frame.
        gravity: Acceleration of gravity in the base frame, shape (3,) [m/s²].
    """
    g = constant(gravity)
    mass = _dot(velocity, velocity).times(0.5) + _dot(origin, g)
    first = _cross(velocity, turning) + _apply(_transposed(R), g)  # (v · (ω × r)) = (v × ω) · r
    x, y, z = (turning.at(k) for k in range(3))
    second = [(x * x).times(0.5), x * y, x * z, (y * y).times(0.5), y * z, (z * z).times(0.5)]
    return stacked([mass, *(first.at(k) for k in range(3)), *second])


def lagrangian_regressor(frames: Frames, motion: Motion, gravity: Array, *, printed: bool = False) -> Array:
    """Rigid-body regressor (N, 7, 70) from the Lagrangian, with columns link by link in the order `BETA_ORDER`.

    Args:
        frames: Transforms between the link frames, from Table 3.1 of the thesis.
        motion: Positions, velocities and accelerations at N instants.
        gravity: Acceleration of gravity, as in `lagrangian_terms`.
        printed: If true, equation (3.42) is used as the thesis prints it: it differentiates ∂β/∂q_j in time. The
            correct equation differentiates ∂β/∂q̇_j.
    """
    along = np.eye(motion.n)[:, None, :]  # directions j, shape (7, 1, 7)
    first_q, first_dq = (along, 0.0) if printed else (0.0, along)
    q = hyper_dual(motion.q, first_q, motion.dq)
    dq = hyper_dual(motion.dq, first_dq, motion.ddq)
    in_time = lagrangian_terms(frames, *_alike(q, dq), gravity).parts[3]
    q, dq = hyper_dual(motion.q, along, 0.0), constant(motion.dq)
    by_position = lagrangian_terms(frames, *_alike(q, dq), gravity).parts[1]
    Y = in_time - by_position
    return np.moveaxis(Y, 0, 1).reshape(motion.samples, motion.n, -1)


def lagrangian_mass(frames: Frames, q: Array, parameters: Array) -> Array:
    """Mass matrix M = ∂²L / ∂q̇ ∂q̇, shape (N, 7, 7), for inertial parameters (7, 10) in the order `BETA_ORDER`."""
    n = q.shape[1]
    one, other = np.eye(n)[:, None, None, :], np.eye(n)[None, :, None, :]
    dq = hyper_dual(np.zeros_like(q), one, other)
    terms = lagrangian_terms(frames, *_alike(constant(q), dq), np.zeros(3)).parts[3]
    return np.moveaxis(np.einsum("jknil,il->jkn", terms, parameters), 2, 0)


@dataclass(frozen=True, eq=False, slots=True)
class LinkMotion:
    """Motion of the link frames, computed from the joint axes in the base frame and not by recursion (3.9).

    Attributes:
        rotation: Rotations R_0 of the frames, shape (N, 7, 3, 3).
        origin: Origins d_0 of the frames, shape (N, 7, 3) [m].
        velocity: Velocities of the origins in their own frames, shape (N, 7, 3) [m/s].
        turning: Angular velocities in their own frames, shape (N, 7, 3) [rad/s].
    """

    rotation: Array
    origin: Array
    velocity: Array
    turning: Array


def link_motion(frames: Frames, q: Array, dq: Array) -> LinkMotion:
    """Computes the motion of the link frames from positions (N, 7) and velocities (N, 7)."""
    R, p = frames.forward(q)
    linear, angular = _jacobians(R, p, p)
    turned = np.swapaxes(R, -1, -2)
    velocity, turning = (np.einsum("nixy,niyj,nj->nix", turned, J, dq) for J in (linear, angular))
    return LinkMotion(R, p, velocity, turning)


def torque_of_bodies(frames: Frames, motion: Motion, physical: Array, gravity: Array) -> Array:
    """Torque M q̈ + C q̇ + g + friction, (3.3) of the thesis, from the physical parameters μ alone, shape (N, 7).

    M is equation (2.19) with the Jacobians of the centres of mass, C has the Christoffel symbols of M as (2.22) needs
    them, and g is the gradient of the potential energy.

    Args:
        frames: Transforms between the link frames, from Table 3.1 of the thesis.
        motion: Positions, velocities and accelerations at N instants.
        physical: Physical parameters μ, one row a link in the order of equation (3.40), shape (7, 12).
        gravity: Acceleration of gravity in the base frame, shape (3,) [m/s²].
    """
    n, joints = motion.samples, motion.n
    M, _ = _inertia_and_potential(frames, motion.q, physical, gravity)
    slope, g = np.zeros((n, joints, joints, joints)), np.zeros((n, joints))
    for k in range(joints):
        moved = motion.q + 1j * STEP * np.eye(joints)[k]
        by_k, potential = _inertia_and_potential(frames, moved, physical, gravity)
        slope[..., k], g[:, k] = by_k.imag / STEP, potential.imag / STEP
    # C_ij q̇_j with C_ij = Σ_k (∂M_ij/∂q_k + ∂M_ik/∂q_j − ∂M_jk/∂q_i) q̇_k / 2
    coriolis = np.einsum("nijk,nj,nk->ni", slope, motion.dq, motion.dq)
    coriolis -= 0.5 * np.einsum("njki,nj,nk->ni", slope, motion.dq, motion.dq)
    friction = physical[:, 10] * motion.dq + physical[:, 11] * np.sign(motion.dq)
    return np.einsum("nij,nj->ni", M.real, motion.ddq) + coriolis + g + friction


def _inertia_and_potential(frames: Frames, q: Array, physical: Array, gravity: Array) -> tuple[Array, Array]:
    """Mass matrix by equation (2.19), shape (N, 7, 7), and potential energy −Σ m gᵀ p, shape (N,) [J].

    The results are complex for complex positions q (N, 7), for derivatives by complex steps.
    """
    R, p = frames.forward(q)
    mass, centre = physical[:, 0], p + np.einsum("nixy,iy->nix", R, physical[:, 1:4])
    xx, xy, xz, yy, yz, zz = physical[:, 4:10].T
    tensor = np.moveaxis(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), -1, 0)
    linear, angular = _jacobians(R, p, centre)
    turned = np.einsum("nixa,iab,niyb->nixy", R, tensor, R)
    M = np.einsum("i,nixj,nixk->njk", mass, linear, linear) + np.einsum(
        "nixj,nixy,niyk->njk", angular, turned, angular
    )
    return M, -np.einsum("i,nix,x->n", mass, centre, gravity)


def _jacobians(R: Array, p: Array, points: Array) -> tuple[Array, Array]:
    """Jacobians of the velocities of points that are fixed to the links, and of the links' angular velocities.

    Args:
        R: Rotations of the link frames, shape (N, 7, 3, 3).
        p: Origins of the link frames, shape (N, 7, 3) [m].
        points: One point of each link, shape (N, 7, 3) [m].

    Returns:
        Two arrays of shape (N, 7, 3, 7).
    """
    carried = np.tril(np.ones((R.shape[1], R.shape[1])))  # link i is moved by joint j ≤ i
    axes = R[..., 2]
    arms = points[:, :, None, :] - p[:, None, :, :]
    linear = np.cross(axes[:, None, :, :], arms) * carried[..., None]
    angular = axes[:, None, :, :] * carried[..., None]
    return np.swapaxes(linear, -1, -2), np.swapaxes(angular, -1, -2)


def _alike(a: HyperDual, b: HyperDual) -> tuple[HyperDual, HyperDual]:
    shape = np.broadcast_shapes(a.parts.shape[1:], b.parts.shape[1:])

    def spread(x: HyperDual) -> HyperDual:
        lead = (1,) * (len(shape) - x.parts.ndim + 1)
        return HyperDual(np.broadcast_to(x.parts.reshape(4, *lead, *x.parts.shape[1:]), (4, *shape)))

    return spread(a), spread(b)


def _turned(rotation: HyperDual, angle: HyperDual) -> HyperDual:
    """Product of a rotation (3, 3) and the rotation about z by `angle` [rad]."""
    c, s = cosine(angle), sine(angle)
    zero, one = angle.times(0.0), constant(np.ones(angle.parts.shape[1:]))
    rows = [stacked([c, zero - s, zero]), stacked([s, c, zero]), stacked([zero, zero, one])]
    turn = HyperDual(np.stack([row.parts for row in rows], axis=-2))
    return bilinear(np.matmul, rotation, turn)


def _apply(R: HyperDual, x: HyperDual) -> HyperDual:
    return bilinear(lambda a, b: np.einsum("...ij,...j->...i", a, b), R, x)


def _transposed(R: HyperDual) -> HyperDual:
    return HyperDual(np.swapaxes(R.parts, -1, -2))


def _cross(a: HyperDual, b: HyperDual) -> HyperDual:
    return bilinear(np.cross, a, b)


def _dot(a: HyperDual, b: HyperDual) -> HyperDual:
    return bilinear(lambda x, y: np.einsum("...i,...i->...", x, y), a, b)
