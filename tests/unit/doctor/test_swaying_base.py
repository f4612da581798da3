"""A base that sways is named with its frequency and its amplitude, by logs that feel it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.model.dynamics_model import DynamicsModel
from armid.study.diagnosis import diagnose_recording
from sick import Case, sound

CODE = "gravity-direction"

TOLERANCE = 0.3
"""Relative error of the amplitude: the links are fitted to the torque with the sway, which they explain in part."""


def swayed(case: Case, wave: np.ndarray) -> Case:
    """The log of an arm whose base has an acceleration, shape (N, 3) [m/s²]."""
    effort, gravity = case.recording.effort, np.asarray(case.model.robot.gravity)
    assert effort is not None
    usual, changed = case.model.torque(case.motion, case.theta), effort.copy()
    for axis in range(3):
        other = DynamicsModel(case.model.robot.with_gravity(tuple(gravity + np.eye(3)[axis])), case.model.terms)
        changed = changed + wave[:, axis, None] * (other.torque(case.motion, case.theta) - usual)
    return case.logged(effort=changed)


@pytest.mark.parametrize(
    ("name", "frequency", "size"),
    [("ur10e", 0.5, (1.0, 0.0, 0.0)), ("ur10e", 1.3, (0.0, 0.0, 1.5)), ("iiwa14-r820", 0.9, (0.6, 0.9, 0.0))],
)
def test_a_base_that_sways_is_named(name: str, frequency: float, size: tuple[float, float, float]):
    case = sound(11, name=name)
    time = case.motion.time
    phase = 2.0 * np.pi * frequency * time
    case = swayed(case, np.outer(np.sin(phase + 0.3), size))
    (found,) = (f for f in diagnose_recording(case.robot, case.recording, case.reading) if f.severity == "error")
    assert found.code == CODE and "sways" in found.evidence
    assert float(found.evidence.split(" at ")[1].split(" Hz")[0]) == pytest.approx(frequency, abs=0.03)
    listed = [float(x) for x in found.evidence.split("amplitude of (")[1].split(")")[0].split(",")]
    assert np.linalg.norm(listed) == pytest.approx(np.linalg.norm(size), rel=TOLERANCE)


def test_the_memory_of_the_search_does_not_grow_with_a_step_of_the_clock():
    """Two files of which one was made a year later: a grid over the time between them would need some 20 GB."""
    case = sound(11, name="ur10e")
    time = case.motion.time
    case = swayed(case, np.outer(np.sin(2.0 * np.pi * 0.5 * time), (1.5, 0.0, 0.0)))
    assert case.recording.time is not None
    later = np.where(time > 0.7 * time[-1], 3.15e7, 0.0)
    log = replace(case.recording, time=case.recording.time + later)
    assert "clock-gap" in {f.code for f in diagnose_recording(case.robot, log, case.reading)}


def test_a_base_that_stops_swaying_is_named():
    case = sound(11, name="ur10e")
    time = case.motion.time
    wave = np.outer(1.5 * np.sin(2.0 * np.pi * 0.8 * time) * (time < 0.7 * time[-1]), (0.0, 1.0, 0.0))
    case = swayed(case, wave)
    assert CODE in {f.code for f in diagnose_recording(case.robot, case.recording, case.reading)}
