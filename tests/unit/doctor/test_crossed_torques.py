"""Torques that contain a share of another torque, or are late alone: named with their numbers, and healed."""

from __future__ import annotations

import re

import numpy as np
import pytest

from armid.errors import Finding
from armid.study.diagnosis import diagnose_recording
from healing import told_after
from sick import Case, sound

UR10E, PANDA, UR5E = 4, 51, 12
"""Seeds of logs of these arms."""

DEVIATIONS = 4.0
"""Standard deviations by which a share may be off, plus half of its last digit."""


def told(case: Case) -> list[Finding]:
    return [f for f in diagnose_recording(case.robot, case.recording, case.reading) if f.severity != "info"]


def torques(case: Case) -> np.ndarray:
    assert case.recording.effort is not None
    return case.recording.effort.copy()


@pytest.mark.parametrize(("seed", "joint", "other"), [(UR10E, 2, 1), (PANDA, 2, 1), (UR5E, 3, 1)])
@pytest.mark.parametrize("share", [0.4, 1.0])
def test_the_share_of_another_torque_is_named(seed: int, joint: int, other: int, share: float):
    case = sound(seed)
    effort = torques(case)
    effort[:, joint] += share * effort[:, other]
    names = case.robot.joint_names
    found = [f for f in told(case.logged(effort=effort)) if f.code == "cross-talk"]
    assert [(f.severity, f.channel) for f in found] == [("error", names[joint])]
    value, deviation, which = re.findall(
        r"contains (-?[\d.]+) ± ([\d.]+) times the torque of (\S+)\.", found[0].evidence
    )[0]
    assert which == names[other]
    assert abs(float(value) - share) < DEVIATIONS * float(deviation) + 0.01


def test_subtracting_what_the_remedy_says_heals():
    case = sound(UR10E)
    effort = torques(case)
    effort[:, 2] += 0.4 * effort[:, 1]
    (found,) = [f for f in told(case.logged(effort=effort)) if f.code == "cross-talk"]
    share, other, own = re.findall(r"subtract ([\d.]+) times the torque of (\S+) from that of (\S+)$", found.remedy)[
        0
    ]
    names = case.robot.joint_names
    effort[:, names.index(own)] -= float(share) * effort[:, names.index(other)]
    assert told(case.logged(effort=effort)) == []


def test_one_torque_that_is_logged_twice_is_named_with_both_joints():
    case = sound(UR10E)
    effort = torques(case)
    effort[:, 3] = 2.0 * effort[:, 1]
    found = [f for f in told(case.logged(effort=effort)) if f.code == "cross-talk"]
    names = case.robot.joint_names
    assert [f.channel for f in found] == [f"{names[1]}, {names[3]}"]
    assert f"{names[3]} is 2 times that of {names[1]}" in found[0].evidence


@pytest.mark.parametrize(("seed", "joint"), [(UR10E, 1), (UR10E, 2), (PANDA, 1)])
@pytest.mark.parametrize("seconds", [0.1, -0.1])
def test_a_torque_that_is_late_alone_is_named_and_the_remedy_heals(seed: int, joint: int, seconds: float):
    case = sound(seed)
    effort, time = torques(case), case.motion.time
    effort[:, joint] = np.interp(time - seconds, time, effort[:, joint])
    late = case.logged(effort=effort)
    found = [f for f in told(late) if f.code == "joint-delay"]
    assert [(f.severity, f.channel) for f in found] == [("error", case.robot.joint_names[joint])]
    word, value, deviation = re.findall(r"The torque of \S+ is (late|early) by (\d+) ± (\d+) ms", found[0].evidence)[
        0
    ]
    assert word == ("late" if seconds > 0.0 else "early")
    assert abs(float(value) - 1e3 * abs(seconds)) < DEVIATIONS * float(deviation) + 5.0  # an edge is repeated: 5 ms
    assert "joint-delay" not in told_after(late, found[0])
