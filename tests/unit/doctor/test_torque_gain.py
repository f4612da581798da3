"""Torque of one joint in another scale: named with its factor where other joints determine it."""

from __future__ import annotations

import re
import tomllib

import numpy as np
import pytest

from armid.doctor.check_input import LogEvidence
from armid.doctor.checks.dynamics import torque_gain
from armid.errors import Finding
from armid.measurement.convention_conversion import to_robot_convention
from armid.study.diagnosis import diagnose_recording
from healing import told_after
from sick import Case, sound

UR10E, IIWA, PANDA = 4, 11, 51
"""Seeds of logs of these arms."""


def scaled(case: Case, joint: int, factor: float) -> Case:
    assert case.recording.effort is not None
    effort = case.recording.effort.copy()
    effort[:, joint] *= factor
    return case.logged(effort=effort)


def found(case: Case) -> list[Finding]:
    return [f for f in diagnose_recording(case.robot, case.recording, case.reading) if f.severity != "info"]


@pytest.mark.parametrize("factor", [1.6, 0.5])
@pytest.mark.parametrize(("seed", "joint"), [(UR10E, 1), (UR10E, 2), (PANDA, 2), (PANDA, 3)])
def test_the_joint_is_named_with_its_factor_and_the_remedy_heals(seed: int, joint: int, factor: float):
    case = scaled(sound(seed), joint, factor)
    (told,) = found(case)
    assert (told.code, told.severity, told.channel) == ("torque-gain", "warning", case.robot.joint_names[joint])
    keys = tomllib.loads(told.remedy)
    gain, deviation = np.array(keys["drive_gain"]), np.array(keys["drive_gain_deviation"])
    assert abs(gain[joint] * factor - 1.0) < deviation[joint] and (np.delete(gain, joint) == 1.0).all()
    assert told_after(case, told) == set()


@pytest.mark.parametrize("factor", [1000.0, 10.0, 0.1])
@pytest.mark.parametrize(("seed", "joint"), [(UR10E, 1), (PANDA, 2)])
def test_a_joint_in_another_unit_is_an_error(seed: int, joint: int, factor: float):
    case = scaled(sound(seed), joint, factor)
    (told,) = [each for each in found(case) if each.code == "torque-gain"]
    assert (told.severity, told.channel) == ("error", case.robot.joint_names[joint])
    gain = np.array(tomllib.loads(told.remedy)["drive_gain"])
    assert gain[joint] * factor == pytest.approx(1.0, rel=torque_gain.DEVIATION)


def test_the_other_joint_of_a_pair_is_said_where_the_log_cannot_tell_which():
    """Of two joints that agree with each other alone, one has a torque that is too large or the other too small."""
    case = scaled(sound(IIWA), 3, 1.6)
    (told,) = found(case)
    others = re.findall(r"wrong by a factor: (\S+) ([\d.]*\d)", told.evidence)
    assert told.channel == case.robot.joint_names[3]
    assert [name for name, _ in others] == [case.robot.joint_names[1]]
    assert float(others[0][1]) == pytest.approx(1.0 / 1.6, rel=torque_gain.DEVIATION)


def test_a_gain_that_other_joints_do_not_determine_is_none():
    case = scaled(sound(IIWA), 6, 1.6)  # the last joint shows hardly any inertia beside its friction
    assert found(case) == []


def test_scales_of_all_joints_together_are_no_fault_of_one():
    case = sound(UR10E)
    assert case.recording.effort is not None
    twice = case.logged(effort=1.6 * case.recording.effort)
    log = to_robot_convention(twice.recording, twice.reading, twice.robot).recording
    state = LogEvidence(twice.robot, twice.recording, twice.reading, log).state
    assert state is not None and torque_gain.explain(state) is None


def test_a_gain_that_falls_with_the_torque_is_named(joint: int = 3):
    case = sound(PANDA)
    assert case.recording.effort is not None
    effort = case.recording.effort.copy()
    own = effort[:, joint]
    effort[:, joint] = own * (1.0 - 0.5 * np.abs(own) / np.abs(own).max())
    (told,) = [each for each in found(case.logged(effort=effort)) if each.code == "torque-gain"]
    assert told.channel == case.robot.joint_names[joint] and "falls with the amount" in told.evidence
