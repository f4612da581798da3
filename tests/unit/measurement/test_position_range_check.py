"""Positions against the limits of joints: which are angles in degrees, and which are merely outside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.checked_array import Array
from armid.measurement.position_range_check import in_degrees
from armid.robot import Robot
from sick import arm, sound

LIMITS = np.array([[-2.0, 2.0], [-1.6, 1.6], [-1.6, 1.6], [-1.8, 1.8], [-np.pi, np.pi], [-1.1, 1.1]])
"""Limits of a desk-top arm with a gripper [rad]."""


def desk_top() -> Robot:
    robot = arm("ur10e")
    joints = (replace(joint, position_limits=own) for joint, own in zip(robot.joints, LIMITS, strict=True))
    return replace(robot, joints=tuple(joints))


def positions(fill: float = 0.999) -> Array:
    """Motions of all joints that fill a share of their limits."""
    q = sound(4).motion.q
    middle = (q.min(axis=0) + q.max(axis=0)) / 2
    return fill * (q - middle) / np.abs(q - middle).max(axis=0) * LIMITS[:, 1]


def told(q: Array) -> list[bool]:
    return in_degrees(desk_top(), q, np.zeros(6, dtype=np.bool_)).tolist()


def test_positions_in_radians_are_not_degrees():
    assert told(positions()) == [False] * 6


@pytest.mark.parametrize("beyond", [0.0, 0.1, 2.0])
def test_all_angles_are_degrees_though_joints_overshoot_their_limits(beyond: float):
    """Overshoot in degrees: controllers track a motion to 99.9 % of a limit less exactly than that."""
    q = np.degrees(positions())
    q[np.argmax(q[:, 1]), 1] += beyond
    assert told(q) == [True] * 6


@pytest.mark.parametrize("joint", range(6))
def test_one_channel_may_be_in_degrees(joint: int):
    q = positions(0.7)
    q[:, joint] *= 180.0 / np.pi
    assert told(q) == [k == joint for k in range(6)]


@pytest.mark.parametrize("reach", [2.5, 3.1, 6.3, 12.0])
def test_an_angle_that_another_arm_reaches_is_not_degrees_of_one_joint(reach: float):
    """Read as degrees, the gripper would hardly move while all other joints move over their range."""
    q = positions()
    q[:, 5] *= reach / 1.1
    assert told(q) == [False] * 6


def test_positions_of_motors_are_not_degrees():
    assert told(150.0 * positions()) == [False] * 6
