"""Pairs that are checked as they are: the search sees them in a map of positions, and only their joints move less."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.excitation.collision.coal import too_close
from armid.excitation.collision.collision_model import collision_options, make_collision_model
from armid.excitation.design.configuration_space_obstacles import POSITIONS, measured_pairs
from armid.excitation.design.objective import CriterionGoal, Objective
from armid.excitation.design.sqp import about_start
from armid.excitation.limits.constraint_channels import States
from armid.excitation.limits.joint_limits import limits_of
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.robot import load_robot
from armid.robot.kinematics import forward_kinematics

pytestmark = pytest.mark.collision

BOX = '<collision><origin xyz="{0}"/><geometry><box size="{1}"/></geometry></collision>'
MASS = '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """Three joints; the second link reaches over a post of the base and touches it in some poses."""
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3}"/>'
        '<axis xyz="{4}"/><limit lower="-2" upper="2" velocity="2" effort="90"/></joint>'
    )
    path = tmp_path_factory.mktemp("post") / "post.urdf"
    path.write_text(
        f'<robot name="post"><link name="base">{BOX.format("0.3 0 0.1", "0.05 0.05 0.2")}</link>'
        f'<link name="between">{MASS}</link>'
        f'<link name="arm">{MASS}{BOX.format("0.2 0 0", "0.4 0.02 0.02")}</link><link name="hand">{MASS}</link>'
        + joint.format("turn", "base", "between", "0 0 0.3", "0 0 1")
        + joint.format("lift", "between", "arm", "0 0 0", "0 1 0")
        + joint.format("roll", "arm", "hand", "0.4 0 0", "1 0 0")
        + "</robot>"
    )
    return load_robot(path)


@pytest.fixture(scope="module")
def looked(robot):
    """Limits, start pose, and a collision model whose only pair is checked as it is."""
    limits = limits_of(robot)
    start = np.array([0.2, -0.5, 0.3])
    collision = collision_options(make_collision_model(robot, limits), start)
    return limits, start, replace_by_measured(collision)


def replace_by_measured(collision):
    kept = np.full(len(collision.pairs), 0.02)
    return replace(collision, measured=collision.pairs, required_distances=kept)


def basis_of(start):
    return SeriesBasis(2.0 * np.pi / 10.0, 5, start)


def states_of(robot, start, x, samples=40):
    model = DynamicsModel(robot, (RigidBody(),))
    goal = CriterionGoal(model, find_base_parameters(model), "d-optimal")
    return States(Objective(goal, basis_of(start), samples), x)


def test_the_map_tells_where_the_bodies_are_too_close(robot, looked):
    limits, start, collision = looked
    (channel,) = measured_pairs(collision, robot, limits, start)
    (found,) = channel.maps
    assert found.joints == (0, 1)
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (500, 3))
    close = too_close(collision.shapes, collision.measured[0], 0.02, forward_kinematics(robot, q))
    distance, _ = found.at(q)
    border = np.abs(distance) > 1.5 * 4.0 / (POSITIONS - 1)  # off by a step of the grid and its diagonal at most
    assert 0 < close.sum() < len(q)
    np.testing.assert_array_equal(distance[border] < 0.0, close[border])


def test_the_gradient_of_the_channel_is_its_derivative(robot, looked):
    limits, start, collision = looked
    (channel,) = measured_pairs(collision, robot, limits, start)
    rng = np.random.default_rng(1)
    x = 0.3 * rng.standard_normal(basis_of(start).unknowns)
    states = states_of(robot, start, x)
    weights = rng.uniform(size=channel.values(states).shape)
    gradient = channel.pullback(states, weights)[0]
    step, numeric = 1e-7, np.zeros(len(x))
    for k in range(len(x)):
        ahead, behind = (
            (weights * channel.values(states_of(robot, start, x + sign * step * np.eye(len(x))[k]))).sum()
            for sign in (1.0, -1.0)
        )
        numeric[k] = (ahead - behind) / (2.0 * step)
    # Central differences of a piecewise bilinear function, exact within its pieces up to rounding.
    np.testing.assert_allclose(gradient, numeric, rtol=1e-5, atol=1e-6)


def test_the_rise_between_points_of_a_grid_is_bounded(robot, looked):
    limits, start, collision = looked
    (channel,) = measured_pairs(collision, robot, limits, start)
    x = 0.5 * np.random.default_rng(2).standard_normal(basis_of(start).unknowns)
    coarse, fine = (states_of(robot, start, x, samples) for samples in (40, 4000))
    bound = channel.values(coarse).max() + channel.between(coarse, 10.0 / 40)[0]
    assert channel.values(fine).max() <= bound


def test_nothing_is_limited_where_the_bodies_are_apart_everywhere(robot, looked):
    limits, start, collision = looked
    narrow = replace(limits, lower=start - 0.1, upper=start + 0.1)
    assert measured_pairs(collision, robot, narrow, start) == ()


def test_one_joint_moves_less_and_the_others_as_before(looked):
    _, start, _ = looked
    basis = basis_of(start)
    x = np.random.default_rng(3).standard_normal(basis.unknowns)
    time = np.linspace(0.0, 10.0, 50)
    before, after = (basis.excitation(each).at(time).q for each in (x, about_start(basis, x, np.array([0.5, 1, 1]))))
    np.testing.assert_allclose(after[:, 1:], before[:, 1:], rtol=0.0, atol=1e-12)  # rounding of a projection
    np.testing.assert_allclose(after[:, 0] - start[0], 0.5 * (before[:, 0] - start[0]), rtol=0.0, atol=1e-12)
