"""Zeros of joints on logs whose friction at reversals is much of what the model does not explain."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from armid.doctor.check_input import LogEvidence
from armid.doctor.checks.dynamics import position_offset
from armid.excitation.fourier import Excitation
from armid.lab.known_arms import truth_of
from armid.lab.options import Arm, LabOptions
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulation import simulate
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot import load_robot
from armid.study.diagnosis import diagnose_recording

ARM, PERIOD, RATE = "ur10e", 20.0, 500.0
"""The joints stick at their reversals in this slow motion."""


@cache
def log(seed: int) -> Recording:
    """A log in closed loop, with Stribeck friction."""
    a, b = 0.25 * np.random.default_rng(seed).normal(size=(2, 6, 5))
    sensing = Sensing(rate=RATE, effort=SensorChannel(noise=0.3))
    plan = Excitation(2 * np.pi / PERIOD, a, b, np.zeros(6))
    return simulate(
        truth_of(load_robot(ARM)), plan, LabOptions(arm=Arm(effects=("stribeck",)), sensing=sensing), seed=1
    ).recording


def shifted(seed: int, joint: int, offset: float) -> Recording:
    recording = log(seed)
    q = recording.q.copy()
    q[:, joint] += offset
    return Recording(recording.time, q, effort=recording.effort)


@pytest.mark.parametrize("seed", [3, 4])
@pytest.mark.parametrize(("joint", "offset"), [(2, 0.25), (3, 0.25), (3, -0.25)])
def test_stiction_at_reversals_does_not_hide_the_zero_of_a_light_joint(
    seed: int, joint: int, offset: float, monkeypatch: pytest.MonkeyPatch
):
    robot = load_robot(ARM)
    raw = shifted(seed, joint, offset)
    (found,) = [f for f in diagnose_recording(robot, raw, LogFormat()) if f.severity == "error"]
    assert (found.code, found.channel) == ("position-offset", robot.joint_names[joint])
    state = LogEvidence(robot, raw, LogFormat(), to_robot_convention(raw, LogFormat(), robot).recording).state
    assert state is not None
    told, deviation, _ = position_offset.offsets_of(position_offset.away_from_reversals(state))
    assert abs(told[joint] + offset) < 3.0 * deviation[joint]
    monkeypatch.setattr(position_offset, "away_from_reversals", lambda state: state)  # all rows alone
    assert position_offset.explain(state) is None


@pytest.mark.parametrize("seed", [3, 4])
def test_stiction_at_reversals_is_no_wrong_zero(seed: int):
    assert not [f for f in diagnose_recording(load_robot(ARM), log(seed), LogFormat()) if f.severity != "info"]
