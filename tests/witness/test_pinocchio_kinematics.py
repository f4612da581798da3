"""Reading and kinematics against Pinocchio, which reads the same URDF by itself."""

from __future__ import annotations

import numpy as np
import pytest

from armid.maths.inertia import inertia_matrix
from armid.robot import forward_kinematics, frame_pose, load_robot

pin = pytest.importorskip("pinocchio", reason="the package pin is not installed")
pytestmark = pytest.mark.witness

TOLERANCE = 1e-12
"""Relative to arms of some metres: products of up to a dozen rotations differ by rounding."""

KINDS = ["revolute", "continuous", "prismatic", "fixed"]


def numbers(values) -> str:
    return " ".join(repr(float(v)) for v in values)


def random_urdf(rng: np.random.Generator, n: int) -> str:
    """A tree of n links with bodies that can exist; about a third of the orientations are right angles."""
    parts = ['<robot name="random"><link name="l0"/>']
    for i in range(1, n + 1):
        size, mass = rng.uniform(0.05, 0.4, 3), rng.uniform(0.2, 5.0)
        ixx, iyy, izz = (mass / 12.0 * (size @ size - size**2)).tolist()
        parent = i - 1 if rng.random() < 0.7 else rng.integers(0, i)
        kind = "revolute" if i == 1 else rng.choice(KINDS)
        rpy = rng.integers(-2, 3, 3) * np.pi / 2 if rng.random() < 0.3 else rng.uniform(-3, 3, 3)
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3)
        parts.append(
            f'<link name="l{i}"><inertial><origin xyz="{numbers(rng.normal(scale=0.2, size=3))}"'
            f' rpy="{numbers(rng.uniform(-3, 3, 3))}"/><mass value="{mass!r}"/><inertia ixx="{ixx!r}" iyy="{iyy!r}"'
            f' izz="{izz!r}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="j{i}" type="{kind}">'
            f'<origin xyz="{numbers(rng.uniform(-0.5, 0.5, 3))}" rpy="{numbers(rpy)}"/>'
            f'<parent link="l{parent}"/><child link="l{i}"/><axis xyz="{numbers(axis)}"/>'
            '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        )
    return "".join(parts) + "</robot>"


def configuration(model, names, q):
    """Pinocchio's configuration: cosine and sine for unbounded joints."""
    result = pin.neutral(model)
    for name, value in zip(names, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        result[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
    return result


def close(mine, theirs):
    np.testing.assert_allclose(mine, theirs, rtol=0, atol=TOLERANCE)


def check_against(robot, model, rng):
    """Frames, tip and inertials of `robot` are those of `model`."""
    assert set(robot.joint_names) == set(list(model.names)[1:])
    data = model.createData()
    q = rng.uniform(-2, 2, (3, robot.n))
    R, p = forward_kinematics(robot, q)
    R_tip, p_tip = frame_pose(robot, q)
    for k in range(len(q)):
        pin.framesForwardKinematics(model, data, configuration(model, robot.joint_names, q[k]))
        for i, name in enumerate(robot.joint_names):
            pose = data.oMi[model.getJointId(name)]
            close(R[k, i], pose.rotation)
            close(p[k, i], pose.translation)
        pose = data.oMf[model.getFrameId(robot.tip.name, pin.FrameType.BODY)]
        close(R_tip[k], pose.rotation)
        close(p_tip[k], pose.translation)
    for joint, link in zip(robot.joints, robot.links, strict=True):
        inertia = model.inertias[model.getJointId(joint.name)]
        close(link.inertial.mass, inertia.mass)
        close(link.inertial.com, inertia.lever)
        about_com = link.inertial.seen_from(np.eye(3), -link.inertial.com)
        close(inertia_matrix(about_com.inertia), inertia.inertia)


@pytest.mark.parametrize("seed", range(60))
def test_random_trees(tmp_path, seed):
    rng = np.random.default_rng(seed)
    text = random_urdf(rng, int(rng.integers(1, 13)))
    path = tmp_path / "random.urdf"
    path.write_text(text)
    robot = load_robot(path)
    check_against(robot, pin.buildModelFromXML(text), rng)
    assert robot.findings == ()


@pytest.mark.parametrize("seed", range(60))
def test_locked_joints_are_those_of_a_reduced_model(tmp_path, seed):
    rng = np.random.default_rng(1000 + seed)
    text = random_urdf(rng, int(rng.integers(6, 13)))
    path = tmp_path / "random.urdf"
    path.write_text(text)
    model = pin.buildModelFromXML(text)
    names = list(model.names)[1:]
    chosen = rng.choice(names, size=int(rng.integers(0, len(names))), replace=False)
    locked = {str(name): float(rng.uniform(-1, 1)) for name in chosen}
    at = configuration(model, locked, locked.values())
    reduced = pin.buildReducedModel(model, [model.getJointId(name) for name in locked], at)
    check_against(load_robot(path, locked=locked), reduced, rng)
