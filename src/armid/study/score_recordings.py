"""Torque error of an estimate on the recordings of a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from armid.errors import Finding
from armid.estimation.estimate_record import Estimate
from armid.model.dynamics_model import DynamicsModel
from armid.robot import Robot
from armid.study.extrapolation import highest_speeds, speed_finding
from armid.study.prepare import Prepared
from armid.study.recordings.agreement import validation_disagreements
from armid.study.recordings.labels import labels
from armid.study.recordings.processed import ProcessedRecording, of_role
from armid.validation.torque_validation import PredictedRecording, Score, score

MOSTLY = 0.5
"""The mean error of a joint is reported if its square is more than this share of the mean square error."""


def score_recordings(
    model: DynamicsModel,
    estimate: Estimate,
    recordings: Sequence[ProcessedRecording],
    predictions: Mapping[ProcessedRecording, PredictedRecording] | None = None,
) -> tuple[tuple[Score, ...], tuple[Finding, ...]]:
    """Computes the torque error on each recording, and findings about it; predicts the torque if it is not given."""
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
        own = own_offset_finding(scores[-1], model.robot, label or Path(path).name)
        findings += [own] if own is not None and each.choice.role == "validate" else []
    return tuple(scores), tuple(findings)


def score_validation(
    prepared: Prepared,
    estimate: Estimate,
    training: Sequence[Score],
    predictions: Mapping[ProcessedRecording, PredictedRecording],
) -> tuple[tuple[Score, ...], tuple[Finding, ...], tuple[Finding, ...]]:
    """Computes the torque error on the validation recordings of a study, and compares them with the training ones.

    Args:
        prepared: The prepared study.
        estimate: The estimate.
        training: Torque error on each training recording.
        predictions: Predicted torque of the recordings.

    Returns:
        The torque errors, findings about them, and findings about recordings that contradict the training recordings.
    """
    recordings = of_role(prepared.recordings, "validate")
    scores, findings = score_recordings(prepared.model, estimate, recordings, predictions)
    pairs = list(zip(recordings, scores, strict=True))
    information = prepared.problem.information
    disagreements = validation_disagreements(
        prepared.model, prepared.base, information, training, pairs, prepared.findings
    )
    return scores, findings, tuple(disagreements)


def own_offset_finding(found: Score, robot: Robot, where: str) -> Finding | None:
    """Finding on joints whose torque error on a recording is mostly a constant; `None` without such joints.

    Args:
        found: Torque error on the recording.
        robot: The arm.
        where: Name of the recording.
    """
    rest = found.rms_with_own_offset
    with np.errstate(invalid="ignore"):
        mostly = found.offset**2 > MOSTLY * found.rms**2
    if not mostly.any():
        return None
    listed = "; ".join(
        f"{robot.joints[j].name}: mean error {found.offset[j]:.3g} {robot.joints[j].effort_unit}, RMS error "
        f"{found.rms[j]:.3g} {robot.joints[j].effort_unit} with this mean and {rest[j]:.3g} "
        f"{robot.joints[j].effort_unit} without it"
        for j in np.flatnonzero(mostly)
    )
    return Finding(
        "own-offset",
        "info",
        "",
        f"{where}: most of the torque error is a constant ({listed}). A recording can have an offset of its own, "
        "because torque sensors are zeroed again and warm up.",
        "zero the torque sensors before a recording, or train with several recordings and with the key "
        "offset_per_recording = true.",
    )
