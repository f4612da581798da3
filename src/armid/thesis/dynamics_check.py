"""Sections 2.2, 3.1.1 and 3.1.2 of the thesis: frames, dynamics by Lagrange and Newton-Euler, the sign of gravity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.robot import forward_kinematics, frame_pose
from armid.thesis.lagrange import BETA_ORDER, lagrangian_mass, lagrangian_regressor, make_frames
from armid.thesis.published import published
from armid.thesis.setting import DESIGNED, HANGING, LITERAL, Setting, random_states

POSE = np.array([[0.1, -0.2, 0.3, -0.4, 0.5, -0.6, 0.7]])
"""Pose without symmetry for the results on the page, shape (1, 7) [rad]."""

STATE = (
    POSE,
    np.array([[0.3, -0.2, 0.1, 0.4, -0.5, 0.6, -0.7]]),
    np.array([[1.0, -1.0, 2.0, -2.0, 3.0, -3.0, 4.0]]),
)
"""Pose [rad], velocity [rad/s] and acceleration [rad/s²] for the results on the page, shape (1, 7) each."""

BALANCE_RATE, BALANCE_STEP = 100.0, 1e-4
"""Sample rate at which the energy balance is checked [Hz], and half the step of the difference quotient of the energy
[s]; with this step the error is 1e-6 W."""


@dataclass(frozen=True, eq=False, slots=True)
class Kinematics:
    """Results of section 3.1.1 of the thesis.

    Attributes:
        poses: Number of random poses at which equation (3.1) was compared with the description of the arm.
        rotation_error: Largest difference of an element of a rotation between equation (3.1) and the description.
        position_error: Largest difference of a coordinate of an origin between equation (3.1) and the description
            [m].
        heights: Heights of the origins of the frames and of the flange at q = 0, shape (8,) [m].
        pose: Pose to which `origins` and `rotation` belong, shape (7,) [rad].
        origins: Origins of the frames and of the flange in this pose, shape (8, 3) [m].
        rotation: Orientation of frame 7 in this pose, shape (3, 3).
    """

    poses: int
    rotation_error: float
    position_error: float
    heights: Array
    pose: Array
    origins: Array
    rotation: Array


@dataclass(frozen=True, eq=False, slots=True)
class Dynamics:
    """Results of sections 2.2 and 3.1.2 of the thesis.

    Attributes:
        states: Number of random states at which the forms of the dynamics were compared.
        regressor_error: Largest difference between elements of the Lagrangian and the Newton-Euler regressor, divided
            by the largest element.
        printed_derivative_error: Value of `regressor_error` if the Lagrangian regressor uses equation (3.42) as
            printed.
        mass_error: Largest difference between ∂²L/∂q̇∂q̇, with the Lagrangian L, and the mass matrix M(q), divided by
            the largest element.
        torque_error: Largest difference between M q̈ + C q̇ + g + friction and Y π, with mass matrix M, Coriolis
            matrix C, gravity torque g, regressor Y and standard parameters π, divided by the largest torque.
        triangle: Largest element of the blocks y_ij of link i and joint j, divided by the largest element of Y: first
            for the blocks with j > i, which equation (3.43) prints as nonzero, then for those with i > j.
        torque: Torque of the bodies of the description at a state without symmetry, shape (7,) [N·m].
        literal_torque: Value of `torque` with the potential energy of equation (2.21) as printed, shape (7,) [N·m].
        imbalance: Largest absolute value of d/dt (T + U) - τᵀ q̇, with kinetic energy T, potential energy U and
            torque τ, along Table A.1 in 20 s [W].
        literal_imbalance: Value of `imbalance` with U of equation (2.21) as printed [W].
    """

    states: int
    regressor_error: float
    printed_derivative_error: float
    mass_error: float
    torque_error: float
    triangle: tuple[float, float]
    torque: Array
    literal_torque: Array
    imbalance: float
    literal_imbalance: float


def kinematics(setting: Setting) -> Kinematics:
    """Compares the forward kinematics of Table 3.1 of the thesis with those of the description of the arm."""
    robot, frames = setting.hanging.dynamics.robot, make_frames(published())
    q = random_states(setting, seed=1).q
    R, p = frames.forward(q)
    own_R, own_p = forward_kinematics(robot, q)
    shown = []
    for pose in (np.zeros_like(POSE), POSE):
        _, origins = frames.forward(pose)
        shown.append(np.vstack([origins[0], frame_pose(robot, pose)[1]]))
    return Kinematics(
        len(q),
        float(np.abs(R - own_R).max()),
        float(np.abs(p - own_p).max()),
        shown[0][:, 2],
        POSE[0],
        shown[1],
        frames.forward(POSE)[0][0, -1],
    )


def beta_columns(model: DynamicsModel) -> list[int]:
    """Index in `model.parameters` of each inertial parameter, in the order of equation (3.8) of the thesis."""
    names: list[str] = [parameter.name for parameter in model.parameters]
    return [names.index(f"{symbol}_{link + 1}") for link in range(model.n) for symbol in BETA_ORDER]


def dynamics(setting: Setting) -> Dynamics:
    """Compares the Lagrangian regressor with armid's dynamics, and computes the effect of the sign of gravity."""
    model, theta = setting.hanging.dynamics, setting.theta
    frames, states = make_frames(published()), random_states(setting, seed=2)
    gravity, order = np.array(HANGING), beta_columns(model)
    Y = lagrangian_regressor(frames, states, gravity)
    printed = lagrangian_regressor(frames, states, gravity, printed=True)
    own = model.regressor(states)
    scale = float(np.abs(own[:, :, order]).max())
    M = model.mass_matrix(states.q, theta)
    tau = _torque_of_matrices(model, states, theta)
    expected = np.einsum("njp,p->nj", Y, theta[order]) + _friction(model, states, theta)
    state = Motion.of_states(*STATE)
    bodies = model.nominal_parameters()
    assert bodies is not None  # the built-in description has masses
    return Dynamics(
        states.samples,
        float(np.abs(Y - own[:, :, order]).max() / scale),
        float(np.abs(printed - Y).max() / scale),
        float(np.abs(lagrangian_mass(frames, states.q, theta[order].reshape(-1, 10)) - M).max() / np.abs(M).max()),
        float(np.abs(tau - expected).max() / np.abs(expected).max()),
        _triangle(Y),
        lagrangian_regressor(frames, state, gravity)[0] @ bodies[order],
        lagrangian_regressor(frames, state, np.array(LITERAL))[0] @ bodies[order],
        _imbalance(setting, model, model),
        _imbalance(setting, model, setting.literal.dynamics),
    )


