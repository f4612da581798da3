"""MuJoCo's closed loop of position servos is the roll-out's."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from armid import kernel
from armid.kernel import ServoJoints
from armid.model.terms import Coulomb, Viscous
from armid.model.terms.law_programs import law_programs
from armid.robot import load_robot

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{step}" integrator="implicitfast"/>
  <default>
    <joint armature="0.02" damping="0.4" frictionloss="{dry}" solimpfriction="0.9999 0.9999 0.001 0.5 2"
           solreffriction="0.002 1"/>
    <position kp="25" kv="0.3" forcerange="-4 4"/>
  </default>
  <worldbody>
    <body>
      <joint name="pan" axis="0 0 1"/>
      <inertial pos="0.02 0 0.05" mass="0.5" diaginertia="0.002 0.002 0.001"/>
      <body pos="0 0 0.1" euler="0.3 0 0">
        <joint name="lift" axis="0 1 0"/>
        <inertial pos="0.1 0 0.02" mass="0.4" diaginertia="0.001 0.003 0.003"/>
        <body pos="0.25 0 0">
          <joint name="slide" type="slide" axis="1 0 0" armature="0.5"/>
          <inertial pos="0.05 0 0" mass="0.2" diaginertia="0.0005 0.0006 0.0006"/>
          <body pos="0.05 0 0">
            <joint name="wrist" axis="0 1 0"/>
            <inertial pos="0.04 0.01 0" mass="0.1" diaginertia="0.0002 0.0001 0.0002"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="pan"/> <position joint="lift"/> <position joint="slide" kp="200"/> <position joint="wrist"/>
  </actuator>
</mujoco>
"""

SAME = 2e-4
"""Largest difference [rad or m] from MuJoCo's motion, extrapolated to steps of zero, because its integration is of
first order. What is left is of second order, and its dry friction is a soft constraint."""


def simulated(path, text: str, command, step: float, each: int):
    """MuJoCo's positions after every `each` steps, with the command held in between."""
    path.write_text(text.format(step=step))
    model = mujoco.MjModel.from_xml_path(str(path))
    data, q = mujoco.MjData(model), np.zeros((len(command) + 1, model.nq))
    for k, held in enumerate(command):
        data.ctrl[:] = held
        for _ in range(each):
            mujoco.mj_step(model, data)
        q[k + 1] = data.qpos
    return q


@pytest.mark.parametrize("dry", [0.0, 0.1])
def test_closed_loop(tmp_path, dry):
    path, text = tmp_path / "arm.xml", ARM.replace("{dry}", str(dry))
    path.write_text(text.format(step=1e-3))
    robot = load_robot(path)
    steps, h = 4000, 1e-3
    t = h * (np.arange(steps) + 0.5)
    command = 0.4 * np.sin(2.0 * np.pi * np.outer(t, [0.4, 0.7, 0.5, 1.1])) * [1.0, 1.0, 0.1, 1.0]
    command[2000:] += [0.3, 0.0, 0.02, 0.0]  # a jump into the limit of the torque
    laws = law_programs([*Viscous().laws(robot), *Coulomb(0.0).laws(robot)])
    values = np.concatenate([np.full(4, 0.4), np.full(4, dry)])
    stiffness, armature = [25.0, 25.0, 200.0, 25.0], [0.02, 0.02, 0.5, 0.02]
    servos = ServoJoints(stiffness, np.full(4, 0.3), np.full(4, 4.0), armature, laws, values, h)
    bodies = np.array([link.inertial.vector for link in robot.links])
    q, _, unsettled = kernel.roll_out(
        robot.tree, bodies, servos, command[None], None, np.zeros((1, 4)), np.zeros((1, 4))
    )
    coarse, fine = (simulated(path, text, command, h / each, each) for each in (4, 8))
    theirs = 2.0 * fine - coarse
    assert unsettled == 0
    assert np.abs(servos.stiffness * (command - q[0, 1:])).max() > 4.0  # the limit was met
    assert np.abs(q[0] - theirs).max() < SAME
