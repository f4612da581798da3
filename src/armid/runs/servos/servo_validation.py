"""Closed-loop position error of a servo result on new recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from armid.errors import Finding, StudyError
from armid.runs.servos.stored_servo import StoredServo
from armid.servo.servo_run import ServoRun, servo_runs
from armid.study.config import RecordingChoice
from armid.study.recordings.reading import read_choice
from armid.study.servos.identification import ServoScore, servo_score


def validate_servo(
    stored: StoredServo, paths: Sequence[str], changes: Mapping[str, Any]
) -> tuple[ServoScore, tuple[ServoRun, ...], tuple[Finding, ...]]:
    """Errors of a servo result on recordings that were not used to train it, with their runs and findings.

    Args:
        stored: The result.
        paths: Recordings.
        changes: Fields of the log format that differ from that of the first training recording.

    Raises:
        StudyError: The result was trained on one of the recordings.
        RecordingError: A recording cannot be read, or has no commands.
    """
    first = next(each.reading for each in stored.study.recordings if each.role == "train")
    reading = replace(first, **{"exclude": (), "start": None, "period": None, **changes})
    trained = {
        sha256
        for choice, sha256 in zip(stored.study.recordings, stored.digests, strict=True)
        if choice.role == "train"
    }
    runs: list[ServoRun] = []
    findings: list[Finding] = []
    for path in paths:
        recording, found = read_choice(RecordingChoice(path, "validate", reading), ".", stored.robot)
        if recording.sha256 in trained:
            raise StudyError(
                f"{path} cannot be used to validate {stored.folder}, because the arm was trained on the same data "
                f"(sha256 {recording.sha256[:12]}…).",
                remedy="give a recording of which no part was used for training.",
            )
        runs += servo_runs(recording)
        findings += found
    return servo_score(stored.model, stored.parameters, runs, stored.errors.band), tuple(runs), tuple(findings)
