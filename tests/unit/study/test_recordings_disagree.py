"""Training recordings that contradict each other: planted scales and loads are found, sound ones stay silent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from armid import DynamicsModel, accumulate_information, find_base_parameters, load_robot
from armid.checked_array import Array
from armid.errors import Finding
from armid.estimation.agreement_of_recordings import compare_recordings, scale_deviations, torque_scales
from armid.estimation.friction_per_recording import changing_parameters
from armid.excitation.thesis_plans import builtin_plan
from armid.information.information import Information
from armid.lab.inverse_dynamics_recording import thesis_truth
from armid.measurement.recording import Recording
from armid.model.base_parameters import BaseParameters
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.identify import identify
from armid.study.plausibility.recording_errors import contradicted
from armid.study.recordings.agreement import CODE, disagreement_findings
from armid.validation.torque_validation import Validation
from problems import one_run, raw
from sick import sound

NAMES = ("first.csv", "second.csv", "third.csv")
CHOICES = tuple(RecordingChoice(name) for name in NAMES)
RATE = 25.0
NOISE = 0.02
"""Noise of each torque, relative to its RMS."""


@cache
def arm() -> tuple[DynamicsModel, BaseParameters, Array]:
    model = DynamicsModel(load_robot("iiwa14-r820"), (RigidBody(), Viscous(), Coulomb()))
    return model, find_base_parameters(model), thesis_truth(model)


def information(
    factors: Mapping[int, Array | float], *, count: int = 3, seed: int = 0, load: float = 0.0
) -> Information:
    """Information of recordings with factors on their torques; the last recording carries a load [kg]."""
    model, base, theta = arm()
    rng = np.random.default_rng(seed)
    runs = []
    for k, (plan, slower) in enumerate((("thesis-a1", 1.0), ("thesis-a2", 1.0), ("thesis-a1", 1.5))[:count]):
        planned = builtin_plan(plan)
        motion = planned.stretched(slower * planned.period).sample(RATE)
        carried = theta.copy()
        if k == count - 1:
            carried[model.inertial_columns[-10:]] += load * np.array([1, 0, 0, 0.1, 0.01, 0.01, 0.005, 0, 0, 0])
        torque = model.torque(motion, carried)
        noise = NOISE * np.sqrt(np.mean(torque**2, axis=0)) * rng.standard_normal(torque.shape)
        runs.append(replace(one_run(motion, factors.get(k, 1.0) * (torque + noise), RATE), recording=k))
    return accumulate_information(model, base, raw(*runs))


def found(given: Information, count: int = 3) -> list[Finding]:
    model, base, _ = arm()
    return disagreement_findings(model, base, given, CHOICES[:count])


@pytest.mark.parametrize("factor", [0.5, 0.71, 1.41, 2.0, -1.0])
@pytest.mark.parametrize("odd", [0, 1, 2])
def test_a_recording_of_another_scale_is_named_with_its_factor(factor: float, odd: int):
    (finding,) = found(information({odd: factor}))
    assert (finding.code, finding.severity) == (CODE, "error")
    assert f"The torques of {NAMES[odd]} " in finding.evidence and " A2 " in finding.evidence


@pytest.mark.parametrize("factor", [0.5, 0.71, 1.0, 1.41, 2.0])
def test_the_scales_are_recovered_within_their_deviations(factor: float):
    given = information({1: factor})
    model, base, _ = arm()
    own = changing_parameters(model)[base.kept]
    compared = compare_recordings(given, own)[1]
    scales = torque_scales(compared)
    deviation = scale_deviations(given, own, compared, scales)
    # Five deviations: with seven joints and five factors, chance exceeds them once in 50 000 tests.
    assert (np.abs(scales.scale - factor) < 5.0 * deviation).all()
    # A twentieth: noise of 2 % over a minute of motion leaves less than that on the joints that carry much.
    assert (deviation[:4] < 0.05 * factor).all()


def test_two_recordings_of_which_either_may_be_wrong_are_both_named():
    (finding,) = found(information({1: 2.0}, count=2), 2)
    assert finding.severity == "error" and NAMES[0] in finding.evidence and NAMES[1] in finding.evidence


def test_one_joint_of_another_scale_is_named_alone():
    factors = np.ones(7)
    factors[3] = 1.41
    (finding,) = found(information({2: factors}))
    assert finding.severity == "error" and "A4 1.4" in finding.evidence
    assert "A2" not in finding.evidence


def test_a_small_factor_is_a_warning():
    (finding,) = found(information({1: 1.22}))
    assert finding.severity == "warning"


def test_two_recordings_of_another_scale_are_found_one_after_the_other():
    findings = found(information({0: 0.5, 2: 1.41}))
    assert len(findings) == 2


def test_another_load_is_no_scale():
    (finding,) = found(information({}, load=10.0))
    assert finding.severity == "error" and "do not explain" in finding.evidence and NAMES[2] in finding.evidence


@pytest.mark.parametrize("seed", range(4))
def test_sound_recordings_are_told_nothing(seed: int):
    assert found(information({}, seed=seed)) == []
    assert found(information({}, count=2, seed=seed), 2) == []


def test_a_common_factor_is_no_contradiction():
    assert found(information(dict.fromkeys(range(3), 2.0))) == []


def test_one_recording_contradicts_nothing():
    assert found(information({}, count=1), 1) == []


def test_an_error_fails_the_verdict_and_a_warning_does_not():
    passed = Validation(("joint_1",), (), "pass", ())
    assert contradicted(passed, [Finding(CODE, "error", "", "", "")]).verdict == "fail"
    assert contradicted(passed, [Finding(CODE, "warning", "", "", "")]).verdict == "pass"


def test_an_identification_from_contradicting_recordings_fails():
    log = sound(11, name="ur10e").recording
    assert log.effort is not None
    logs: dict[str, Recording] = {
        "torque.csv": replace(log, sha256="torque"),
        "wrong.csv": replace(log, effort=1.41 * log.effort, sha256="wrong"),
        "check.csv": replace(log, effort=1.41 * log.effort, sha256="check"),
    }
    choices = (
        RecordingChoice("torque.csv", part=(0.0, 0.5)),
        RecordingChoice("wrong.csv", part=(0.5, 0.8)),
        RecordingChoice("check.csv", "validate", part=(0.8, 1.0)),
    )
    result = identify(Study(RobotChoice("ur10e"), ModelChoice(), choices), given=logs)
    assert [each.severity for each in result.estimate.findings if each.code == CODE] == ["error"]
    assert result.validation.verdict == "fail"
    sane = {name: replace(each, effort=log.effort) for name, each in logs.items()}
    result = identify(Study(RobotChoice("ur10e"), ModelChoice(), choices), given=sane)
    assert not [each for each in result.estimate.findings if each.code == CODE]
    assert result.validation.verdict == "pass"


def test_a_validation_recording_of_another_scale_is_named_and_a_sound_one_is_not():
    log = sound(11, name="ur10e").recording
    assert log.effort is not None
    logs: dict[str, Recording] = {
        "torque.csv": replace(log, sha256="torque"),
        "check.csv": replace(log, effort=log.effort * np.array([1.0, 1.5, 1.0, 1.0, 1.0, 1.0]), sha256="check"),
    }
    choices = (
        RecordingChoice("torque.csv", part=(0.0, 0.6)),
        RecordingChoice("check.csv", "validate", part=(0.6, 1.0)),
    )
    study = Study(RobotChoice("ur10e"), ModelChoice(), choices)
    result = identify(study, given=logs)
    (told,) = [each for each in result.estimate.findings if each.code == CODE]
    assert told.severity == "error" and "shoulder_lift_joint" in told.evidence
    assert result.validation.verdict == "fail"
    result = identify(study, given={**logs, "check.csv": replace(log, sha256="check")})
    assert not [each for each in result.estimate.findings if each.code == CODE]
