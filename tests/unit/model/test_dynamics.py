"""The model of an arm with its terms: torque, regressor, mass matrix and energies belong together."""

from __future__ import annotations

import numpy as np
import pytest

from armid.errors import ArmidError, ModelError
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Coupling, Offset, RigidBody, RotorInertia, Viscous
from trees import random_inertial, random_states, random_tree, robot_of

ROUNDING = 1e-12
"""Relative to the largest entry: two ways to the same number on six joints."""

STEP, SLOPE = 1e-5, 1e-7
"""Central differences with that step resolve so much, relative to the largest entry."""

JOINTS = 6


@pytest.fixture(scope="module", params=range(4))
def arm(request):
    """A model with every term, its true parameters, and states."""
    rng = np.random.default_rng(request.param)
    tree = random_tree(rng, JOINTS, prismatic=0.0, branching=0.3)
    drive = Coupling({"joint_5": 1.0, "joint_6": -2.5}, width=0.3)
    terms = (RigidBody(), Viscous(), Coulomb(width=0.2), Offset(), RotorInertia(("joint_1", "joint_6")), drive)
    model = DynamicsModel(robot_of(tree), terms)
    theta = rng.uniform(0.1, 3.0, len(model.parameters))
    theta[model.inertial_columns] = random_inertial(rng, JOINTS).ravel()
    return model, theta, random_states(rng, 15, JOINTS)


def close(a, b, tolerance=ROUNDING):
    assert np.shape(a) == np.shape(b)
    assert np.abs(a - b).max() <= tolerance * max(np.abs(a).max(), np.abs(b).max())


def test_torque_is_regressor_times_parameters(arm):
    model, theta, state = arm
    motion = Motion.of_states(*state)
    close(model.torque(motion, theta), model.regressor(motion) @ theta)


def test_mass_matrix_is_what_acceleration_costs(arm):
    """Rotors and the shared drive included."""
    model, theta, (q, dq, ddq) = arm
    M = model.mass_matrix(q, theta)
    close(M, np.swapaxes(M, 1, 2))
    still = model.torque(Motion.of_states(q, dq, ddq), theta)
    for j in range(JOINTS):
        more = model.torque(Motion.of_states(q, dq, ddq + np.eye(JOINTS)[j]), theta)
        close(more - still, M[:, :, j], 100.0 * ROUNDING)
    bare = DynamicsModel(model.robot, (RigidBody(),)).mass_matrix(q, theta[model.inertial_columns])
    drives = np.zeros((JOINTS, JOINTS))
    names = [p.name for p in model.parameters]
    drives[0, 0], drives[5, 5] = theta[names.index("IA_1")], theta[names.index("IA_6")]
    weights = np.array([0, 0, 0, 0, 1.0, -2.5])
    drives += theta[names.index("IAM_6")] * np.outer(weights, weights)
    close(M - bare, np.broadcast_to(drives, M.shape))


def test_torque_is_inertia_coriolis_gravity_and_friction(arm):
    model, theta, (q, dq, ddq) = arm
    motion = Motion.of_states(q, dq, ddq)
    friction = model.regressor(motion)
    friction[:, :, model.inertial_columns] = 0.0
    driven = [k for k, p in enumerate(model.parameters) if p.symbol in ("IA", "IAM")]
    friction[:, :, driven] = 0.0
    parts = (
        np.einsum("nij,nj->ni", model.mass_matrix(q, theta), ddq)
        + np.einsum("nij,nj->ni", model.coriolis_matrix(q, dq, theta), dq)
        + model.gravity_torque(q, theta)
        + friction @ theta
    )
    close(parts, model.torque(motion, theta))


def test_mass_matrix_changes_as_coriolis_says(arm):
    """dM/dt - 2 C is skew-symmetric; rotors add nothing that changes."""
    model, theta, (q, dq, _) = arm
    change = (model.mass_matrix(q + STEP * dq, theta) - model.mass_matrix(q - STEP * dq, theta)) / (2.0 * STEP)
    C = model.coriolis_matrix(q, dq, theta)
    close(change, C + np.swapaxes(C, 1, 2), SLOPE)