def _torque_of_matrices(model: DynamicsModel, states: Motion, theta: Array) -> Array:
    """Torque by equation (3.3) of the thesis: M(q) q̈ + C(q, q̇) q̇ + g(q) + friction, shape (N, 7) [N·m].

    Args:
        model: Arm and torque terms.
        states: Positions, velocities and accelerations of N states.
        theta: Standard parameters, shape (p,).
    """
    tau = np.einsum("nij,nj->ni", model.mass_matrix(states.q, theta), states.ddq)
    tau += np.einsum("nij,nj->ni", model.coriolis_matrix(states.q, states.dq, theta), states.dq)
    return tau + model.gravity_torque(states.q, theta) + _friction(model, states, theta)


def _friction(model: DynamicsModel, states: Motion, theta: Array) -> Array:
    """Friction torque F_v q̇ + F_s sgn(q̇) with the coefficients FV and FS in theta, shape (N, 7) [N·m]."""
    of: dict[str, float] = {p.name: value for p, value in zip(model.parameters, theta, strict=True)}
    viscous, coulomb = (np.array([of[f"{symbol}_{j + 1}"] for j in range(model.n)]) for symbol in ("FV", "FS"))
    return viscous * states.dq + coulomb * np.sign(states.dq)


def _triangle(Y: Array) -> tuple[float, float]:
    """Largest elements of the regressor Y (N, 7, 70) in two triangles, divided by the largest element of Y.

    The first triangle contains the columns of links before the joint of the row, the second those of links after it.
    """
    blocks = np.abs(Y.reshape(len(Y), 7, 7, 10)).max(axis=(0, 3))  # joint j, link i
    return float(np.tril(blocks, -1).max() / blocks.max()), float(np.triu(blocks, 1).max() / blocks.max())


def _imbalance(setting: Setting, model: DynamicsModel, potential: DynamicsModel) -> float:
    """Largest absolute value of d/dt (T + U) - τᵀ q̇ along Table A.1 of the thesis in 20 s [W].

    U is the potential energy of the model `potential`; the kinetic energy T and the torque τ are those of the model
    `model`.
    """
    plan = setting.train.stretched(DESIGNED)
    motion = plan.sample(BALANCE_RATE)
    bodies = model.nominal_parameters()
    assert bodies is not None  # the built-in description has masses
    energy = []
    for step in (BALANCE_STEP, -BALANCE_STEP):
        at = plan.at(motion.time + step)
        energy.append(model.kinetic_energy(at.q, at.dq, bodies) + potential.potential_energy(at.q, bodies))
    power = np.einsum("nj,nj->n", model.torque(motion, bodies), motion.dq)
    return float(np.abs((energy[0] - energy[1]) / (2.0 * BALANCE_STEP) - power).max())
