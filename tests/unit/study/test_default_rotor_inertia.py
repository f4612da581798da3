"""Rotor inertia in the default model: taken where training recordings show it, and only there."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from armid.checked_array import Array
from armid.doctor.check_input import LogEvidence
from armid.doctor.checks.dynamics import rotor_inertia_missing
from armid.lab.inverse_dynamics_recording import record
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RotorInertia
from armid.robot import Robot
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.diagnosis import diagnose
from armid.study.identify import Result, identify
from labs import SENSORS, small_model, small_plan, small_truth, write_arm

ROTORS = (0.3, 0.3, 0.1)
"""Rotor inertias of the small arm's drives [kg·m²]."""

SLOWER, LATE = 3.0, 0.08
"""Factor by which the motion is slower, and time by which friction reverses after the velocity [s]."""

COVERED = 0.85
"""Least share of 95 % intervals that hold the truth: of 25 parameters, one draw in fifty has fewer inside."""


def model_with_rotors() -> DynamicsModel:
    return DynamicsModel(small_model().robot, (*small_model().terms, RotorInertia()))


def truth_with_rotors(sizes: tuple[float, ...] = ROTORS) -> Array:
    return np.concatenate([small_truth(), sizes])


@cache
def log(seed: int, rotors: tuple[float, ...] = ROTORS, slower: float = 1.0) -> Recording:
    rng = np.random.default_rng(1000 + seed)
    fast = small_plan(seed)
    plan = replace(fast, base_frequency=fast.base_frequency / slower, a=fast.a / slower, b=fast.b / slower)
    return record(model_with_rotors(), truth_with_rotors(rotors), plan, SENSORS, rng, repetitions=2)[0]


def identified(folder: Path, recordings: dict[str, Recording], *terms: str) -> Result:
    roles = {"train": "train", "test": "validate"}
    choices = tuple(RecordingChoice(name, roles[name]) for name in recordings)  # pyright: ignore[reportArgumentType]
    study = Study(RobotChoice(str(write_arm(folder))), ModelChoice(terms), choices)
    return identify(study, given=recordings)


def codes(found: Result) -> dict[str, str]:
    return {f.code: f.severity for f in found.estimate.findings if "rotor" in f.code}


def test_the_default_model_takes_rotor_inertia_that_training_shows(tmp_path: Path):
    found = identified(tmp_path, {"train": log(1), "test": log(2)})
    assert codes(found) == {"rotor-inertia-added": "info"}
    assert found.study.model.terms[-1] == "rotor-inertia"
    true = dict(zip((p.name for p in model_with_rotors().parameters), truth_with_rotors(), strict=True))
    base, ends = found.estimate.base, found.estimate.intervals
    values = np.asarray(base.values_of(np.array([true.get(p.name, 0.0) for p in found.model.parameters])))
    inside = (ends[:, 0] <= values) & (values <= ends[:, 1])
    assert inside.mean() >= COVERED


def test_a_log_without_rotors_leaves_the_default_model(tmp_path: Path):
    found = identified(tmp_path, {"train": log(1, (0.0, 0.0, 0.0))})
    assert not codes(found) and "rotor-inertia" not in found.study.model.terms


def test_a_study_that_names_its_terms_keeps_them(tmp_path: Path):
    found = identified(tmp_path, {"train": log(1)}, "default")
    assert codes(found) == {"rotor-inertia-missing": "warning"}
    assert "rotor-inertia" not in found.study.model.terms


def test_doctor_says_for_information_that_identify_adds_the_term(tmp_path: Path):
    recording = log(1)
    for terms, severity in (((), "info"), (("default",), "warning")):
        study = Study(RobotChoice(str(write_arm(tmp_path))), ModelChoice(terms), (RecordingChoice("train"),))
        told = diagnose(study, given={"train": recording})[0].findings
        (found,) = [each for each in told if "rotor" in each.code]
        assert (found.code, found.severity) == ("rotor-inertia-missing", severity)
        assert ("identify adds" in found.evidence) == (severity == "info")
        assert found.remedy == ("" if severity == "info" else 'terms = ["default", "rotor-inertia"]  # in [model]')


def test_a_validation_recording_does_not_decide_the_terms(tmp_path: Path):
    found = identified(tmp_path, {"train": log(1, (0.0, 0.0, 0.0)), "test": log(2)})
    assert codes(found) == {"rotor-inertia-missing": "warning"}
    assert "rotor-inertia" not in found.study.model.terms


def with_late_friction(recording: Recording) -> Recording:
    """The recording with friction that reverses late, as that of a joint which sticks and is pulled loose."""
    assert recording.time is not None and recording.effort is not None
    velocity = np.gradient(recording.q, recording.time, axis=0)
    late = np.array([np.interp(recording.time - LATE, recording.time, v) for v in velocity.T]).T
    size = np.array([0.8, 1.2, 0.4])  # Coulomb friction of the small arm [N·m]
    return replace(recording, effort=recording.effort + size * (np.tanh(late / 0.02) - np.tanh(velocity / 0.02)))


def found_on(recording: Recording, robot: Robot) -> list[str]:
    evidence = LogEvidence(robot, recording, LogFormat(), recording)
    return [finding.code for finding in rotor_inertia_missing.check(evidence)]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_sticking_at_reversals_does_not_hide_rotors_in_slow_motion(seed: int, monkeypatch: pytest.MonkeyPatch):
    robot = small_model().robot
    slow = with_late_friction(log(seed, ROTORS, SLOWER))
    assert found_on(slow, robot) == ["rotor-inertia-missing"]
    assert found_on(with_late_friction(log(seed, (0.0, 0.0, 0.0), SLOWER)), robot) == []
    monkeypatch.setattr(rotor_inertia_missing, "away_from_reversals", lambda state: state)  # all rows alone
    assert found_on(slow, robot) == []
