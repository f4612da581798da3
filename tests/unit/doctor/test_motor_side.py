"""Effort that is a small share of the described torque: motor torque, current, or another unit."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from armid.errors import Finding
from armid.study.diagnosis import diagnose_recording
from healing import told_after
from sick import Case, sound

DESCRIBED = (4, 1, 2)
"""Seeds of logs of arms whose description has inertias."""

KNOWN = 4.0
"""Number of stated deviations within which gains are estimated from the description."""


def divided(seed: int, ratio: float) -> Case:
    """A log whose effort is the torque divided by one number for all joints."""
    case = sound(seed)
    assert case.recording.effort is not None
    return case.logged(effort=case.recording.effort / ratio)


def errors(case: Case) -> list[Finding]:
    return [f for f in diagnose_recording(case.robot, case.recording, case.reading) if f.severity == "error"]


@pytest.mark.parametrize("seed", DESCRIBED)
@pytest.mark.parametrize("ratio", [10.0, 100.0, 250.0])
def test_a_share_that_is_equal_for_all_joints_is_named(seed: int, ratio: float):
    """Single factors from an inexact description make the joints disagree more; that is no reason to pass."""
    (told,) = errors(divided(seed, ratio))
    assert told.code in ("motor-side", "current-without-gain") and told.channel == "effort"
    keys = tomllib.loads(told.remedy)
    gain, deviation = np.array(keys["drive_gain"]), np.array(keys["drive_gain_deviation"])
    assert (np.abs(np.log(gain / ratio)) < KNOWN * deviation).all()
    assert not told_after(divided(seed, ratio), told) & {"motor-side", "current-without-gain", "torque-unit"}


@pytest.mark.parametrize("seed", DESCRIBED)
def test_kilonewton_metres_are_named(seed: int):
    (told,) = errors(divided(seed, 1000.0))
    assert told.code == "torque-unit" and "kN·m" in told.evidence
    assert tomllib.loads(told.remedy)["drive_gain"] == [1000.0] * len(tomllib.loads(told.remedy)["drive_gain"])


def test_a_tiny_share_of_no_unit_is_named():
    (told,) = errors(divided(DESCRIBED[0], 1e6))
    assert told.code == "torque-unit" and "no usual unit" in told.evidence
