"""Efforts that are no torques: amounts without a sign, and torques without weight."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from armid import kernel
from armid.excitation.fourier import Excitation
from armid.lab.known_arms import truth_of
from armid.lab.options import Arm, LabOptions
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulation import Simulated, simulate
from armid.measurement.log_format import LogFormat
from armid.robot import load_robot
from armid.study.diagnosis import diagnose_recording

ARMS = ("ur5e", "iiwa14-r820")


@cache
def simulated(name: str, seed: int) -> Simulated:
    robot = load_robot(name)
    a, b = 0.2 * np.random.default_rng(seed).normal(size=(2, robot.n, 5))
    plan = Excitation(2 * np.pi / 20.0, a, b, np.full(robot.n, 0.4))
    options = LabOptions(
        "inverse-dynamics", arm=Arm(effects=("rotor",)), sensing=Sensing(200.0, effort=SensorChannel(noise=0.2))
    )
    return simulate(truth_of(robot), plan, options, seed=seed)


def codes(name: str, recording) -> set[str]:
    found = diagnose_recording(load_robot(name), recording, LogFormat())
    return {each.code for each in found if each.severity == "error"}


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_sound_log_is_told_neither(name, seed):
    assert codes(name, simulated(name, seed).recording) == set()


@pytest.mark.parametrize("name", ARMS)
def test_amounts_are_told(name):
    recording = simulated(name, 1).recording
    assert codes(name, replace(recording, effort=np.abs(recording.effort))) == {"effort-unsigned"}


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_controller_that_subtracts_its_model_of_gravity(name, seed):
    done = simulated(name, seed)
    weight = kernel.gravity_torque(done.truth.robot.tree, done.truth.inertial, done.recording.q)
    assert codes(name, replace(done.recording, effort=done.recording.effort - weight)) == {"effort-without-gravity"}


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 9.81), (9.81, 0.0, 0.0)])
def test_another_direction_of_gravity_is_not_taken_for_none(gravity):
    """The arm hangs or lies on its side, and the description does not say so."""
    robot = load_robot("ur5e", gravity=gravity)
    options = LabOptions("inverse-dynamics", sensing=Sensing(200.0, effort=SensorChannel(noise=0.2)))
    done = simulate(truth_of(robot), simulated("ur5e", 1).plan, options)
    assert "gravity-direction" in codes("ur5e", done.recording)
