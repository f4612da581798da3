"""The check of delays on logs of coarse encoders."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from armid.doctor.held_torque import update_interval
from armid.errors import Finding
from armid.excitation.fourier import Excitation
from armid.lab.known_arms import truth_of
from armid.lab.options import LabOptions
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulation import simulate
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot import Robot, load_robot
from armid.study.config import ModelChoice, RecordingChoice, build_model
from armid.study.diagnosis import diagnose_recording, run_checks

STEP = 2.0 * np.pi / 4096
"""Step of a usual encoder of small servos [rad]."""


def coarse_log(robot: Robot, rate: float, late: float) -> Recording:
    """Log of an encoder with 4096 counts and noise, whose torque is late by some milliseconds."""
    a, b = 0.15 * np.random.default_rng(3).normal(size=(2, robot.n, 5))
    position = SensorChannel(noise=2e-4, resolution=STEP, delay=1e-3 * max(-late, 0.0))
    effort = SensorChannel(noise=0.1, delay=1e-3 * max(late, 0.0))
    options = LabOptions(mode="inverse-dynamics", repetitions=2, sensing=Sensing(rate, position, effort))
    return simulate(truth_of(robot), Excitation(2 * np.pi / 10.0, a, b, np.zeros(robot.n)), options, seed=1).recording


def held_log(robot: Robot, rate: float) -> Recording:
    """Log whose torque leads by half a sample, as one that a controller holds until its next sample."""
    a, b = 0.15 * np.random.default_rng(3).normal(size=(2, robot.n, 5))
    late = SensorChannel(noise=1e-5, delay=0.5 / rate)
    sensing = Sensing(rate, late, SensorChannel(noise=0.05), replace(late, noise=1e-3))
    options = LabOptions(mode="inverse-dynamics", repetitions=2, sensing=sensing)
    return simulate(truth_of(robot), Excitation(2 * np.pi / 10.0, a, b, np.zeros(robot.n)), options, seed=1).recording


def delays(found: tuple[Finding, ...]) -> list[tuple[float, float]]:
    """Delay of the remedy of each finding, and its standard deviation [ms]."""
    told = [f for f in found if f.code == "channel-delay"]
    values = [float(re.findall(r"delay = (-?[\d.]+)", f.remedy)[0]) for f in told]
    deviations = [float(re.findall(r"± ([\d.]+) ms", f.evidence)[0]) for f in told]
    return [(1e3 * value, deviation) for value, deviation in zip(values, deviations, strict=True)]


@pytest.mark.parametrize(
    ("name", "rate", "late"),
    [("ur5e", 125.0, 20), ("ur5e", 250.0, -20), ("panda", 250.0, 20), ("ur5e", 500.0, 40), ("ur5e", 500.0, 8)],
)
def test_noise_of_positions_hides_no_delay(name: str, rate: float, late: int):
    """At 15 Hz, the noise of these positions is a quarter of the accelerations; at the motion's band a fiftieth."""
    robot = load_robot(name)
    ((value, deviation),) = delays(diagnose_recording(robot, coarse_log(robot, rate, late), LogFormat()))
    assert abs(value - late) < 3.0 * deviation + 0.1  # three deviations, and 0.1 ms of bias by the noise
    assert deviation < 2.0  # a tenth of 20 ms


@pytest.mark.parametrize(("name", "rate"), [("ur5e", 500.0), ("panda", 500.0), ("panda", 250.0)])
def test_a_torque_that_is_held_is_a_warning_that_names_the_cause(name: str, rate: float):
    robot = load_robot(name)
    found = diagnose_recording(robot, held_log(robot, rate), LogFormat())
    ((value, deviation),) = delays(found)
    (told,) = [f for f in found if f.code == "channel-delay"]
    assert abs(value + 500.0 / rate) < 3.0 * deviation + 0.1  # as above
    assert "holds until its next sample" in told.evidence
    assert told.severity == ("warning" if rate == 500.0 else "error")


@pytest.mark.parametrize(("rows", "late"), [(10, 0), (4, 12)])
def test_a_torque_that_the_log_repeats_is_named_as_the_cause_of_the_delay(rows: int, late: int):
    """The log has a new torque once in some rows, late by half of the other rows on average, and perhaps more."""
    robot, rate = load_robot("ur5e"), 500.0
    log = coarse_log(robot, rate, late)
    assert log.effort is not None
    last = np.arange(log.samples) // rows * rows
    found = diagnose_recording(robot, replace(log, effort=log.effort[last]), LogFormat())
    (told,) = [f for f in found if f.code == "channel-delay"]
    ((value, deviation),) = delays(found)
    assert abs(value - late - 500.0 * (rows - 1) / rate) < 3.0 * deviation + 0.1  # as above
    assert f"changes only once in {rows} rows" in told.evidence
    assert "keep only the rows with a new torque" in told.remedy
    assert ("explains the delay" in told.evidence) == (late == 0)


def test_steps_of_a_coarse_sensor_are_no_repeated_torque():
    """A slow torque keeps the value of its step for many rows, at irregular times."""
    t = np.arange(20000) / 500.0
    torque = 5.0 * np.sin(2.0 * np.pi * np.array([0.1, 0.23, 0.31]) * t[:, None]) + 0.01 * np.sin(40.0 * t)[:, None]
    assert update_interval(np.round(torque, 1)) == 1
    assert update_interval(np.round(torque, 1)[np.arange(len(t)) // 5 * 5]) == 5


def test_coarse_encoders_are_no_delay():
    robot = load_robot("ur5e")
    assert not delays(diagnose_recording(robot, coarse_log(robot, 250.0, 0), LogFormat()))


def test_the_remedy_of_a_delay_heals_it_and_an_identification_tells_it():
    robot = load_robot("ur5e")
    log = coarse_log(robot, 250.0, 20)
    ((value, _),) = delays(diagnose_recording(robot, log, LogFormat()))
    healed = LogFormat(delay=1e-3 * value)
    assert not delays(diagnose_recording(robot, log, healed))

    def told(reading: LogFormat) -> set[str]:
        choice = RecordingChoice("log.csv", reading=reading)
        read = to_robot_convention(log, reading, robot).recording
        return {finding.code for _, finding in run_checks(build_model(robot, ModelChoice()), [(choice, read)])}

    assert "channel-delay" in told(LogFormat())
    assert "channel-delay" not in told(healed)
