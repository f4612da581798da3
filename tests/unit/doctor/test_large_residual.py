"""Joints whose residual is larger than models of sound arms leave are told, with what the residual follows."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from armid.checked_array import Array
from armid.maths.signals.zero_phase_filters import butterworth, zero_phase
from armid.study.diagnosis import diagnose_recording
from sick import Case, sound

UR10E = 4
"""Seed of a log of this arm."""

JOINT, OTHER, TURNING = 1, 2, 0
"""The joint whose torque is changed, another one, and one whose torque changes its sign all the time."""

SIZE = 0.6
"""Size of the added torque, in standard deviations of the torque of the joint."""


def with_torque(torque: Callable[[Case], Array], size: float = SIZE) -> Case:
    """The log with a further torque (N,) of one joint."""
    case = sound(UR10E)
    assert case.recording.effort is not None
    effort, added = case.recording.effort.copy(), torque(case)
    effort[:, JOINT] += size * effort[:, JOINT].std() * added / added.std()
    return case.logged(effort=effort)


def told(case: Case) -> list[tuple[str, str, str]]:
    """Codes, channels and severities of all warnings and errors."""
    found = diagnose_recording(case.robot, case.recording, case.reading)
    return [(f.code, f.channel, f.severity) for f in found if f.severity != "info"]


def wandering(case: Case) -> Array:
    """Torque that wanders below 1 Hz and follows nothing in the log."""
    rate = 1.0 / float(np.median(np.diff(case.motion.time)))
    noise = np.random.default_rng(2).standard_normal((case.motion.samples, 1))
    return zero_phase(butterworth(2, 1.0, rate), noise)[:, 0]


def test_a_torque_that_follows_nothing_is_told():
    case = with_torque(wandering)
    assert ("residual-large", case.robot.joint_names[JOINT], "warning") in told(case)


def test_a_sensor_that_reads_the_torque_of_another_joint_with_its_angle_is_named():
    case = with_torque(lambda each: each.torque[:, OTHER] * np.sin(each.motion.q[:, JOINT] + 0.5))
    assert ("cross-talk", case.robot.joint_names[JOINT]) in {each[:2] for each in told(case)}


@pytest.mark.parametrize("seed", [3, 4, 11])
def test_a_sound_log_has_no_large_residual(seed: int):
    assert "residual-large" not in {code for code, *_ in told(sound(seed))}


def test_white_noise_is_no_large_residual():
    noise = np.random.default_rng(3)
    case = with_torque(lambda each: noise.standard_normal(each.motion.samples), 2.0)
    assert "residual-large" not in {code for code, *_ in told(case)}


def test_friction_that_grows_with_the_torque_of_another_joint_is_named():
    case = with_torque(lambda each: np.tanh(each.motion.dq[:, JOINT] / 0.02) * np.abs(each.torque[:, TURNING]), 1.5)
    assert ("friction-missing", case.robot.joint_names[JOINT]) in {each[:2] for each in told(case)}


def test_a_torque_that_follows_the_angle_of_another_joint_is_named():
    case = with_torque(lambda each: np.sin(2.0 * each.motion.q[:, OTHER] + 0.5))
    assert ("residual-by-angle", case.robot.joint_names[JOINT]) in {each[:2] for each in told(case)}
