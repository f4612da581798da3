"""Angles that a description rounded are put back; all others stay."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armid.maths.rotations import homogeneous, rotation_x, rotation_y, rotation_z, rpy_rotation
from armid.robot import Frame, Joint, Link, Robot
from armid.robot.angle_rounding import ROUNDING, rounded, snapped_axis, snapped_rotation

STEPS = [math.radians(15 * k) for k in range(-12, 13)]


def rpy_of_urdf(rpy):
    """Rotation by rounded angles, made without armid's exact angles."""
    return Rotation.from_euler("xyz", rpy).as_matrix()


def one_joint(rpy, axis=(0.0, 0.0, 1.0)) -> Robot:
    placement = homogeneous(rpy_of_urdf(rpy), [0.1, 0.2, 0.3])
    joint = Joint("a", "revolute", -1, axis, placement, [-1, 1])
    return Robot("one", (joint,), (Link("l"),), Frame("tip", 0, np.eye(4)))


def test_multiples_of_fifteen_degrees_are_exact():
    for k, angle in enumerate(STEPS):
        expected = np.cos(angle), np.sin(angle)
        np.testing.assert_allclose(rotation_z(angle)[:2, 0], expected, rtol=0, atol=1e-15)
        if k % 6 == 0:
            for turn in (rotation_x, rotation_y, rotation_z):
                assert set(np.abs(turn(angle)).ravel()) == {0.0, 1.0}
    assert rotation_z(math.pi / 6)[1, 0] == 0.5
    assert rotation_z(math.radians(60.0))[0, 0] == 0.5


def test_angles_near_a_multiple_are_not_taken_for_it():
    assert rotation_z(1e-14)[1, 0] == 1e-14


@pytest.mark.parametrize("seed", range(40))
def test_right_angles_printed_with_four_digits_become_exact(seed):
    rng = np.random.default_rng(seed)
    exact = 0.5 * math.pi * rng.integers(-2, 3, 3)
    result = snapped_rotation(rpy_of_urdf(np.round(exact, 4)))
    assert set(np.abs(result).ravel()) <= {0.0, 1.0}
    np.testing.assert_allclose(result, rpy_of_urdf(exact), atol=1e-4)


@pytest.mark.parametrize("pitch", [1.5708, -1.5708, math.pi / 2, -math.pi / 2])
def test_gimbal_lock_keeps_the_one_angle_there_is(pitch):
    rpy = [0.3, pitch, 0.8]
    result = snapped_rotation(rpy_of_urdf(rpy))
    np.testing.assert_allclose(result, rpy_of_urdf([0.3, math.copysign(math.pi / 2, pitch), 0.8]), atol=1e-5)
    assert abs(result[2, 0]) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("seed", range(20))
def test_general_rotations_stay_to_the_bit(seed):
    rotation = Rotation.random(random_state=seed).as_matrix()
    assert snapped_rotation(rotation) is rotation


def test_a_tilt_about_one_axis_stays_and_the_rounded_angles_beside_it_do_not():
    result = snapped_rotation(rpy_of_urdf([1.5708, 3e-5, 0.31]))
    np.testing.assert_allclose(result, rpy_rotation([math.pi / 2, 0.0, 0.31]), atol=1e-15)


def test_one_angle_alone_may_be_chance():
    rotation = rpy_of_urdf([1.5708, 0.2, 0.31])
    assert snapped_rotation(rotation) is rotation
    axis = np.array([0.6, 0.8, 3e-5])
    assert snapped_axis(axis) is axis


def test_a_deliberate_small_angle_beyond_the_tolerance_stays():
    rotation = rpy_of_urdf([0.0, 0.0, 1.5 * ROUNDING])
    np.testing.assert_array_equal(snapped_rotation(rotation), rotation)


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ((0, 0, 1), (0, 0, 1)),
        ((1e-5, 0, -1), (0, 0, -1)),
        ((0, 1, 3e-5), (0, 1, 0)),
        ((-1, 1e-6, 0), (-1, 0, 0)),
        ((0, 0.866, 0.5), (0, math.sqrt(3) / 2, 0.5)),
        ((0.7071, 0.7072, 0), (math.sqrt(0.5), math.sqrt(0.5), 0)),
    ],
)
def test_axes_are_snapped(given, meant):
    given = np.array(given, dtype=float) / np.linalg.norm(given)
    np.testing.assert_allclose(snapped_axis(given), meant, rtol=0, atol=2e-16)


def test_the_finding_names_the_largest_change():
    robot, finding = rounded(one_joint([3.1416, 0.0, 1.5708]))
    assert set(np.abs(robot.joints[0].placement[:3, :3]).ravel()) == {0.0, 1.0}
    assert finding is not None
    assert (finding.code, finding.severity) == ("description-rounded", "info")
    assert "at a" in finding.evidence
    change = float(finding.evidence.split("change is ")[1].split()[0])
    assert change == pytest.approx(math.hypot(3.1416 - math.pi, 1.5708 - math.pi / 2), rel=0.05)
    assert robot.findings == (finding,)


def test_noise_of_an_exact_description_is_snapped_silently():
    robot, finding = rounded(one_joint([3.14159265359, 0.0, -1.57079632679], axis=(1e-11, 1.0, 0.0)))
    assert finding is None
    assert set(np.abs(robot.joints[0].placement[:3, :3]).ravel()) == {0.0, 1.0}
    assert robot.joints[0].axis.tolist() == [0.0, 1.0, 0.0]


