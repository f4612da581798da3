"""A torque that was logged late is read when it was measured, and rows for which there is none do not count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.delay import compensate_delay
from armid.measurement.recording import Recording
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.identify import identify
from healing import healed
from sick import FAULTS, sound

RATE = 200.0
PERIOD = 4.0
ROUNDING = 1e-9  # of a spline of order one read at its own samples
SPLINE = 1e-4  # a cubic through fifty samples a period errs by (ω h)⁴ / 384 of the amplitude, and more at the ends


def torque(t: np.ndarray) -> np.ndarray:
    """Three joints with one period and four samples in ten of the fastest."""
    w = 2.0 * np.pi / PERIOD
    return np.column_stack([np.sin(w * t), 2.0 * np.cos(3.0 * w * t), np.sin(2.0 * w * t + 1.0) - 0.5])


def log(t: np.ndarray, late: float | np.ndarray = 0.0, **more: object) -> Recording:
    """Return what is logged at times t when each joint's torque is so late."""
    each = np.broadcast_to(late, 3)
    effort = np.column_stack([torque(t - each[j])[:, j] for j in range(3)])
    return Recording(t, np.column_stack([t, t, t]), effort=effort, consecutive=True, **more)  # pyright: ignore[reportArgumentType]


def clock(seconds: float) -> np.ndarray:
    return np.arange(round(seconds * RATE)) / RATE


@pytest.mark.parametrize("late", [0.02, -0.03, 0.0133, [0.01, 0.0, -0.0021]])
def test_the_torque_is_that_of_its_time(late: float | list[float]):
    t = clock(10.0)
    found = compensate_delay(log(t, np.array(late)), LogFormat(delay=late))
    assert found.effort is not None
    off = np.abs(found.effort - torque(t))
    assert off[found.valid].max() < (ROUNDING if np.allclose(np.multiply(late, RATE) % 1.0, 0.0) else SPLINE)
    missing = np.ceil(np.abs(np.broadcast_to(late, 3)) * RATE - ROUNDING)  # at one end, and no others
    assert ((~found.valid).sum(axis=0) == missing).all()
    assert np.isfinite(found.effort).all()


def test_without_a_delay_nothing_is_touched():
    given = log(clock(1.0))
    assert compensate_delay(given, LogFormat()) is given
    silent = replace(given, effort=None)
    assert compensate_delay(silent, LogFormat(delay=0.1)) is silent


@pytest.mark.parametrize("late", [0.0213, -0.0213])
def test_where_the_motion_repeats_no_row_is_lost(late: float):
    t = clock(3 * PERIOD)
    found = compensate_delay(log(t, late), LogFormat(delay=late, period=PERIOD))
    assert (~found.valid).sum() == 0 and found.effort is not None
    assert np.abs(found.effort - torque(t)).max() < SPLINE


def test_nothing_is_read_across_a_gap():
    t = clock(10.0)
    t = t[(t < 4.0) | (t >= 4.5)]
    given = log(t, 0.02)
    found = compensate_delay(given, LogFormat(delay=0.02))
    assert found.effort is not None
    lost = np.flatnonzero(~found.valid[:, 0])
    assert set(t[lost]) == set(t[((t > 3.9799) & (t < 4.0)) | (t > t[-1] - 0.0199)])
    assert np.abs(found.effort - torque(t))[found.valid].max() < SPLINE


def test_rows_whose_torque_does_not_count_do_not_count():
    t = clock(2.0)
    valid = np.ones((len(t), 3), dtype=bool)
    valid[100:110, 1] = False
    found = compensate_delay(log(t, 0.02, valid=valid), LogFormat(delay=0.02))
    assert not found.valid[96:110, 1].any() and found.valid[:95, 1].all() and found.valid[110:-4, 1].all()
    assert found.valid[:-4, [0, 2]].all()


@pytest.mark.parametrize("wrong", [20.0, [0.1, 2.0], "late", [[0.1]], np.nan])
def test_what_is_no_delay_is_refused(wrong: object):
    with pytest.raises(RecordingError, match="delay"):
        LogFormat(delay=wrong)  # pyright: ignore[reportArgumentType]


def test_delays_must_be_those_of_the_joints_and_of_rows_in_time():
    case = sound(4)
    with pytest.raises(RecordingError, match="`delay` has 2 entries"):
        to_robot_convention(case.recording, LogFormat(delay=[0.01, 0.02]), case.robot)
    with pytest.raises(RecordingError, match="not consecutive in time"):
        compensate_delay(replace(log(clock(1.0)), consecutive=False), LogFormat(delay=0.01))


def test_a_study_that_says_the_delay_identifies_what_a_log_in_time_does():
    case = FAULTS["channel-delay"](54)
    told, _, _ = healed(case, f"delay = {case.truth['delay']}")
    errors: list[float] = []
    for each in (sound(54), case, told):
        study = Study(
            RobotChoice(case.robot.name), ModelChoice(), (RecordingChoice("log.csv", reading=each.reading),)
        )
        found = identify(study, given={"log.csv": each.recording})
        errors.append(float(np.linalg.norm(found.estimate.fit.residual_rms)))
    assert errors[2] < 1.02 * errors[0] < 0.9 * errors[1]
