"""The NumPy twin and every compiled build against Pinocchio, which knows nothing of them."""

from __future__ import annotations

import numpy as np
import pytest

from armid import kernel
from armid.kernel import reference
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.equations_of_motion import forward_dynamics
from armid.model.motion import Motion
from armid.model.terms import RigidBody
from armid.runs.callable_model import CallableModel
from trees import pinocchio_model, random_inertial, random_states, random_tree, robot_of, structured_tree

pin = pytest.importorskip("pinocchio", reason="the package pin is not installed")
pytestmark = pytest.mark.witness

TOLERANCE = 1e-12
"""Relative to the largest entry: two orders of recursion over at most 30 joints differ by rounding."""

SAMPLES = 2


def close(mine, theirs):
    assert np.abs(mine - theirs).max() <= TOLERANCE * np.abs(theirs).max()


@pytest.mark.parametrize("seed", range(220))
def test_regressor_torque_and_mass_matrix(seed):
    rng = np.random.default_rng(seed)
    n = 1 + seed % 30
    make = structured_tree if seed % 3 == 0 else random_tree
    tree, inertial = make(rng, n), random_inertial(rng, n)
    q, dq, ddq = random_states(rng, SAMPLES, n)
    model, order = pinocchio_model(tree, inertial)
    data = model.createData()
    columns = (10 * np.array(order)[:, None] + np.arange(10)).ravel()
    states = [(q[k, order], dq[k, order], ddq[k, order]) for k in range(SAMPLES)]
    # Pinocchio drops axes of length one.
    Y = np.reshape([pin.computeJointTorqueRegressor(model, data, *state) for state in states], (SAMPLES, n, 10 * n))
    tau = np.reshape([pin.rnea(model, data, *state) for state in states], (SAMPLES, n))
    upper = np.triu(np.reshape([pin.crba(model, data, state[0]) for state in states], (SAMPLES, n, n)))
    M = upper + np.swapaxes(np.triu(upper, 1), 1, 2)
    for build in kernel.instruction_sets():
        close(kernel.regressor(tree, q, dq, ddq, chosen=build)[:, order][:, :, columns], Y)
        close(kernel.inverse_dynamics(tree, inertial, q, dq, ddq, chosen=build)[:, order], tau)
        close(kernel.mass_matrix(tree, inertial, q, chosen=build)[:, order][:, :, order], M)


@pytest.mark.parametrize("seed", range(30))
def test_gravity_and_energies(seed):
    rng = np.random.default_rng(1000 + seed)
    n = 1 + seed % 12
    tree, inertial = random_tree(rng, n), random_inertial(rng, n)
    q, dq, _ = random_states(rng, 1, n)
    model, order = pinocchio_model(tree, inertial)
    data = model.createData()
    close(
        reference.gravity_torque(tree, inertial, q)[0, order], pin.computeGeneralizedGravity(model, data, q[0, order])
    )
    close(
        reference.kinetic_energy(tree, inertial, q, dq)[0],
        pin.computeKineticEnergy(model, data, q[0, order], dq[0, order]),
    )
    weight = np.linalg.norm(tree.gravity) * inertial[:, 0].sum()
    potential = pin.computePotentialEnergy(model, data, q[0, order])
    assert abs(reference.potential_energy(tree, inertial, q)[0] - potential) <= TOLERANCE * weight * n


@pytest.mark.parametrize("seed", range(30))
def test_coriolis_matrix_and_forward_dynamics(seed):
    """The whole chain of armid against computeCoriolisMatrix and the articulated-body algorithm."""
    rng = np.random.default_rng(2000 + seed)
    n = 1 + seed % 8
    tree, inertial = (structured_tree if seed % 3 == 0 else random_tree)(rng, n), random_inertial(rng, n)
    q, dq, tau = random_states(rng, SAMPLES, n)
    model, order = pinocchio_model(tree, inertial)
    data = model.createData()
    mine = DynamicsModel(robot_of(tree), (RigidBody(),))
    theta = inertial.ravel()
    base = find_base_parameters(mine)
    called = CallableModel(mine, base, base.values_of(theta))
    C, M = mine.coriolis_matrix(q, dq, theta), mine.mass_matrix(q, theta)
    accelerations = forward_dynamics(mine, Motion.of_states(q, dq, np.zeros_like(q)), tau, theta)
    for k in range(SAMPLES):
        theirs = np.reshape(pin.computeCoriolisMatrix(model, data, q[k, order], dq[k, order]), (n, n)).copy()
        scale = max(np.abs(theirs).max(), np.abs(M[k]).max() * np.abs(dq[k]).max())  # a single joint has C = 0
        for found in (C[k], called.coriolis_matrix(q[k], dq[k])):
            assert np.abs(found[order][:, order] - theirs).max() <= TOLERANCE * scale
        free = np.reshape(pin.aba(model, data, q[k, order], dq[k, order], tau[k, order]), n).copy()
        for found in (accelerations[k], called.acceleration(q[k], dq[k], tau[k])):
            assert np.abs(found[order] - free).max() <= TOLERANCE * np.linalg.cond(M[k]) * np.abs(free).max()
