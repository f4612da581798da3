"""Torque error of an estimate on the recordings of a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from armid.errors import Finding
from armid.estimation.estimate_record import Estimate
from armid.model.dynamics_model import DynamicsModel
from armid.study.extrapolation import highest_speeds, speed_finding
from armid.study.recordings.labels import labels
from armid.study.recordings.processed import ProcessedRecording
from armid.validation.torque_validation import PredictedRecording, Score, score


def score_recordings(
    model: DynamicsModel,
    estimate: Estimate,
    recordings: Sequence[ProcessedRecording],
    predictions: Mapping[ProcessedRecording, PredictedRecording] | None = None,
) -> tuple[tuple[Score, ...], tuple[Finding, ...]]:
    """Computes the torque error on each recording, with findings on it; missing predictions are computed."""
    scores: list[Score] = []
    findings: list[Finding] = []
    names = labels([each.choice for each in recordings])
    for each, label in zip(recordings, names, strict=True):
        path, asked = each.choice.path, highest_speeds(each.observations)
        beyond = speed_finding(model.robot, estimate.speeds, asked, label or Path(path).name)
        findings += each.findings if beyond is None else (*each.findings, beyond)
        prediction = (predictions or {}).get(each)
        sha256 = each.recording.sha256
        scores.append(score(model, estimate, each.observations, path=path, sha256=sha256, prediction=prediction))
    return tuple(scores), tuple(findings)
