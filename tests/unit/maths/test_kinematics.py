"""Forward kinematics against the definition: a product of transforms along the chain."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armid.errors import ArmidError
from armid.maths.rotations import homogeneous
from armid.robot import Frame, Joint, Link, Robot, forward_kinematics, frame_pose


def make_robot(seed: int = 0, parents: tuple[int, ...] = (-1, 0, 1, 0, 3)) -> Robot:
    rng = np.random.default_rng(seed)
    pose = [homogeneous(Rotation.random(random_state=seed + i).as_matrix(), rng.normal(size=3)) for i in range(6)]
    joints = tuple(
        Joint(f"j{i}", ("revolute", "prismatic")[i % 2], p, rng.normal(size=3), pose[i], [-np.inf, np.inf])
        for i, p in enumerate(parents)
    )
    links = tuple(Link(f"l{i}") for i in range(len(parents)))
    return Robot("tree", joints, links, Frame("tip", 2, pose[5]))


def link_pose(robot: Robot, q, i: int):
    """Pose of link i in the base by walking down the chain, one transform at a time."""
    if i < 0:
        return np.eye(4)
    joint = robot.joints[i]
    moved = np.eye(4)
    if joint.kind == "prismatic":
        moved[:3, 3] = q[i] * joint.axis
    else:
        moved[:3, :3] = Rotation.from_rotvec(q[i] * joint.axis).as_matrix()
    return link_pose(robot, q, joint.parent) @ joint.placement @ moved


def test_frames_are_products_of_transforms():
    robot = make_robot()
    q = np.random.default_rng(1).uniform(-3, 3, (7, robot.n))
    R, p = forward_kinematics(robot, q)
    assert R.shape == (7, 5, 3, 3)
    assert p.shape == (7, 5, 3)
    R_tip, p_tip = frame_pose(robot, q)
    for k in range(len(q)):
        for i in range(robot.n):
            expected = link_pose(robot, q[k], i)
            np.testing.assert_allclose(R[k, i], expected[:3, :3], atol=1e-14)
            np.testing.assert_allclose(p[k, i], expected[:3, 3], atol=1e-14)
        expected = link_pose(robot, q[k], 2) @ robot.tip.placement
        np.testing.assert_allclose(R_tip[k], expected[:3, :3], atol=1e-14)
        np.testing.assert_allclose(p_tip[k], expected[:3, 3], atol=1e-14)


def test_a_frame_on_the_base_does_not_move():
    robot = make_robot()
    frame = Frame("table", -1, homogeneous(np.eye(3), [1.0, 2.0, 3.0]))
    R, p = frame_pose(robot, np.random.default_rng(2).normal(size=(4, 5)), frame)
    assert (p == [1.0, 2.0, 3.0]).all()
    assert (np.eye(3) == R).all()


def test_no_samples_give_no_poses():
    R, p = frame_pose(make_robot(), np.empty((0, 5)))
    assert R.shape == (0, 3, 3)
    assert p.shape == (0, 3)


@pytest.mark.parametrize("q", [np.zeros(5), np.zeros((3, 4)), np.full((1, 5), np.nan)])
def test_positions_of_another_shape_or_not_finite_are_refused(q):
    with pytest.raises(ArmidError, match="q must"):
        forward_kinematics(make_robot(), q)
