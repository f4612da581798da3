"""Laws of mechanics that the NumPy twin obeys on trees of any kind."""

from __future__ import annotations

import numpy as np
import pytest

from armid.kernel import reference
from trees import random_inertial, random_states, random_tree, structured_tree

ROUNDING = 1e-12
"""Relative to the largest entry: two ways to the same number differ by rounding over at most 12 joints."""

STEP = 1e-5
"""Step of central differences [rad or m]: error STEP² ~ 1e-10 against rounding 1e-16 / STEP ~ 1e-11."""

DIFFERENCE = 1e-7
"""Relative tolerance for central differences with that step, for trees of up to 12 joints."""

SAMPLES = 3


@pytest.fixture(params=range(24))
def arm(request):
    rng = np.random.default_rng(request.param)
    n = 1 + request.param // 2
    make = random_tree if request.param % 2 else structured_tree
    return make(rng, n), random_inertial(rng, n), random_states(rng, SAMPLES, n)


def close(a, b, tolerance=ROUNDING, scale=0.0):
    assert np.abs(a - b).max() <= tolerance * max(np.abs(a).max(), np.abs(b).max(), scale)


def test_torque_is_regressor_times_parameters(arm):
    tree, inertial, state = arm
    close(reference.regressor(tree, *state) @ inertial.ravel(), reference.inverse_dynamics(tree, inertial, *state))


def test_torque_is_the_sum_of_its_parts(arm):
    tree, inertial, (q, dq, ddq) = arm
    M, C = reference.mass_matrix(tree, inertial, q), reference.coriolis_matrix(tree, inertial, q, dq)
    parts = np.einsum("kij,kj->ki", M, ddq) + np.einsum("kij,kj->ki", C, dq)
    close(parts + reference.gravity_torque(tree, inertial, q), reference.inverse_dynamics(tree, inertial, q, dq, ddq))


def test_mass_matrix_is_symmetric_positive_and_holds_the_kinetic_energy(arm):
    tree, inertial, (q, dq, _) = arm
    M = reference.mass_matrix(tree, inertial, q)
    close(M, np.swapaxes(M, 1, 2))
    assert np.linalg.eigvalsh(M).min() > 0.0
    close(0.5 * np.einsum("ki,kij,kj->k", dq, M, dq), reference.kinetic_energy(tree, inertial, q, dq))


def test_coriolis_matrix_is_that_of_christoffel(arm):
    tree, inertial, (q, dq, _) = arm
    ahead = reference.mass_matrix(tree, inertial, q + STEP * dq)
    behind = reference.mass_matrix(tree, inertial, q - STEP * dq)
    C = reference.coriolis_matrix(tree, inertial, q, dq)
    scale = np.abs(ahead).max() * np.abs(dq).max()
    skew = (ahead - behind) / (2 * STEP) - 2.0 * C
    close(skew, -np.swapaxes(skew, 1, 2), DIFFERENCE, scale)
    # Skew symmetry alone does not fix C: with Christoffel's symbols C(a) b = C(b) a as well.
    other = np.flip(dq, 0)
    crossed = np.einsum("kij,kj->ki", C, other)
    close(crossed, np.einsum("kij,kj->ki", reference.coriolis_matrix(tree, inertial, q, other), dq), scale=scale)


def test_gravity_torque_is_the_gradient_of_the_potential_energy(arm):
    tree, inertial, (q, _, _) = arm
    g = reference.gravity_torque(tree, inertial, q)
    weight = np.linalg.norm(tree.gravity) * inertial[:, 0].sum()
    for j in range(tree.n):
        step = STEP * np.eye(tree.n)[j]
        up, down = (reference.potential_energy(tree, inertial, q + s * step) for s in (1, -1))
        close((up - down) / (2 * STEP), g[:, j], DIFFERENCE, weight)


def test_power_is_the_rate_of_the_energy(arm):
    tree, inertial, (q, dq, ddq) = arm

    def energy(t):
        moved = q + t * dq + 0.5 * t * t * ddq
        kinetic = reference.kinetic_energy(tree, inertial, moved, dq + t * ddq)
        return kinetic + reference.potential_energy(tree, inertial, moved)

    power = np.sum(reference.inverse_dynamics(tree, inertial, q, dq, ddq) * dq, axis=1)
    close((energy(STEP) - energy(-STEP)) / (2 * STEP), power, DIFFERENCE, np.abs(energy(0.0)).max())


def test_a_pendulum_hangs_down():
    from armid.kernel.tree import Tree

    tree = Tree([-1], [0], [[0, 0, 1]], [np.eye(3)], [[0, 0, 2.0]], [0, -9.81, 0])
    inertial = np.array([[2.0, 1.0, 0, 0, 0, 0, 0, 0, 0, 0.7]])
    q = np.array([[0.0], [-np.pi / 2], [np.pi / 6]])
    still = np.zeros_like(q)
    assert reference.inverse_dynamics(tree, inertial, q, still, still)[:, 0] == pytest.approx(
        [9.81, 0.0, 9.81 * np.cos(np.pi / 6)], abs=1e-14
    )
    assert reference.inverse_dynamics(tree, inertial, q[1:2], still[1:2], still[1:2] + 1.0)[0, 0] == pytest.approx(
        0.7
    )
    assert reference.potential_energy(tree, inertial, q) == pytest.approx([0.0, -9.81, 0.5 * 9.81])


def test_a_slide_feels_the_weight_along_its_axis():
    from armid.kernel.tree import Tree

    tree = Tree([-1], [1], [[0, 0, 1]], [np.eye(3)], [[0, 0, 0]], [0, 0, -9.81])
    inertial = np.array([[2.0, 0.3, 0.1, 0, 0, 0, 0, 0, 0, 0.7]])
    q, dq, ddq = np.array([[0.4]]), np.array([[1.0]]), np.array([[3.0]])
    assert reference.inverse_dynamics(tree, inertial, q, dq, ddq)[0, 0] == pytest.approx(2.0 * (9.81 + 3.0))
    assert reference.potential_energy(tree, inertial, q)[0] == pytest.approx(2.0 * 9.81 * 0.4)
