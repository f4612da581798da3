"""Torques that lack their minus sign in some rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from armid.doctor.changes.lost_signs import lost_signs
from armid.study.diagnosis import diagnose_recording
from sick import sound


def cut_off(torque: np.ndarray) -> np.ndarray:
    """Large negative numbers are wider than their field."""
    return np.where(torque < 0.5 * torque.min(), -torque, torque)


def all_but_small(torque: np.ndarray) -> np.ndarray:
    """Only numbers of one digit keep their sign."""
    return np.where(torque < 0.3 * torque.min(), -torque, torque)


def positive(torque: np.ndarray) -> np.ndarray:
    """Large positive numbers get a sign, as after an overflow of a signed field."""
    return np.where(torque > 0.6 * torque.max(), -torque, torque)


@pytest.mark.parametrize("lost", [cut_off, all_but_small, positive])
@pytest.mark.parametrize("name", ["ur10e", "iiwa14-r820"])
def test_a_sign_that_is_lost_in_some_rows_is_named(lost: Callable[[np.ndarray], np.ndarray], name: str):
    case = sound(11, name=name)
    effort = case.recording.effort
    assert effort is not None
    j = int(np.argmax(np.minimum(effort.max(axis=0), -effort.min(axis=0))))
    changed = effort.copy()
    changed[:, j] = lost(effort[:, j])
    case = case.logged(effort=changed)
    (found,) = (f for f in diagnose_recording(case.robot, case.recording, case.reading) if f.code == "torque-sign")
    assert (found.severity, found.channel) == ("error", case.robot.joint_names[j])
    assert "sign is missing" in found.evidence and "minus sign" in found.remedy


@pytest.mark.parametrize("seed", range(1, 9))
def test_sound_logs_and_friction_at_reversals_are_told_nothing(seed: int):
    assert lost_signs(sound(seed).recording) == []


def test_a_jump_that_is_no_change_of_sign_is_told_nothing():
    log = sound(11, name="ur10e").recording
    assert log.effort is not None
    shifted = log.effort.copy()
    shifted[len(shifted) // 2 :, 1] += 3.0 * shifted[:, 1].std()
    assert lost_signs(replace(log, effort=shifted)) == []
