"""Reading MJCF against MuJoCo: what its own compiler makes of the same text."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from armid.kernel import reference
from armid.robot import frame_pose, load_robot
from armid.robot.kinematics import forward_kinematics

TOLERANCE = 1e-12
"""Absolute, on metres and N·m of order one to a hundred."""

ORIENTATIONS = [
    "",
    'quat="1 2 3 4"',
    'euler="10 20 30"',
    'axisangle="1 2 3 40"',
    'xyaxes="0 2 0.1 1 0 0"',
    'zaxis="1 0 1"',
    'zaxis="0 0 -1"',
]

MASS = '<inertial pos="0.1 0 0.2" euler="30 10 0" mass="2" diaginertia="0.1 0.2 0.25"/>'

EVERYTHING = """
<mujoco model="everything">
  <compiler angle="degree" eulerseq="XyZ"/>
  <option gravity="1 2 3"/>
  <default>
    <joint axis="0 1 0" range="-90 80"/>
    <default class="c">
      <joint type="slide" range="-1 2"/> <geom density="300"/>
      <default class="d"> <joint axis="1 1 0" limited="false"/> </default>
    </default>
  </default>
  <worldbody>
    <light pos="0 0 1"/> <geom type="plane" size="1 1 1"/>
    <body name="base" pos="0 0 0.3" euler="10 20 30">
      <geom type="box" size="0.1 0.1 0.1"/>
      <body name="a" pos="0.1 0.2 0.3" axisangle="1 2 3 40">
        <joint name="j1" ref="20"/> <joint name="j2" axis="1 0 0" pos="0 0.1 0.2"/>
        <joint name="j3" type="slide" axis="0 0 1"/>
        <inertial pos="0.1 0 0.2" euler="30 10 0" mass="2" diaginertia="1 2 2.5"/>
        <body pos="0 0 0.4" childclass="c" zaxis="1 0 1">
          <joint name="j4" ref="0.2"/>
          <geom type="capsule" fromto="0 0 0 0.1 0.2 0.3" size="0.05"/> <geom size="0.1" mass="0"/>
          <body name="fixed" pos="0.1 0.1 0.1" xyaxes="0 1 0 1 0 0.3">
            <geom type="cylinder" size="0.1 0.2" euler="0 45 10"/>
            <geom type="ellipsoid" size="0.1 0.2 0.1" mass="2"/>
            <body name="last" pos="0 0 0.2">
              <joint name="j5" class="d" type="hinge"/>
              <inertial pos="0.1 0 0.2" mass="1" fullinertia="1 2 2.5 0.1 0.2 0.3"/>
              <site name="tcp" pos="0 0 0.1" euler="0 90 0"/>
            </body>
          </body>
        </body>
      </body>
    </body>
    <body name="other">
      <joint name="k" type="hinge"/> <geom type="box" size="0.1 0.2 0.3" pos="0.1 0 0"/>
    </body>
  </worldbody>
