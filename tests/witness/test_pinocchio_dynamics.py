"""The NumPy twin and every compiled build against Pinocchio, which knows nothing of them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from armid import kernel
from armid.kernel import reference
from trees import pinocchio_model, random_inertial, random_states, random_tree, structured_tree

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
