"""Joints that are outside their limits all the time: another arm's log, and what only looks like it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.doctor.checks.signals.position_limits import always_outside
from armid.errors import Finding
from armid.measurement.log_format import LogFormat
from armid.robot import Robot, load_robot
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.diagnosis import diagnose_recording
from armid.study.identify import identify
from sick import Case, arm, sound

URDF = """<robot name="pair"><link name="base"/>{links}
<joint name="turn" type="revolute"><parent link="base"/><child link="turret"/><axis xyz="0 0 1"/>
  <limit lower="{low}" upper="{high}" velocity="2" effort="60"/></joint>
<joint name="lift" type="revolute"><parent link="turret"/><child link="boom"/><axis xyz="0 1 0"/>
  <limit lower="-1" upper="1" velocity="2" effort="60"/></joint></robot>"""
LINK = (
    '<link name="{}"><inertial><origin xyz="0.2 0 0"/><mass value="{}"/>'
    '<inertia ixx="0.02" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)


def described(folder: Path, low: float, high: float) -> Path:
    """Description of an arm whose first joint turns about the vertical, so that no torque depends on its zero."""
    path = folder / f"pair{low:g}.urdf"
    links = LINK.format("turret", 5) + LINK.format("boom", 3)
    path.write_text(URDF.format(links=links, low=low, high=high))
    return path


def of_the_other_arm(folder: Path) -> tuple[Case, Path]:
    """A log of an arm whose first joint turns to the left, and the description of the one that turns to the right."""
    case = sound(2, robot=load_robot(described(folder, 0.1, 2.5)))
    other = described(folder, -2.5, -0.1)
    return replace(case, robot=load_robot(other)), other


def with_limits(robot: Robot, limits: dict[int, tuple[float, float]]) -> Robot:
    joints = [
        replace(each, position_limits=limits.get(j, each.position_limits)) for j, each in enumerate(robot.joints)
    ]
    return replace(robot, joints=tuple(joints))


def found(case: Case) -> tuple[Finding, ...]:
    return diagnose_recording(case.robot, case.recording, case.reading)


def test_a_log_of_the_other_arm_is_an_error_and_told_once(tmp_path: Path):
    case, _ = of_the_other_arm(tmp_path)
    told = [f for f in found(case) if f.severity != "info"]
    assert [(f.code, f.severity, f.channel) for f in told] == [("position-limits", "error", "turn")]
    q = case.recording.q[:, 0]
    assert f"turn goes from {q.min():.4g} to {q.max():.4g} rad" in told[0].evidence
    assert "[-2.5, -0.1]" in told[0].evidence and "other arm of a mirrored pair" in told[0].evidence
    assert all(word in told[0].remedy for word in ("joint_offset", "position_sign", "joints", "other arm"))


def test_an_identification_from_the_log_of_the_other_arm_fails(tmp_path: Path):
    case, other = of_the_other_arm(tmp_path)
    logs = {"train.csv": case.recording, "check.csv": replace(case.recording, sha256="other")}
    choices = tuple(
        RecordingChoice(path, role, LogFormat(), part=share)
        for path, role, share in (("train.csv", "train", (0.0, 0.6)), ("check.csv", "validate", (0.6, 1.0)))
    )
    result = identify(Study(RobotChoice(str(other)), ModelChoice(), choices), given=logs)
    assert result.validation.verdict == "fail"
    assert any("position-limits" in check.name and not check.ok for check in result.validation.checks)
    errors = [f for f in result.estimate.findings if f.code in ("position-limits", "position-offset")]
    assert {f.code for f in errors} == {"position-limits"}


def test_what_torque_explains_is_not_told_a_second_time():
    """A joint with limits on one side of zero, counted in the other direction: its sign is told, and that alone."""
    case = sound(3, name="panda")
    reversed_joint = np.array([1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
    log = case.recording
    turned = case.logged(q=log.q * reversed_joint, dq=None)
    assert always_outside(case.robot, turned.recording.q)[3]
    told = [f for f in found(turned) if f.severity != "info"]
    assert [(f.code, f.channel) for f in told] == [("position-sign", case.robot.joint_names[3])]


@pytest.mark.parametrize(
    ("low", "high", "outside"),
    [
        (0.5, 1.5, True),
        (-1.5, -0.5, True),
        (-0.95, 0.95, False),  # a small overshoot
        (-0.5, 3.0, False),  # half of the motion inside
        (2.0 * np.pi - 1.5, 2.0 * np.pi + 1.5, False),  # the same angle a turn further
        (-np.inf, np.inf, False),
        (0.0, 0.0, False),  # limits that are none
    ],
)
def test_only_a_joint_that_is_never_inside_counts(low: float, high: float, outside: bool):
    robot = with_limits(arm("iiwa14-r820"), {1: (low, high)})
    q = np.zeros((1000, robot.n))
    t = np.linspace(0.0, 20.0, 1000)
    q[:, 1] = np.sin(t) if not outside else -0.1 * np.sign(low) * (1.0 + np.sin(t))
    assert always_outside(robot, q)[1] == outside
    assert not np.delete(always_outside(robot, q), 1).any()


def test_a_joint_that_rests_is_not_moving_outside():
    robot = with_limits(arm("iiwa14-r820"), {1: (0.5, 1.5)})
    assert not always_outside(robot, np.zeros((100, robot.n))).any()
