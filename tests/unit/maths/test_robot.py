"""The robot value: inertial parameters, joints, locking, loading by name or path."""

from __future__ import annotations

import hashlib
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armid.dataclass_files import load, save
from armid.errors import ArmidError, RobotError
from armid.maths.rotations import homogeneous
from armid.robot import (
    Frame,
    InertialParameters,
    Joint,
    Link,
    Robot,
    builtin_arms,
    forward_kinematics,
    frame_pose,
    load_robot,
)

UNLIMITED = (-math.inf, math.inf)


def body(rng: np.random.Generator) -> InertialParameters:
    """A solid box somewhere, in some orientation."""
    size = rng.uniform(0.1, 0.3, 3)
    mass = rng.uniform(0.5, 4.0)
    R = Rotation.random(random_state=int(rng.integers(1000))).as_matrix()
    about_com = R @ np.diag(mass / 12.0 * (size @ size - size**2)) @ R.T
    return InertialParameters.from_com(mass, rng.normal(scale=0.1, size=3), about_com)


def chain(n: int = 5, seed: int = 0, parents: list[int] | None = None) -> Robot:
    rng = np.random.default_rng(seed)
    parents = parents or list(range(-1, n - 1))
    joints, links = [], []
    for i in range(n):
        placement = homogeneous(Rotation.random(random_state=seed + i).as_matrix(), rng.normal(size=3))
        kind = "prismatic" if i % 3 == 2 else "revolute"
        joints.append(Joint(f"j{i}", kind, parents[i], rng.normal(size=3), placement, UNLIMITED))
        links.append(Link(f"l{i}", body(rng)))
    return Robot("chain", tuple(joints), tuple(links), Frame("tip", n - 1, homogeneous(np.eye(3), [0.0, 0.1, 0.2])))


# Inertial parameters


def test_another_frame_and_back_is_the_same_body():
    rng = np.random.default_rng(0)
    given, R, p = body(rng), Rotation.random(random_state=1).as_matrix(), rng.normal(size=3)
    there = given.seen_from(R, p)
    np.testing.assert_allclose(there.com, R @ given.com + p, atol=1e-14)
    np.testing.assert_allclose(there.seen_from(R.T, -R.T @ p).vector, given.vector, atol=1e-14)


def test_consistency_needs_the_triangle_inequality_not_just_a_positive_inertia():
    assert InertialParameters.from_com(1.0, [0, 0, 0.1], np.diag([1.0, 1.0, 2.0])).is_consistent()
    assert not InertialParameters.from_com(1.0, [0, 0, 0.1], np.diag([1.0, 1.0, 2.1])).is_consistent()
    assert not InertialParameters.from_com(-1.0, [0, 0, 0.1], np.zeros((3, 3))).is_consistent()
    assert InertialParameters.zero().is_consistent()


def test_a_point_mass_is_consistent_and_no_body_has_no_centre():
    assert InertialParameters.from_com(2.0, [0.1, 0.2, 0.3], np.zeros((3, 3))).is_consistent()
    assert np.isnan(InertialParameters.zero().com).all()


# Joints and robots


def test_axes_are_normalised_and_zero_axes_refused():
    assert Joint("a", "revolute", -1, [0, 0, 5], np.eye(4), UNLIMITED).axis.tolist() == [0, 0, 1]
    with pytest.raises(RobotError, match="'a' has an axis of zero length"):
        Joint("a", "revolute", -1, [0, 0, 0], np.eye(4), UNLIMITED)


def test_kinds_of_several_degrees_of_freedom_are_refused():
    with pytest.raises(RobotError, match="'a' is of kind 'planar'"):
        Joint("a", "planar", -1, [0, 0, 1], np.eye(4), UNLIMITED)


def test_names_must_differ_and_parents_come_first():
    one = chain(1)
    with pytest.raises(RobotError, match="must differ"):
        Robot("r", one.joints * 2, one.links * 2, one.tip)
    with pytest.raises(RobotError, match="Parents must come before"):
        chain(2, parents=[1, -1])
    with pytest.raises(RobotError, match="found 2 joints and 1 links"):
        Robot("r", chain(2).joints, one.links, one.tip)


def test_gravity_is_one_argument():
    assert chain().with_gravity([0, 0, 9.81]).tree.gravity.tolist() == [0, 0, 9.81]
    with pytest.raises(ArmidError, match="gravity must have shape"):
        chain().with_gravity([9.81])


def test_no_mass_anywhere_means_no_nominal_parameters():
    robot = chain(2)
    nothing = (Link("a"), Link("b", InertialParameters.zero()))
    assert Robot("r", robot.joints, nothing, robot.tip).inertial_vector is None
    some = (Link("a"), robot.links[1])
    vector = Robot("r", robot.joints, some, robot.tip).inertial_vector
    assert vector is not None
    assert not vector[0].any()
    assert vector[1].any()


def test_a_robot_survives_its_file(tmp_path):
    robot = load_robot("iiwa14-r820", locked={"A3": 0.4})
    again = load(Robot, save(robot, tmp_path / "robot.npz"))
    assert repr(again) == repr(robot) == "Robot('iiwa14-r820': A1, A2, A4, A5, A6, A7; tip 'flange')"
    q = np.random.default_rng(0).normal(size=(3, 6))
    assert (frame_pose(again, q)[1] == frame_pose(robot, q)[1]).all()
    assert (again.inertial_vector == robot.inertial_vector).all()
    assert again.joints[0].position_limits.tolist() == robot.joints[0].position_limits.tolist()


# Locking


