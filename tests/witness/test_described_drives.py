"""Torque of a description with rotor inertia and friction, against MuJoCo's inverse dynamics and the laws of URDF."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from armid.excitation.design.objective import CriterionGoal
from armid.excitation.limits.joint_limits import limits_of
from armid.model.base_parameters import find_base_parameters
from armid.model.described_torque import described_torque
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import RigidBody
from armid.robot import load_robot
from armid.study.plans.design import DesignConstraints, DesignGoal, SearchBudget, design_plan
from armid.study.plans.torque_constraint import judged_torque

TOLERANCE = 1e-12
"""Absolute, on torques of order one to a hundred N·m; rounding only."""

MJCF = """
<mujoco><compiler angle="radian"/>
  <default><joint damping="0.3"/>
    <default class="large"><joint armature="1.5" frictionloss="2"/></default>
  </default>
  <worldbody><body name="a"><joint name="j" class="large"/>{mass}
    <body name="b" pos="0.3 0 0.1"><joint name="k" axis="0 1 0" armature="0.2" damping="0"/>{mass}
      <body name="c" pos="0 0 0.2"><joint name="s" type="slide" axis="1 0 0" frictionloss="0.7"/>{mass}
  </body></body></body></worldbody></mujoco>
""".format(mass='<inertial pos="0.1 0 0.2" mass="2" diaginertia="0.1 0.2 0.25"/>')

URDF_JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 1 0"/>'
    '<limit lower="-1" upper="1" velocity="1" effort="50"/>{3}</joint>'
)
URDF_LINK = (
    '<link name="{0}"><inertial><origin xyz="0.1 0 0.2"/><mass value="2"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
)


def states(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    return rng.normal(size=(40, n)), rng.normal(size=(40, n)), rng.normal(size=(40, n))


def torque_of(path, q, dq, ddq):
    model, theta = described_torque(load_robot(path))
    return model.torque(Motion.of_states(q, dq, ddq), theta)


def mujoco_torque(path, q, dq, ddq):
    """Torque of MuJoCo's inverse dynamics, with Coulomb friction for the constraint by which it softens it."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, expected = mujoco.MjData(model), np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        expected[k] = data.qfrc_inverse
    return expected + model.dof_frictionloss * np.sign(dq)


def test_armature_damping_and_friction_of_an_mjcf_are_those_of_mujoco(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(MJCF)
    q, dq, ddq = states(3)
    assert torque_of(path, q, dq, ddq) == pytest.approx(mujoco_torque(path, q, dq, ddq), abs=TOLERANCE)


def test_friction_of_a_urdf_is_added_to_the_torque_of_its_links(tmp_path):
    links = "".join(map(URDF_LINK.format, "abc"))

    def written(first: str, second: str):
        path = tmp_path / "arm.urdf"
        joints = URDF_JOINT.format("j", "a", "b", first) + URDF_JOINT.format("k", "b", "c", second)
        path.write_text(f'<robot name="arm">{links}{joints}</robot>')
        return path

    q, dq, ddq = states(2)
    bare = torque_of(written("", ""), q, dq, ddq)
    described = torque_of(written('<dynamics damping="0.4"/>', '<dynamics damping="0.1" friction="3"/>'), q, dq, ddq)
    friction = np.array([0.4, 0.1]) * dq + np.array([0.0, 3.0]) * np.sign(dq)
    assert described - bare == pytest.approx(friction, abs=TOLERANCE)


def test_a_value_that_every_joint_has_is_told_once(tmp_path):
    links = "".join(map(URDF_LINK.format, "abc"))
    same = '<dynamics damping="0.4" friction="3"/>'
    for second, counted in (
        (same, "viscous friction (0.4 N·m·s/rad at every joint), Coulomb friction (3 N·m at every joint)"),
        (
            '<dynamics damping="0.1"/>',
            "viscous friction (j 0.4 N·m·s/rad, k 0.1 N·m·s/rad), Coulomb friction (j 3 N·m)",
        ),
    ):
        joints = URDF_JOINT.format("j", "a", "b", same) + URDF_JOINT.format("k", "b", "c", second)
        (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{links}{joints}</robot>')
        model = DynamicsModel(load_robot(tmp_path / "arm.urdf"), (RigidBody(),))
        goal = CriterionGoal(model, find_base_parameters(model))
        _, findings = judged_torque(goal, limits_of(model.robot), DesignConstraints())
        (told,) = [each.evidence for each in findings if each.code == "torque-nominal"]
        assert counted in told


def test_a_plan_keeps_its_torque_limits_with_the_drives_of_mujoco(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(MJCF)
    model = DynamicsModel(load_robot(path), (RigidBody(),))
    given = {(name, kind): 1.0 for name in "jks" for kind in ("velocity", "acceleration")}
    given |= {(name, "position"): (-1.0, 1.0) for name in "jks"}
    given |= {("j", "effort"): 5.0, ("k", "effort"): 40.0, ("s", "effort"): 45.0}
    goal = DesignGoal(CriterionGoal(model, find_base_parameters(model)), 6.0, 4, start=np.zeros(3))
    found = design_plan(goal, DesignConstraints(given=given), SearchBudget(None, 1, 0, 1))
    (counted,) = [each.evidence for each in found.findings if each.code == "torque-nominal"]
    assert "rotor inertia (j 1.5 kg·m², k 0.2 kg·m²)" in counted
    assert "viscous friction (j 0.3 N·m·s/rad, s 0.3 N·s/m)" in counted
    assert "Coulomb friction (j 2 N·m, s 0.7 N)" in counted

    motion = found.plan.excitation.sample(4000.0)  # four times as dense as the grid of the certificate
    torque = np.abs(mujoco_torque(path, motion.q, motion.dq, motion.ddq))
    margins = {each.label: each for each in found.preflight.margins if each.limit == "torque"}
    for j, name in enumerate("jks"):
        highest, margin = torque[:, j].max(), margins[name]
        assert margin.value <= highest + TOLERANCE  # the grid is a part of the motion
        assert highest / margin.bound <= margin.certified + TOLERANCE
        assert margin.certified <= 1.0
    tightest = max(margins.values(), key=lambda each: each.share)
    assert tightest.share > 0.5, "no limit is near, so that nothing was tested"
