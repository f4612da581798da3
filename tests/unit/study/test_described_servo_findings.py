"""Parts of a description's servos that are not used bring a finding."""

from __future__ import annotations

import numpy as np
import pytest

from armid.robot.readers import mjcf
from armid.servo.servo_run import ServoRun
from armid.study.servos.described_servo_findings import described_servo_findings

ARM = """<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="a"><joint name="pan" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <body name="b"><joint name="lift" axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
    </body>
  </worldbody>
  <actuator>{actuators}</actuator>
</mujoco>"""

PLAIN = '<position joint="pan" kp="9"/><position joint="lift" kp="7"/>'


def told(actuators: str, largest: float = 0.5) -> dict[str, str]:
    """Evidence by code, for commands between minus and plus `largest`."""
    robot = mjcf.read(ARM.format(actuators=actuators), source="arm.xml", locked={}, tip=None)
    t = np.arange(100) / 50.0
    command = largest * np.sin(np.outer(t, [3.0, 3.0]))
    run = ServoRun(0.02, 0.0, command, np.zeros(2), t, command)
    return {each.code: each.evidence for each in described_servo_findings(robot, [run])}


def test_servos_that_are_used_whole_bring_none():
    assert told(PLAIN) == {}
    assert told(PLAIN.replace('kp="9"', 'kp="9" ctrlrange="-1 1"')) == {}
    assert told(PLAIN.replace('kp="9"', 'kp="9" ctrlrange="-0.1 0.1" ctrllimited="false"')) == {}


@pytest.mark.parametrize(
    ("code", "actuators", "joint", "other"),
    [
        ("servo-damping-ratio", PLAIN.replace('kp="9"', 'kp="9" dampratio="1"'), "pan", "lift"),
        ("servo-several-actuators", PLAIN + '<motor joint="lift"/>', "lift (2)", "pan"),
        ("servo-command-range", PLAIN.replace('kp="9"', 'kp="9" ctrlrange="-0.1 0.1"'), "pan (-0.5", "lift"),
    ],
)
def test_each_part_that_is_not_used_brings_one(code, actuators, joint, other):
    found = told(actuators)
    assert list(found) == [code]
    assert joint in found[code]
    assert other not in found[code]


def test_the_first_servo_of_a_joint_counts():
    text = ARM.format(actuators=PLAIN + '<position joint="lift" kp="50"/>')
    servo = mjcf.read(text, source="arm.xml", locked={}, tip=None).joints[1].drive.servo
    assert servo is not None
    assert (servo.stiffness, servo.actuators) == (7.0, 2)
