"""Descriptions of eight real arms are read, and the built-in arms agree with those that they should agree with."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armid.robot import forward_kinematics, frame_pose, load_robot
from armid.robot.loading import ARMS
from armid.robot.readers import dh
from pinocchio_descriptions import compare

pytestmark = pytest.mark.real

FINGERS = ("panda_finger_joint1", "panda_finger_joint2")

DESCRIPTIONS = {
    "kuka_iiwa14_lasa/iiwa14.urdf": (7, "iiwa_link_ee", ()),
    "kuka_lbr_med7/med7dock.urdf": (7, "link_shaft", ()),
    "kuka_lwr4plus/kuka_lwr4.urdf": (7, "lwr_7_link", ()),
    "franka_panda_gaz/panda.urdf": (7, "panda_hand_tcp", FINGERS),
    "ur10_unisa/ur10_robot.urdf": (6, "tool0", ()),
    "ur10e_innopolis/ur10e.urdf": (6, "tool0", ()),
    "kinova_gen3_raptor/kinova.urdf": (7, "end_effector_link", ()),
    "staubli_tx40/tx40_mdh_modified.urdf": (6, "tool0", ()),
}


def states(n: int) -> np.ndarray:
    return np.random.default_rng(n).uniform(-3, 3, (50, n))


def agree(mine, theirs, tolerance):
    for a, b in zip(mine, theirs, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance)


@pytest.mark.parametrize("name", DESCRIPTIONS)
def test_all_descriptions_are_read(shared_data, name):
    n, tip, locked = DESCRIPTIONS[name]
    robot = load_robot(shared_data / name, locked=locked)
    assert robot.n == n
    assert robot.tip.name == tip
    assert robot.tip.parent == n - 1
    assert robot.inertial_vector is not None
    for joint in robot.joints:
        # All of these arms are built of right angles, whatever digits their descriptions have.
        assert set(np.abs(joint.placement[:3, :3]).ravel()) == {0.0, 1.0}
        assert set(np.abs(joint.axis)) == {0.0, 1.0}
        assert math.isfinite(joint.velocity_limit + joint.effort_limit)


def test_the_second_finger_of_the_panda_is_held(shared_data):
    path = shared_data / "franka_panda_gaz/panda.urdf"
    robot = load_robot(path)
    assert robot.joint_names[7:] == ("panda_finger_joint1",)
    assert any(f.code == "joint-follows" and f.channel == "panda_finger_joint1" for f in robot.findings)
    assert load_robot(path, tip="panda_link8").n == load_robot(path, only="panda_joint?").n == 7


def test_the_gen3_turns_without_end_and_its_pi_is_reported(shared_data):
    robot = load_robot(shared_data / "kinova_gen3_raptor/kinova.urdf")
    assert [joint.kind for joint in robot.joints] == ["continuous", "revolute"] * 3 + ["continuous"]
    found = [finding for finding in robot.findings if finding.code == "description-rounded"]
    assert len(found) == 1
    assert "7.3e-06 rad, at joint_1" in found[0].evidence


def test_iiwa14_frames_and_limits_are_those_of_the_urdf(shared_data):
    mine, theirs = load_robot("iiwa14-r820"), load_robot(shared_data / "kuka_iiwa14_lasa/iiwa14.urdf")
    q = states(7)
    agree(forward_kinematics(mine, q), forward_kinematics(theirs, q), 1e-15)
    agree(frame_pose(mine, q), frame_pose(theirs, q), 1e-15)
    for a, b in zip(mine.joints, theirs.joints, strict=True):
        np.testing.assert_allclose(a.position_limits, b.position_limits, rtol=1e-8)
        assert a.velocity_limit == pytest.approx(b.velocity_limit, rel=1e-8)
        assert a.effort_limit == b.effort_limit


def test_iiwa7_flange_is_that_of_the_med7(shared_data):
    mine, theirs = load_robot("iiwa7-r800"), load_robot(shared_data / "kuka_lbr_med7/med7dock.urdf", tip="link_ee")
    agree(frame_pose(mine, states(7)), frame_pose(theirs, states(7)), 1e-14)


def test_panda_frames_and_limits_are_those_of_the_urdf(shared_data):
    mine = load_robot("panda")
    theirs = load_robot(shared_data / "franka_panda_gaz/panda.urdf", locked=FINGERS, tip="panda_link8")
    q = states(7)
    agree(forward_kinematics(mine, q), forward_kinematics(theirs, q), 1e-15)
    agree(frame_pose(mine, q), frame_pose(theirs, q), 1e-15)
    assert mine.joint_names == theirs.joint_names
    for a, b in zip(mine.joints, theirs.joints, strict=True):
        assert a.position_limits.tolist() == b.position_limits.tolist()
        assert (a.velocity_limit, a.effort_limit) == (b.velocity_limit, b.effort_limit)


@pytest.mark.parametrize("arm", ["ur5e", "ur10e"])
@pytest.mark.parametrize("urdf", ["ur10e_innopolis/ur10e.urdf", "ur10_unisa/ur10_robot.urdf"])
def test_ur_arms_turn_as_the_urdf_does(shared_data, arm, urdf):
    """With the lengths of the older descriptions, our tables give their flange, seen from a base turned by 180°."""
    theirs = load_robot(shared_data / urdf)
    at = [joint.placement[:3, 3] for joint in theirs.joints]
    lengths = {
        "d": (at[0][2], 0.0, 0.0, at[1][1] + at[2][1] + at[4][1], at[5][2], theirs.tip.placement[1, 3]),
        "a": (0.0, -at[2][2], -at[3][2], 0.0, 0.0, 0.0),
    }
    lines = (ARMS / f"{arm}.toml").read_text().splitlines()
    for key, values in lengths.items():
        places = [i for i, line in enumerate(lines) if line.startswith(f"{key} = ")]
        for place, value in zip(places, values, strict=True):
            lines[place] = f"{key} = {float(value)!r}"
    mine = dh.read("\n".join(lines), source=arm, locked={}, tip=None)
    R, p = frame_pose(mine, states(6))
    half_turn = np.diag([-1.0, -1.0, 1.0])
    agree((half_turn @ R, p @ half_turn), frame_pose(theirs, states(6)), 1e-14)
    assert mine.joint_names == theirs.joint_names


@pytest.mark.witness
@pytest.mark.parametrize("name", DESCRIPTIONS)
def test_joints_inertias_torques_and_base_parameters_are_those_of_pinocchio(shared_data, name):
    found = compare(shared_data / name)
    assert found.holds and found.base is not None, found