@pytest.mark.parametrize("parents", [None, [-1, 0, 1, 0, 3], [-1, -1, 1, 1, 2]])
@pytest.mark.parametrize("index", range(5))
def test_a_locked_joint_leaves_all_other_frames_where_they_are(parents, index):
    robot = chain(parents=parents)
    q = np.random.default_rng(index).uniform(-2, 2, (4, 5))
    q[:, index] = 0.7
    R, p = forward_kinematics(robot, q)
    kept = [i for i in range(5) if i != index]
    held = robot.lock({f"j{index}": 0.7})
    assert held.joint_names == tuple(f"j{i}" for i in kept)
    R_held, p_held = forward_kinematics(held, q[:, kept])
    np.testing.assert_allclose(R_held, R[:, kept], atol=1e-14)
    np.testing.assert_allclose(p_held, p[:, kept], atol=1e-14)
    for mine, theirs in zip(frame_pose(held, q[:, kept]), frame_pose(robot, q), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-14)


def test_mass_moves_to_the_carrying_link_or_the_base():
    robot = chain()
    masses = [link.inertial.mass for link in robot.links]
    held = robot.lock(["j3"])
    assert [link.inertial.mass for link in held.links] == [*masses[:2], masses[2] + masses[3], masses[4]]
    assert [link.inertial.mass for link in robot.lock(["j0"]).links] == masses[1:]


def test_the_order_of_locking_does_not_matter():
    robot = chain(parents=[-1, 0, 1, 1, 3])
    one = robot.lock({"j1": 0.3, "j3": -0.2})
    other = robot.lock({"j3": -0.2, "j1": 0.3})
    np.testing.assert_allclose(one.inertial_vector, other.inertial_vector, atol=1e-14)
    q = np.random.default_rng(0).normal(size=(3, 3))
    np.testing.assert_allclose(frame_pose(one, q)[1], frame_pose(other, q)[1], atol=1e-14)


def test_locking_what_is_not_there_or_everything_is_refused():
    with pytest.raises(RobotError, match=r"no joint 'elbow'(.|\n)*j0, j1, j2, j3, j4"):
        chain().lock(["elbow"])
    with pytest.raises(RobotError, match="chain has no movable joint"):
        chain(2).lock(["j0", "j1"])


# Loading


def test_builtin_arms_are_complete():
    assert builtin_arms() == ("iiwa14-r820", "iiwa7-r800", "panda", "ur10e", "ur5e")
    for name in builtin_arms():
        robot = load_robot(name)
        assert robot.name == robot.source == name
        assert len(robot.sha256) == 64
        assert robot.findings == ()
        for joint in robot.joints:
            assert np.isfinite(joint.position_limits).all()
            assert math.isfinite(joint.velocity_limit + joint.effort_limit)
        assert all(link.inertial is None or link.inertial.is_consistent() for link in robot.links)


def test_the_stretched_arm_has_the_length_of_the_data_sheet():
    for name, length in (("iiwa14-r820", 0.36 + 0.42 + 0.4 + 0.126), ("iiwa7-r800", 0.34 + 0.4 + 0.4 + 0.126)):
        _, p = frame_pose(load_robot(name), np.zeros((1, 7)))
        np.testing.assert_allclose(p[0], [0, 0, length], atol=1e-15)
    # Zero pose of the UR: stretched out along -x of the controller's base, as in the support article's table.
    for name, reach, side, height in (
        ("ur5e", 0.425 + 0.3922, 0.1333 + 0.0996, 0.1625 - 0.0997),
        ("ur10e", 0.6127 + 0.57155, 0.17415 + 0.11655, 0.1807 - 0.11985),
    ):
        _, p = frame_pose(load_robot(name), np.zeros((1, 6)))
        np.testing.assert_allclose(p[0], [-reach, -side, height], atol=1e-15)


def test_load_options():
    robot = load_robot("iiwa14-r820", gravity=[0, 0, 9.81], locked="A7", tip="link_6")
    assert robot.gravity.tolist() == [0, 0, 9.81]
    assert robot.joint_names[-1] == "A6"
    assert robot.tip.name == "link_6"


def test_unknown_names_list_what_there_is():
    with pytest.raises(RobotError) as caught:
        load_robot("iiwa14")
    assert "iiwa14-r820, iiwa7-r800, panda, ur10e, ur5e" in caught.value.possible
    assert ".mjcf, .toml, .urdf, .xacro, .xml" in caught.value.possible
    assert "did you mean 'iiwa14-r820'" in caught.value.remedy


def test_a_missing_file_points_at_its_neighbour(tmp_path):
    (tmp_path / "robot.urdf").write_text("<robot/>")
    with pytest.raises(RobotError, match=r"no robot description .*robt.urdf(.|\n)*did you mean .*robot.urdf"):
        load_robot(tmp_path / "robt.urdf")


def test_files_of_another_kind_are_refused(tmp_path):
    (tmp_path / "robot.stl").write_text("solid")
    for path in (tmp_path / "robot.stl", tmp_path):
        with pytest.raises(RobotError, match="is not a robot description in a format that armid can read"):
            load_robot(path)
    (tmp_path / "robot.urdf").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RobotError, match="cannot be read"):
        load_robot(tmp_path / "robot.urdf")


def test_the_digest_is_that_of_the_text(tmp_path):
    text = 'convention = "modified"\n[[joint]]\nname = "a"\nd = 1.0\n'
    path = tmp_path / "one.toml"
    path.write_text(text)
    robot = load_robot(path)
    assert robot.sha256 == hashlib.sha256(text.encode()).hexdigest()
    assert robot.source == str(path)


@pytest.mark.parametrize("locked", [["A8"], {"A8": 1.0}])
def test_locking_an_unknown_joint_while_loading(locked):
    with pytest.raises(RobotError, match=r"no joint 'A8' to lock(.|\n)*A1, A2, A3, A4, A5, A6, A7"):
        load_robot("iiwa14-r820", locked=locked)