def test_the_finding_counts_locked_joints_only_where_they_carry_one_that_moves():
    """A torso, an arm on it and another arm, all written with four digits, of which only the first arm moves."""
    names, parents = ("torso", "left", "right", "hand"), (-1, 0, 0, 2)
    placement = one_joint([1.5708, 0.0, 0.0]).joints[0].placement
    joints = tuple(
        Joint(name, "revolute", parent, [0, 0, 1], placement, [-1, 1])
        for name, parent in zip(names, parents, strict=True)
    )
    robot = Robot("two arms", joints, tuple(Link(name) for name in names), Frame("tip", 1, np.eye(4)))
    result, finding = rounded(robot, ("torso", "right", "hand"))
    assert finding is not None and "multiples: 2;" in finding.evidence
    assert "at torso" in finding.evidence or "at left" in finding.evidence
    assert all(set(np.abs(joint.placement[:3, :3]).ravel()) == {0.0, 1.0} for joint in result.joints)
    _, nothing = rounded(replace(robot, joints=(*off_the_steps(joints[:2]), *joints[2:])), ("torso", "right", "hand"))
    assert nothing is None


def off_the_steps(joints: tuple[Joint, ...]) -> tuple[Joint, ...]:
    """The joints with an orientation that is no multiple of 15° and not near one."""
    return tuple(replace(joint, placement=homogeneous(rotation_x(0.1), [0.1, 0.2, 0.3])) for joint in joints)


# Exact relations of neighbouring axes


def tilted_pair(tilt: float) -> Robot:
    """Two joints at a right angle to each other: the frame of the second undoes the tilt of the first one's axis."""
    first = Joint("a", "revolute", -1, (0.0, math.sin(tilt), math.cos(tilt)), np.eye(4), [-1, 1])
    placement = homogeneous(rpy_of_urdf([-tilt, 0.0, 0.4]), [0.0, 0.0, 0.3])
    second = Joint("b", "revolute", 0, (1.0, 0.0, 0.0), placement, [-1, 1])
    return Robot("two", (first, second), (Link("l"), Link("m")), Frame("tip", 1, np.eye(4)), gravity=(0.0, 0.0, 0.0))


def angle_of(robot: Robot) -> float:
    """Angle between the axes of both joints [rad]."""
    return math.acos(robot.joints[0].axis @ robot.joints[1].placement[:3, :3] @ robot.joints[1].axis)


def square_tilted_pair(tilt: float) -> Robot:
    """The pair with an axis of the second joint that is at a right angle to that of the first to rounding."""
    robot = tilted_pair(tilt)
    first, second = robot.joints
    across = second.placement[:3, :3].T @ np.cross(first.axis, [1.0, 0.2, 0.3])
    return replace(robot, joints=(first, replace(second, axis=across / np.linalg.norm(across))))


def test_an_exact_right_angle_of_tilted_axes_stays():
    """Each angle alone is near a multiple of 15°; if only the first axis were corrected, both would lean."""
    robot = square_tilted_pair(5e-5)
    assert abs(angle_of(robot) - 0.5 * math.pi) < 1e-12
    assert (snapped_axis(robot.joints[0].axis) != robot.joints[0].axis).any()
    result, finding = rounded(robot)
    assert abs(angle_of(result) - 0.5 * math.pi) < 1e-12
    assert finding is None


def test_rounded_angles_beside_an_exact_relation_are_still_corrected():
    robot = square_tilted_pair(5e-5)
    third = Joint(
        "c", "revolute", 1, (0.0, 0.0, 1.0), homogeneous(rpy_of_urdf([1.5708, 0.0, 0.0]), [0, 0.2, 0]), [-1, 1]
    )
    chain = replace(
        robot, joints=(*robot.joints, third), links=(*robot.links, Link("n")), tip=Frame("tip", 2, np.eye(4))
    )
    result, finding = rounded(chain)
    assert abs(angle_of(result) - 0.5 * math.pi) < 1e-12
    assert set(np.abs(result.joints[2].placement[:3, :3]).ravel()) == {0.0, 1.0}
    assert finding is not None and "multiples: 1;" in finding.evidence


def test_the_relation_to_gravity_counts_for_the_first_axis():
    robot = tilted_pair(5e-5)
    leaning = replace(robot, gravity=-9.81 * robot.joints[0].axis)
    result, _ = rounded(leaning)
    np.testing.assert_array_equal(result.joints[0].axis, robot.joints[0].axis)
    result, _ = rounded(robot.with_gravity((0.0, 0.0, -9.81)))
    np.testing.assert_array_equal(result.joints[0].axis, [0.0, 0.0, 1.0])


def test_axes_that_intersect_still_intersect():
    """The frame is rounded in one angle only, and the position follows the axis as it is described."""
    tilt = 5e-5
    first = Joint("a", "revolute", -1, (0.0, 0.0, 1.0), np.eye(4), [-1, 1])
    axis = np.array([math.sin(tilt), math.cos(tilt), 0.0])
    second = Joint("b", "revolute", 0, axis, homogeneous(np.eye(3), 0.5 * axis), [-1, 1])
    robot = Robot("two", (first, second), (Link("l"), Link("m")), Frame("tip", 1, np.eye(4)))
    result, _ = rounded(robot)
    np.testing.assert_array_equal(result.joints[1].axis, axis)
