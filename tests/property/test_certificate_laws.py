"""Laws of certificates: what is consistent is certified so, what is not comes with the nearest that is."""

from __future__ import annotations

import numpy as np
import pytest

from armid.errors import EstimationError
from armid.maths.conic_solver import Cone, solve_cones, upper_triangle
from armid.maths.inertia import pseudo_inertia
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, RotorInertia, Viscous
from armid.validation.distance_to_consistency import certify_values
from armid.validation.smallest_mass_matrix import worst_pose
from trees import random_inertial, random_tree, robot_of

CONE_ROUNDING = 1e-6  # what the solver is allowed to leave


def random_model(seed: int, joints: int) -> tuple[DynamicsModel, np.ndarray, np.random.Generator]:
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, joints)
    model = DynamicsModel(robot_of(tree), (RigidBody(), Viscous(), Coulomb(), RotorInertia()))
    theta = rng.uniform(0.1, 2.0, len(model.parameters))
    theta[model.inertial_columns] = random_inertial(rng, joints).ravel()
    return model, theta, rng


@pytest.mark.parametrize("seed", range(12))
def test_real_bodies_are_feasible_and_have_a_witness(seed: int):
    model, theta, _ = random_model(seed, 2 + seed % 6)
    base = find_base_parameters(model)
    found = certify_values(model, base.names, base.values_of(theta), base.regrouping)
    assert found.feasible
    links = found.witness[model.inertial_columns].reshape(-1, 10)
    assert np.linalg.eigvalsh(pseudo_inertia(links)).min() > -CONE_ROUNDING
    assert np.allclose(base.values_of(found.witness), base.values_of(theta), atol=1e-5)


@pytest.mark.parametrize("seed", range(6))
def test_the_nearest_is_consistent_and_nothing_nearer_is(seed: int):
    model, theta, rng = random_model(100 + seed, 3)
    base = find_base_parameters(model)
    values = base.values_of(theta)
    values = values - 3.0 * np.abs(values).max() * (rng.random(len(values)) < 0.3)
    found = certify_values(model, base.names, values, base.regrouping)
    assert not found.feasible
    assert np.linalg.norm(found.nearest - values) == pytest.approx(found.distance, rel=1e-6)
    # The set is convex: the angle between the way there and the way on to any consistent point is not acute.
    for _ in range(50):
        other = rng.uniform(0.0, 3.0, len(theta))
        other[model.inertial_columns] = random_inertial(rng, model.n).ravel()
        ahead = base.values_of(other) - found.nearest
        scale = found.distance * np.linalg.norm(ahead)
        assert (values - found.nearest) @ ahead <= 1e-3 * scale


def test_negative_friction_and_rotor_inertia_are_blamed():
    model, theta, _ = random_model(7, 2)
    names = [parameter.name for parameter in model.parameters]
    theta[names.index("FV_1")], theta[names.index("IA_2")] = -0.5, -0.25
    found = certify_values(model, names, theta, np.eye(len(theta)))
    assert not found.feasible
    assert {each.name for each in found.blame[:2]} == {"FV_1", "IA_2"}
    assert found.distance == pytest.approx(np.hypot(0.5, 0.25), rel=1e-5)


def test_the_worst_pose_is_worse_than_a_dense_sample():
    model, theta, rng = random_model(3, 4)
    found = worst_pose(model, theta)
    low, high = np.array([joint.position_limits for joint in model.robot.joints]).T
    q = rng.uniform(low, high, (20_000, 4))
    assert found.min_eigenvalue <= np.linalg.eigvalsh(model.mass_matrix(q, theta))[:, 0].min() + 1e-12
    at = np.linalg.eigvalsh(model.mass_matrix(found.q[None], theta))[0, 0]
    assert at == pytest.approx(found.min_eigenvalue)


def test_an_impossible_program_is_an_error_and_no_answer():
    one = np.ones((1, 1))
    with pytest.raises(EstimationError, match=r"found no solution|did not converge"):
        solve_cones(np.ones(1), [Cone("nonnegative", one, -one[0]), Cone("nonnegative", -one, np.zeros(1))])


def test_a_semidefinite_cone_is_left_by_its_smallest_eigenvalue():
    i, j = upper_triangle(2)
    matrix = np.array([[1.0, 2.0], [2.0, 1.0]])
    cone = Cone("semidefinite", np.zeros((3, 1)), matrix[i, j])
    assert cone.leaves(np.zeros(1)) == pytest.approx(1.0 / 2.0)  # eigenvalue -1 over the largest entry 2