</mujoco>
"""


def chain(orientation: str, eulerseq: str) -> str:
    """Two joints, the second turned by an orientation, with a site."""
    return (
        f'<mujoco><compiler eulerseq="{eulerseq}"/><worldbody><body name="a"><joint name="j"/>{MASS}'
        f'<body name="b" pos="0.3 0 0.1" {orientation}><joint name="k" axis="0 1 0"/>{MASS}'
        f'<site name="tcp" pos="0.1 0 0" {orientation}/></body></body></worldbody></mujoco>'
    )


def check_against_mujoco(text: str, path) -> None:
    path.write_text(text)
    robot = load_robot(path, only="*", tip="tcp")
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    assert list(robot.joint_names) == [model.joint(i).name for i in range(model.njnt)]
    for joint, limits, limited in zip(robot.joints, model.jnt_range, model.jnt_limited, strict=True):
        np.testing.assert_allclose(joint.position_limits, limits if limited else [-np.inf, np.inf], atol=1e-15)
    rng = np.random.default_rng(0)
    inertial = robot.inertial_vector
    assert inertial is not None
    for _ in range(5):
        q, dq, ddq = rng.uniform(-1, 1, (3, 1, robot.n))
        data.qpos, data.qvel, data.qacc = q[0], dq[0], ddq[0]
        mujoco.mj_inverse(model, data)
        R, p = frame_pose(robot, q)
        np.testing.assert_allclose(p[0], data.site("tcp").xpos, rtol=0, atol=TOLERANCE)
        np.testing.assert_allclose(R[0].ravel(), data.site("tcp").xmat, rtol=0, atol=TOLERANCE)
        tau = reference.inverse_dynamics(robot.tree, inertial, q, dq, ddq)
        np.testing.assert_allclose(tau[0], data.qfrc_inverse, rtol=0, atol=TOLERANCE)


def test_a_description_that_uses_everything(tmp_path):
    check_against_mujoco(EVERYTHING, tmp_path / "everything.xml")


@pytest.mark.parametrize("eulerseq", ["xyz", "XYZ", "zyX"])
@pytest.mark.parametrize("orientation", ORIENTATIONS)
def test_every_way_to_write_an_orientation(tmp_path, orientation, eulerseq):
    check_against_mujoco(chain(orientation, eulerseq), tmp_path / "chain.xml")


SITES = """
<mujoco model="sites"><compiler angle="radian"/><worldbody>
  <body name="a" pos="0 0 0.1"><joint name="j" axis="0 0 1" pos="0.03 0.02 0.01"/><geom size="0.1" mass="1"/>
    <site name="on-a" pos="0.1 0.2 0.3"/>
    <body name="fixed" pos="0.2 0 0" quat="0.9 0.1 0.2 0.3"><geom size="0.05" mass="0.5" pos="0.01 0 0"/>
      <site name="on-fixed" pos="0.01 0.02 0.03" euler="0.1 0.2 0.3"/>
      <body name="b" pos="0 0.3 0"><joint name="k" axis="0 1 0" pos="-0.05 0.07 0.02"/><geom size="0.05" mass="1"/>
        <site name="on-b" pos="0.1 0 0.05" zaxis="1 2 3"/>
        <body name="g" pos="0.1 0.1 0.1" quat="0.8 0.2 -0.2 0.3"><geom size="0.02" mass="0.2"/>
          <site name="on-g" pos="0.03 0.01 0" xyaxes="0 2 0.1 1 0 0"/>
          <body name="h" pos="0.05 0 0.02" euler="1 0 0"><geom size="0.02" mass="0.2"/>
            <site name="on-h" pos="0.01 0.01 0.3"/></body></body></body></body></body>
</worldbody></mujoco>
"""
"""Joints off their body's origin, fixed bodies on them, and sites everywhere: Pinocchio misplaces some of these."""


@pytest.mark.parametrize("site", ["on-a", "on-fixed", "on-b", "on-g", "on-h"])
def test_a_tip_is_where_mujoco_has_the_site(site, tmp_path):
    path = tmp_path / "sites.xml"
    path.write_text(SITES)
    robot = load_robot(path, tip=site)
    model = mujoco.MjModel.from_xml_string(SITES)
    data = mujoco.MjData(model)
    for q in np.random.default_rng(0).uniform(-1, 1, (3, robot.n)):
        data.qpos = q
        mujoco.mj_kinematics(model, data)
        R, p = frame_pose(robot, q[None])
        np.testing.assert_allclose(p[0], data.site(site).xpos, rtol=0, atol=TOLERANCE)
        np.testing.assert_allclose(R[0].ravel(), data.site(site).xmat, rtol=0, atol=TOLERANCE)


def test_bodies_are_where_mujoco_has_them(tmp_path):
    """Every geom's place, and its axis z, in random poses; what touches nothing is seen only."""
    text = EVERYTHING.replace(
        '<geom size="0.1" mass="0"/>', '<geom size="0.1" mass="0" contype="0" conaffinity="0"/>'
    )
    path = tmp_path / "everything.xml"
    path.write_text(text)
    robot = load_robot(path, only="*", tip="tcp")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    assert len(robot.visuals) == model.ngeom == len(robot.shapes) + 1
    kinds = {
        "half-space": "PLANE",
        "sphere": "SPHERE",
        "ellipsoid": "ELLIPSOID",
        "capsule": "CAPSULE",
        "cylinder": "CYLINDER",
        "box": "BOX",
    }
    for q in np.random.default_rng(0).uniform(-1, 1, (3, robot.n)):
        data.qpos = q
        mujoco.mj_kinematics(model, data)
        R, p = forward_kinematics(robot, q[None])
        for k, shape in enumerate(robot.visuals):
            assert mujoco.mjtGeom(model.geom_type[k]).name.removeprefix("mjGEOM_") in kinds[shape.kind]
            turn, place = (R[0, shape.link], p[0, shape.link]) if shape.link >= 0 else (np.eye(3), np.zeros(3))
            np.testing.assert_allclose(place + turn @ shape.placement[:3, 3], data.geom_xpos[k], atol=TOLERANCE)
            axis = np.abs(turn @ shape.placement[:3, 2])  # a capsule may lie the other way round
            np.testing.assert_allclose(axis, np.abs(data.geom_xmat[k].reshape(3, 3)[:, 2]), atol=TOLERANCE)
