"""Scale of time from gravity and inertia of the same links."""

from __future__ import annotations

from dataclasses import replace

import pytest

from armid.errors import Finding
from armid.study.diagnosis import diagnose_recording
from healing import told_after
from sick import Case, sound

SEEDS = (0, 4, 8)
"""Logs of arms whose description has inertias, at 100 to 1000 Hz."""

FOUND = 0.02
"""Relative error of the rate: friction that the model lacks shifts it by less than a hundredth on these logs."""


def slowed(seed: int, factor: float) -> Case:
    """A log without velocities whose rows seem some times as far apart in time as they are."""
    case = sound(seed)
    assert case.recording.time is not None
    return case.logged(time=case.recording.time * factor, dq=None, ddq=None)


def found(case: Case) -> list[Finding]:
    told = diagnose_recording(case.robot, case.recording, case.reading)
    return [each for each in told if each.code == "time-scale"]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_wrong_rate_is_named_and_the_remedy_heals(seed: int, factor: float):
    case = slowed(seed, factor)
    (told,) = found(case)
    assert told.severity == "error"
    unit = float(told.remedy.split("=")[1].split("#")[0])
    assert unit * factor == pytest.approx(1.0, rel=FOUND)
    assert "time-scale" not in told_after(case, told)


def test_the_remedy_of_a_log_without_clock_is_its_rate():
    case = sound(SEEDS[0])
    time = case.recording.time
    assert time is not None
    rate = 1.0 / float(time[1] - time[0])
    case = replace(case.logged(time=None, dq=None, ddq=None), reading=replace(case.reading, rate=2.0 * rate))
    (told,) = found(case)
    given = told.remedy.split("=")[1].split("#")[0]
    assert told.remedy.startswith("rate =") and float(given) == pytest.approx(rate, rel=FOUND)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("factor", [0.95, 1.0, 1.05])
def test_a_clock_that_is_nearly_right_is_not_named(seed: int, factor: float):
    assert found(slowed(seed, factor)) == []