def test_energies(arm):
    """Power of the torque without friction is the rate of the energy."""
    model, theta, (q, dq, ddq) = arm
    free = theta.copy()
    for k, p in enumerate(model.parameters):
        if p.symbol in ("FV", "FS", "FO", "FVM", "FSM"):
            free[k] = 0.0

    def energy(t):
        at, rate = q + t * dq + 0.5 * t * t * ddq, dq + t * ddq
        return model.kinetic_energy(at, rate, free) + model.potential_energy(at, free)

    power = np.sum(model.torque(Motion.of_states(q, dq, ddq), free) * dq, axis=1)
    rate = (energy(STEP) - energy(-STEP)) / (2.0 * STEP)
    assert np.abs(rate - power).max() <= SLOPE * max(np.abs(power).max(), np.abs(energy(0.0)).max())
    assert (model.kinetic_energy(q, dq, theta) > 0.0).all()


def test_parameters_stand_link_by_link(arm):
    model, _, _ = arm
    names = [p.name for p in model.parameters]
    assert names[:14] == [*(f"{s}_1" for s in "M MX MY MZ XX XY YY XZ YZ ZZ FV FS FO IA".split())]
    assert names[-7:] == ["FV_6", "FS_6", "FO_6", "IA_6", "IAM_6", "FVM_6", "FSM_6"]
    assert len(names) == len(set(names)) == JOINTS * 13 + 2 + 3
    assert {p.joint for p in model.parameters if p.number == 2} == {"joint_2"}


def test_term_columns_of_some_entries(arm):
    model, _, state = arm
    motion = Motion.of_states(*state)
    everything = model.term_columns(motion)
    some = model.term_columns(motion, np.array([3, 0, 11]))
    for name in ("joint", "parameter", "values"):
        assert np.array_equal(getattr(some, name), getattr(everything, name)[[3, 0, 11]])
    Y = model.regressor(motion)
    for joint, parameter, column in zip(everything.joint, everything.parameter, everything.values, strict=True):
        assert np.array_equal(Y[:, joint, parameter], column)


def test_a_model_without_bodies(arm):
    model, _, state = arm
    friction = DynamicsModel(model.robot, (Viscous(), Offset()))
    motion = Motion.of_states(*state)
    theta = np.arange(12.0)
    close(friction.torque(motion, theta), motion.dq * theta[0::2] + theta[1::2])
    assert friction.nominal_parameters() is None
    assert not friction.mass_matrix(state[0], theta).any()
    assert not friction.gravity_torque(state[0], theta).any()


def test_nominal_parameters_are_those_of_the_description():
    from armid.robot import load_robot

    robot = load_robot("iiwa14-r820")
    model = DynamicsModel(robot, (RigidBody(), Viscous()))
    theta = model.nominal_parameters()
    assert theta is not None
    assert np.array_equal(theta[model.inertial_columns], robot.inertial_vector.ravel())
    assert not theta[model.law_columns].any()
    assert DynamicsModel(robot_of(model.tree), (RigidBody(),)).nominal_parameters() is None


def test_what_does_not_fit_is_refused(arm):
    model, theta, (q, dq, ddq) = arm
    with pytest.raises(ModelError, match="at least one torque term"):
        DynamicsModel(model.robot, ())
    with pytest.raises(ModelError, match="FV_2"):
        DynamicsModel(model.robot, (Viscous(), Viscous(("joint_2",))))
    narrow = Motion.of_states(q[:, :5], dq[:, :5], ddq[:, :5])
    for call in (lambda: model.regressor(narrow), lambda: model.torque(narrow, theta)):
        with pytest.raises(ModelError, match="5 joints"):
            call()
    with pytest.raises(ArmidError, match="standard parameters"):
        model.torque(Motion.of_states(q, dq, ddq), theta[:-1])
    with pytest.raises(ArmidError, match="positions"):
        model.mass_matrix(q[0], theta)
