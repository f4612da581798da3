"""The check of positions of one joint that are late."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from armid.doctor.checks.dynamics.joint_delay import behind_velocities
from armid.errors import Finding
from armid.excitation.fourier import Excitation
from armid.lab.known_arms import truth_of
from armid.lab.options import LabOptions
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulation import simulate
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot import load_robot
from armid.study.diagnosis import diagnose_recording
from sick import Case, sound


def late(case: Case, joint: int, seconds: float) -> tuple[Case, float]:
    """The log with a position and its velocity late by some seconds, and the delay in whole samples [ms]."""
    log, step = case.recording, float(case.motion.time[1])
    samples = round(seconds / step)
    q, dq = log.q.copy(), None if log.dq is None else log.dq.copy()
    for values in (q, dq):
        if values is not None:
            values[:, joint] = np.roll(values[:, joint], samples)
    return case.logged(q=q, dq=dq), 1e3 * samples * step


def told(case: Case) -> list[Finding]:
    return [f for f in diagnose_recording(case.robot, case.recording, case.reading) if f.code == "joint-delay"]


@pytest.mark.parametrize(("seed", "joint"), [(4, 1), (12, 2), (51, 1)])
@pytest.mark.parametrize("seconds", [0.06, -0.06])
def test_the_joint_is_named_with_its_delay(seed: int, joint: int, seconds: float):
    case, delay = late(sound(seed), joint, seconds)
    (found,) = told(case)
    assert (found.severity, found.channel) == ("error", case.robot.joint_names[joint])
    word, value, deviation = re.findall(r"are (late|early) by (\d+) ± ([\d.]+) ms", found.evidence)[0]
    assert word == ("late" if seconds > 0.0 else "early")
    assert (
        abs(float(value) - abs(delay)) < 4.0 * float(deviation) + 0.5
    )  # four deviations, and half of the last digit
    assert found.remedy.startswith("rewrite the log") and case.robot.joint_names[joint] in found.remedy


def test_torque_that_is_late_is_no_late_position():
    """All positions are early then, which is the delay of the torque."""
    case = sound(4)
    log = case.recording
    assert log.effort is not None
    everything: Recording = replace(log, effort=np.roll(log.effort, round(0.03 / float(case.motion.time[1])), axis=0))
    found = diagnose_recording(case.robot, everything, case.reading)
    assert {f.code for f in found if f.severity == "error"} == {"channel-delay"}


RATE = 500.0

LATE = [
    *[("ur5e", joint, milliseconds) for joint in (0, 1, 2) for milliseconds in (12, 20, -30)],
    ("ur5e", 3, 20),
    ("iiwa14-r820", 0, 12),
    ("iiwa14-r820", 1, 12),
    ("iiwa14-r820", 2, 20),
    ("iiwa14-r820", 3, -20),
]
"""Arm, joint and delay [ms]; joints 0 turn about the vertical and carry no weight."""


@cache
def precise_log(name: str) -> Recording:
    """Log of an arm with good sensors, whose friction the model contains."""
    robot = load_robot(name)
    a, b = 0.25 * np.random.default_rng(3).normal(size=(2, robot.n, 5))
    sensing = Sensing(RATE, SensorChannel(noise=1e-5), SensorChannel(noise=0.05), SensorChannel(noise=1e-4))
    options = LabOptions(mode="inverse-dynamics", repetitions=2, sensing=sensing)
    return simulate(truth_of(robot), Excitation(2 * np.pi / 10.0, a, b, np.zeros(robot.n)), options, seed=1).recording


def moved(log: Recording, joints: Sequence[int], milliseconds: float, *channels: str) -> Recording:
    """The log with channels of some joints late."""
    samples = round(1e-3 * milliseconds * RATE)

    def changed(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        x = values.copy()
        x[:, list(joints)] = np.roll(x[:, list(joints)], samples, axis=0)
        return x

    return replace(log, **{channel: changed(getattr(log, channel)) for channel in channels})


def faults(name: str, log: Recording) -> list[Finding]:
    return [f for f in diagnose_recording(load_robot(name), log, LogFormat()) if f.severity != "info"]


@pytest.mark.parametrize(("name", "joint", "milliseconds"), LATE)
def test_short_delays_are_of_this_joint_and_not_of_all_torques(name: str, joint: int, milliseconds: int):
    log = moved(precise_log(name), [joint], milliseconds, "q", "dq")
    (found,) = faults(name, log)
    assert (found.code, found.severity, found.channel) == (
        "joint-delay",
        "error",
        load_robot(name).joint_names[joint],
    )
    word, value, deviation = re.findall(r"are (late|early) by (\d+) ± ([\d.]+) ms", found.evidence)[0]
    assert word == ("late" if milliseconds > 0 else "early")
    assert abs(float(value) - abs(milliseconds)) < 3.0 * float(deviation) + 0.5  # three deviations and half a digit


def test_the_remedy_names_the_channels_that_are_late():
    """Only positions are moved where the velocities are in time."""
    log, name = precise_log("ur5e"), "ur5e"
    assert not faults(name, log)
    (both,) = faults(name, moved(log, [2], 20, "q", "dq"))
    assert both.remedy == "rewrite the log with the positions and velocities of elbow_joint 0.020 s earlier"
    (alone,) = faults(name, moved(log, [2], 20, "q"))
    assert alone.remedy == "rewrite the log with the positions of elbow_joint 0.020 s earlier"


@pytest.mark.parametrize("late", [0, 1, 3])
@pytest.mark.parametrize("rate", [50.0, 100.0, 500.0])
def test_the_delay_of_positions_behind_velocities_has_no_bias_by_rate_or_gaps(rate: float, late: int):
    time = np.arange(0.0, 30.0, 1.0 / rate)
    q = np.column_stack([np.sin(1.3 * (time - late / rate)) + 0.4 * np.sin(3.1 * (time - late / rate))])
    dq = np.column_stack([1.3 * np.cos(1.3 * time) + 1.24 * np.cos(3.1 * time)])
    dq[int(5 * rate) : int(6 * rate)] = np.nan
    there = (time < 12.0) | (time > 13.0)
    log = Recording(time[there], q[there], dq[there])
    assert abs(behind_velocities(log, 0, rate) - late / rate) < 0.05 / rate  # a twentieth of a sample


@pytest.mark.parametrize("name", ["ur5e", "iiwa14-r820"])
@pytest.mark.parametrize("milliseconds", [-20, 8])
def test_torques_that_are_all_late_are_no_late_joint(name: str, milliseconds: int):
    log = precise_log(name)
    found = faults(name, moved(log, range(log.q.shape[1]), milliseconds, "effort"))
    assert [f.code for f in found] == ["channel-delay"]
    assert "contradict" not in found[0].evidence and found[0].remedy.endswith("# s")


def test_a_delay_of_all_torques_that_some_torques_contradict_is_doubtful():
    """Three positions are late; the torques of joints beside them are not early."""
    found = faults("iiwa14-r820", moved(precise_log("iiwa14-r820"), [0, 1, 2], 20, "q", "dq"))
    (common,) = (f for f in found if f.code == "channel-delay")
    assert re.search(r"contradict this delay \(lag of .*A5 -?[0-2]\.\d ms", common.evidence)
    assert common.remedy.endswith("# s, if the positions of no single joint are late")


def test_of_two_late_positions_the_one_with_more_effect_is_named():
    (found,) = faults("iiwa14-r820", moved(precise_log("iiwa14-r820"), [0, 1], 20, "q", "dq"))
    assert (found.code, found.channel) == ("joint-delay", "A2")
    assert re.search(r"late by (19|20|21) ± ", found.evidence)
