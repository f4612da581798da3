"""Effort that is a small share of the described torque: motor torque, current, or another unit."""

from __future__ import annotations

import tomllib
from dataclasses import replace

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


@pytest.mark.parametrize("seed", DESCRIBED)
def test_gains_that_are_declared_unknown_are_no_error(seed: int):
    """The deviation allows for the true gain at 10, not at 0.3: there, statement and description disagree."""
    case = divided(seed, 12.0)

    def severities(**reading: float) -> set[str]:
        stated = replace(case, reading=replace(case.reading, **reading))
        found = diagnose_recording(stated.robot, stated.recording, stated.reading)
        return {f.severity for f in found if f.code == "current-without-gain"}

    assert severities(drive_gain=1.0, drive_gain_deviation=10.0) == {"warning"}
    assert severities(drive_gain=1.0, drive_gain_deviation=0.3) == {"error"}
    assert severities(drive_gain=1.0) == severities() == {"error"}


@pytest.mark.parametrize("seed", DESCRIBED)
def test_proposed_gains_agree_with_their_own_deviation(seed: int):
    case = divided(seed, 12.0)
    (told,) = errors(case)
    assert "relative deviations" in told.remedy and "give the same gains to all recordings" in told.remedy
    assert not errors(replace(case, reading=replace(case.reading, **tomllib.loads(told.remedy))))
