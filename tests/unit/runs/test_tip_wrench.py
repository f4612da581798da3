"""Wrench at the tip: the Jacobian is a derivative, a wrench is found again, singular directions are named."""

from __future__ import annotations

import numpy as np
import pytest

from armid.robot import load_robot
from armid.robot.kinematics import frame_pose
from armid.runs.monitoring.tip_wrench import tip_jacobian, tip_wrench
from labs import small_model

POSE = np.array([0.3, 0.7, -0.4, 1.2, 0.5, -0.9, 0.2])


@pytest.mark.parametrize("name", ["iiwa14-r820", "ur10e"])
def test_the_jacobian_is_the_derivative_of_the_pose(name: str):
    robot = load_robot(name)
    q = POSE[: robot.n]
    step = 1e-6
    R, p = frame_pose(robot, np.vstack([q + step * np.eye(robot.n), q - step * np.eye(robot.n)]))
    jacobian = tip_jacobian(robot, q)
    (R0,), _ = frame_pose(robot, q[None])
    for j in range(robot.n):
        turn = (R[j] - R[robot.n + j]) / (2.0 * step) @ R0.T
        assert np.allclose(jacobian[:3, j], (p[j] - p[robot.n + j]) / (2.0 * step), atol=1e-8)
        assert np.allclose(jacobian[3:, j], [turn[2, 1], turn[0, 2], turn[1, 0]], atol=1e-8)


@pytest.mark.parametrize("name", ["iiwa14-r820", "ur10e"])
def test_a_wrench_is_found_again(name: str):
    robot = load_robot(name)
    q = POSE[: robot.n]
    wrench = np.array([10.0, -20.0, 5.0, 1.0, 2.0, -3.0])
    found = tip_wrench(robot, q, tip_jacobian(robot, q).T @ wrench, 0.04 * np.eye(robot.n))
    assert not len(found.undetermined) and np.allclose(found.value, wrench)
    assert np.isfinite(found.deviation).all()
    assert robot.n == 6 or found.misfit < 1e-9  # the seventh joint agrees


def test_the_covariance_is_that_of_the_errors():
    """Ten thousand draws; the standard deviation of one of them is 0.7 %, so 5 % is seven of these."""
    robot = load_robot("iiwa14-r820")
    rng = np.random.default_rng(3)
    covariance = np.diag(rng.uniform(0.1, 1.0, 7)) + 0.05
    clean = tip_jacobian(robot, POSE).T @ np.array([10.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    draws = clean + rng.multivariate_normal(np.zeros(7), covariance, 10000)
    found = [tip_wrench(robot, POSE, each, covariance) for each in draws]
    spread = np.std([each.value for each in found], axis=0)
    assert np.allclose(spread, found[0].deviation, rtol=0.05)
    assert np.mean([each.misfit for each in found]) == pytest.approx(1.0, rel=0.1)


def test_what_the_arm_does_not_show_is_said():
    """An outstretched arm does not feel a force along itself, and three joints not six components."""
    robot = load_robot("iiwa14-r820")
    straight = tip_wrench(robot, np.zeros(7), np.ones(7), 0.04 * np.eye(7))
    along = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    assert np.linalg.norm(straight.undetermined @ along) == pytest.approx(1.0, abs=1e-6)
    assert straight.deviation[2] == np.inf and straight.value[2] == pytest.approx(0.0, abs=1e-9)
    small = small_model().robot
    few = tip_wrench(small, np.array([0.1, 0.4, -0.7]), np.ones(3), 0.04 * np.eye(3))
    assert len(few.undetermined) >= 3
    assert np.allclose(few.undetermined @ few.undetermined.T, np.eye(len(few.undetermined)))
