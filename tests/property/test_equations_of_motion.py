"""Laws of the equations of motion: forward dynamics, bias, Coriolis matrix and the regressor of Slotine and Li."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from armid.errors import ArmidError, ModelError
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.equations_of_motion import bias_torque, forward_dynamics, slotine_li_regressor
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Hysteresis, LoadCoulomb, RigidBody, RotorInertia, Viscous
from armid.runs.callable_model import CallableModel
from trees import random_inertial, random_states, random_tree, robot_of, structured_tree

ROUNDING = 1e-11
"""Relative to the largest entry: different orders of the same sums over at most six joints, and polarisation."""

STEP, SLOPE = 1e-5, 1e-7
"""Step of central differences, and their relative error: STEP² and rounding over STEP, with a margin of 1000."""

SAMPLES = 6

FRICTION = 0.05
"""Coefficient of load-dependent friction, as in gears."""


def made(seed: int) -> tuple[DynamicsModel, np.ndarray, Motion]:
    """A model with friction of velocity, earlier motion and load; parameters of bodies that exist; a motion."""
    rng, n = np.random.default_rng(seed), 1 + seed % 6
    tree = (random_tree if seed % 2 else structured_tree)(rng, n)
    terms = (RigidBody(), Viscous(), Coulomb(0.1), Hysteresis((0.1,)), LoadCoulomb(0.1), RotorInertia())
    model = DynamicsModel(robot_of(tree), terms, random_inertial(rng, n))
    theta = np.abs(rng.normal(size=len(model.parameters)))
    theta[[k for k, p in enumerate(model.parameters) if p.kind == LoadCoulomb.name]] = FRICTION
    theta[model.inertial_columns] = random_inertial(rng, n).ravel()
    return model, theta, model.remember(Motion.of_states(*random_states(rng, SAMPLES, n)))


@pytest.fixture(params=range(12))
def arm(request: pytest.FixtureRequest) -> tuple[DynamicsModel, np.ndarray, Motion]:
    return made(request.param)


def close(a: np.ndarray, b: np.ndarray, tolerance: float = ROUNDING) -> None:
    assert np.abs(a - b).max() <= tolerance * max(np.abs(a).max(), np.abs(b).max())


def friction_of(model: DynamicsModel, motion: Motion, theta: np.ndarray) -> np.ndarray:
    """Torque of everything but links and rotors."""
    own = theta.copy()
    own[model.inertial_columns] = 0.0
    own[[k for k, p in enumerate(model.parameters) if p.kind == RotorInertia.name]] = 0.0
    return model.torque(motion, own)


def test_forward_dynamics_inverts_inverse_dynamics(arm):
    model, theta, motion = arm
    torque = model.torque(motion, theta)
    M = model.mass_matrix(motion.q, theta)
    found = forward_dynamics(model, motion, torque, theta)
    close(found, motion.ddq, ROUNDING * np.linalg.cond(M).max())


def test_a_called_model_inverts_inverse_dynamics(arm):
    model, theta, motion = arm
    base = find_base_parameters(model)
    called = CallableModel(model, base, base.values_of(theta))
    memory = called.memory(motion.q[0])
    M = model.mass_matrix(motion.q, theta)
    found = []
    for q, dq, ddq in zip(motion.q, motion.dq, motion.ddq, strict=True):
        memory.update(q)
        found.append(called.acceleration(q, dq, called.torque(q, dq, ddq, memory), memory))
    close(np.array(found), motion.ddq, ROUNDING * np.linalg.cond(M).max())


def test_bias_is_coriolis_and_gravity(arm):
    model, theta, motion = arm
    C = model.coriolis_matrix(motion.q, motion.dq, theta)
    coriolis = np.einsum("nij,nj->ni", C, motion.dq)
    close(bias_torque(model, motion.q, motion.dq, theta), coriolis + model.gravity_torque(motion.q, theta))


def test_the_rate_of_the_mass_matrix_less_twice_coriolis_is_skew(arm):
    """Of the called model, whose matrices come from generated operations."""
    model, theta, motion = arm
    base = find_base_parameters(model)
    called = CallableModel(model, base, base.values_of(theta))
    for q, dq in zip(motion.q, motion.dq, strict=True):
        rate = (called.mass_matrix(q + STEP * dq) - called.mass_matrix(q - STEP * dq)) / (2.0 * STEP)
        skew = rate - 2.0 * called.coriolis_matrix(q, dq)
        scale = np.abs(called.mass_matrix(q)).max() * np.abs(dq).max() + np.abs(skew).max()
        assert np.abs(skew + skew.T).max() <= SLOPE * scale
        power = dq @ skew @ dq
        assert abs(power) <= SLOPE * scale * (dq @ dq)


def test_the_regressor_of_slotine_and_li_is_that_of_the_torque_along_the_motion_itself(arm):
    model, theta, motion = arm
    Y = slotine_li_regressor(model, motion, motion.dq, motion.ddq)
    close(Y, model.regressor(motion))
    close(Y @ theta, model.torque(motion, theta))


def test_the_regressor_of_slotine_and_li_gives_the_terms_of_the_reference(arm):
    model, theta, motion = arm
    dq_r, ddq_r = np.flip(motion.dq, 0), np.flip(motion.ddq, 0)
    Y = slotine_li_regressor(model, motion, dq_r, ddq_r)
    inertia = np.einsum("nij,nj->ni", model.mass_matrix(motion.q, theta), ddq_r)
    coriolis = np.einsum("nij,nj->ni", model.coriolis_matrix(motion.q, motion.dq, theta), dq_r)
    friction = friction_of(model, replace(motion, ddq=ddq_r), theta)
    close(Y @ theta, inertia + coriolis + model.gravity_torque(motion.q, theta) + friction)
    base = find_base_parameters(model)
    close(Y[:, :, base.kept] @ base.values_of(theta), Y @ theta)


def test_bodies_that_cannot_exist_have_no_acceleration():
    model, theta, motion = made(7)
    theta[model.inertial_columns] *= -1.0
    with pytest.raises(ModelError, match="is not positive definite"):
        forward_dynamics(model, motion, np.zeros_like(motion.q), theta)
    base = find_base_parameters(model)
    called = CallableModel(model, base, base.values_of(theta))
    with pytest.raises(ArmidError, match="is not positive definite"):
        called.acceleration(motion.q[0], motion.dq[0], motion.q[0], called.memory(motion.q[0]))


def test_friction_larger_than_its_load_has_no_acceleration():
    model, theta, motion = made(7)
    theta[[k for k, p in enumerate(model.parameters) if p.kind == LoadCoulomb.name]] = 1e3
    with pytest.raises(ModelError, match=re.escape("larger than the load")):
        forward_dynamics(model, motion, np.ones_like(motion.q), theta)
    base = find_base_parameters(model)
    called = CallableModel(model, base, base.values_of(theta))
    with pytest.raises(ArmidError, match=re.escape("larger than the load")):
        called.acceleration(motion.q[0], motion.dq[0], motion.q[0], called.memory(motion.q[0]))


def test_friction_without_masses_has_no_acceleration():
    model = DynamicsModel(made(7)[0].robot, (Viscous(),))
    base = find_base_parameters(model)
    with pytest.raises(ArmidError, match="no forward dynamics"):
        CallableModel(model, base, np.ones(base.count)).acceleration(*np.zeros((3, model.n)))
