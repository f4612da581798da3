"""Errors of the doctor fail an identification: recordings with the same fault agree with each other."""

from __future__ import annotations

from dataclasses import replace

import pytest

from armid.doctor import effects
from armid.errors import Finding
from armid.measurement.log_format import LogFormat
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.identify import Result, identify
from armid.study.plausibility.recording_errors import contradicted
from sick import sound

ARM = "ur10e"


@pytest.fixture(scope="module")
def of_opposite_torque() -> Result:
    log = sound(11, name=ARM).recording
    assert log.effort is not None
    log = replace(log, effort=-log.effort)
    logs = {"train.csv": log, "check.csv": replace(log, sha256="other")}
    choices = tuple(
        RecordingChoice(path, role, LogFormat(), part=share)
        for path, role, share in (("train.csv", "train", (0.0, 0.6)), ("check.csv", "validate", (0.6, 1.0)))
    )
    return identify(Study(RobotChoice(ARM), ModelChoice(), choices), given=logs)


def test_a_common_fault_fails_although_the_recordings_agree(of_opposite_torque: Result):
    validation = of_opposite_torque.validation
    assert validation.verdict == "fail"
    assert [check.name for check in validation.checks if not check.ok] == ["errors in the recordings (torque-sign)"]


def test_the_title_of_a_verdict_says_which_motion_it_is_about(of_opposite_torque: Result):
    validation = of_opposite_torque.validation
    assert validation.summary().title == "verdict on held-out motion: fail"
    alone = contradicted(replace(validation, recordings=(), checks=(), verdict="not judged", left_out=None), ())
    assert alone.summary().title == "verdict on held-out motion: not judged"
    failed = contradicted(alone, [Finding("torque-sign", "error", "", "", "")])
    assert failed.summary().title == "verdict on training motion (no motion is held out): fail"
    without = replace(validation, recordings=(), checks=(), verdict="pass")
    assert without.summary().title == "verdict on left-out parts of the training data: pass"


@pytest.mark.parametrize("code", sorted(effects()))
def test_every_error_of_the_doctor_fails_and_no_warning_does(of_opposite_torque: Result, code: str):
    checks = tuple(check for check in of_opposite_torque.validation.checks if check.ok)
    passed = replace(of_opposite_torque.validation, verdict="pass", checks=checks)
    for severity, verdict in (("error", "fail"), ("warning", "pass"), ("info", "pass")):
        assert contradicted(passed, [Finding(code, severity, "", "", "")]).verdict == verdict
    assert contradicted(passed, [Finding("of-no-check", "error", "", "", "")]).verdict == "pass"
