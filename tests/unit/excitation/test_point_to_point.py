"""Static poses and constant velocities: inside the limits, smooth, and worth more than random ones."""

from __future__ import annotations

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.excitation.limits.joint_limits import limits_of
from armid.excitation.poses_and_sweeps import choose_poses, poses_plan, sweeps_plan
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import load_robot


@pytest.fixture(scope="module")
def arm():
    robot = load_robot("ur5e")
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb()))
    return model, find_base_parameters(model), limits_of(robot, acceleration=4.0, jerk=60.0)


def determinant(model, base, q):
    """Of what static poses say, in the directions that any of them see."""
    zero = np.zeros_like(q)
    rows = model.regressor(Motion.of_states(q, zero, zero))[:, :, base.kept].reshape(-1, base.count)
    sizes = np.linalg.svd(rows, compute_uv=False)
    return np.log(sizes[:GRAVITY]).sum()


GRAVITY = 9
"""Gravity parameters of six joints, the first of which turns about the vertical."""


def test_chosen_poses_say_more_than_random_ones(arm):
    model, base, limits = arm
    poses = choose_poses(model, base, limits, 10)
    rng = np.random.default_rng(5)
    others = [determinant(model, base, rng.uniform(limits.lower, limits.upper, (10, 6))) for _ in range(50)]
    assert determinant(model, base, poses) > max(others)
    assert (poses > limits.lower).all() and (poses < limits.upper).all()
    assert np.array_equal(poses, choose_poses(model, base, limits, 10))
    half = choose_poses(model, base, limits, 5, allowed=lambda q: q[:, 1] < 0.0)
    assert (half[:, 1] < 0.0).all()


def inside(moves, limits):
    motion = moves.sample(500.0)
    assert (motion.q >= limits.lower).all() and (motion.q <= limits.upper).all()
    assert (np.abs(motion.dq) <= limits.velocity * (1.0 + 1e-9)).all()
    assert (np.abs(motion.ddq) <= 4.0).all()
    slopes = np.diff(motion.q, axis=0) * 500.0
    assert np.abs(slopes - 0.5 * (motion.dq[1:] + motion.dq[:-1])).max() < 1e-3
    assert np.abs(np.diff(motion.ddq, axis=0)).max() < 60.0 * 4 / 500.0  # no jump in acceleration
    return motion


def test_a_plan_of_poses_rests_in_each(arm):
    model, base, limits = arm
    poses = choose_poses(model, base, limits, 6)
    moves = poses_plan(poses, limits, rest=1.5)
    inside(moves, limits)
    ends = np.cumsum(moves.seconds)
    rests = [ends[k] - 0.7 for k, kind in enumerate(moves.kinds) if kind == "rest"]
    assert moves.at(np.array(rests)).q == pytest.approx(poses)
    assert moves.kinds.count("rest") == 6


def test_a_way_that_is_not_free_goes_round(arm):
    _, _, limits = arm
    a, b, via = np.full(6, -1.0), np.full(6, 1.0), np.array([-1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    moves = poses_plan(np.array([a, b]), limits, via=via, free=lambda q: np.abs(q[:, 0] - q[:, 1]) > 0.5)
    assert moves.kinds == ("rest", "way", "way", "rest")
    assert moves.poses[2] == pytest.approx(via)


def test_sweeps_are_even_one_joint_at_a_time(arm):
    _, _, limits = arm
    moves = sweeps_plan(np.zeros(6), limits, (0.1, 0.5))
    inside(moves, limits)
    ends = np.cumsum(moves.seconds)
    sweeps = [k for k, kind in enumerate(moves.kinds) if kind == "sweep"]
    assert len(sweeps) == 6 * 2 * 2
    for k in sweeps:
        motion = moves.at(np.linspace(ends[k] - moves.seconds[k], ends[k], 20)[1:-1])
        moving = np.abs(motion.dq).max(axis=0) > 1e-9
        assert moving.sum() == 1
        speed = motion.dq[:, moving][:, 0]
        assert np.ptp(speed) < 1e-9 and abs(speed[0]) / limits.velocity[moving][0] == pytest.approx(
            0.1 if abs(speed[0]) < 0.3 * limits.velocity[moving][0] else 0.5
        )
        assert np.abs(motion.ddq).max() < 1e-9


def test_what_cannot_be(arm):
    model, base, limits = arm
    with pytest.raises(ArmidError, match="are free of collisions"):
        choose_poses(model, base, limits, 5, allowed=lambda q: np.zeros(len(q), dtype=bool))
    with pytest.raises(ArmidError, match="At least one pose"):
        choose_poses(model, base, limits, 0)
    with pytest.raises(ArmidError, match="duration of the standstill"):
        poses_plan(np.zeros((2, 6)), limits, rest=0.0)
    for speeds in ((), (0.0,), (1.5,)):
        with pytest.raises(ArmidError, match="shares of the velocity limit"):
            sweeps_plan(np.zeros(6), limits, speeds)
    floating = model.robot.with_gravity((0.0, 0.0, 0.0))
    weightless = DynamicsModel(floating, model.terms)
    with pytest.raises(ArmidError, match="Gravity causes no torque"):
        choose_poses(weightless, find_base_parameters(weightless), limits, 5)
