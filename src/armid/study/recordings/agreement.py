"""Findings about recordings of a study that contradict each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError, Finding
from armid.estimation.agreement_of_recordings import (
    Agreement,
    TorqueScales,
    compare_recordings,
    scale_deviations,
    torque_scales,
)
from armid.estimation.friction_per_recording import changing_parameters
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, merge, select
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.study.config import RecordingChoice
from armid.study.recordings.labels import labels
from armid.study.recordings.processed import ProcessedRecording
from armid.validation.torque_validation import Score

CODE = "recordings-disagree"

WORSE = 1.2
"""A torque scale of a joint is reported if the residual of the joint without this scale, divided by its residual with
the scale, is at least this ratio."""

OTHERWISE = 1.5
"""Smallest ratio at which a recording is reported although torque scales do not explain the difference: residual of
the recording in the common fit of all recordings, divided by its residual in a fit of this recording alone. For
recordings of one arm with one load, the ratio was at most 1.11."""

LARGE = 0.08
"""A recording whose difference is not explained by torque scales is reported only if its residual in the common fit,
divided by its torque, is at least this large. Recordings of five seconds had ratios (see `OTHERWISE`) of up to
2.2, because separate fits follow the noise, but residuals of 5 %. With an additional load of 2.8 kg the residual was
15 %."""

CLEARLY, SMALL = 3.0, 0.03
"""If the ratio of the residuals (see `OTHERWISE`) is at least `CLEARLY`, a residual of the share `SMALL` of the
torque is sufficient for a finding, instead of the share `LARGE`. The ratio is 1.8 for the training and validation
recordings of an arm whose residuals are 2 %, and 3.1 with a load of a tenth of the arm's weight."""

SCALED = 1.15
"""Torque scale of a joint relative to other recordings, or its inverse, above which the scale is reported."""

WRONG = 1.3
"""Torque scale of a joint relative to other recordings, or its inverse, above which the finding is an error."""

SURE = 5.0
"""Smallest difference between a torque scale and 1 that is significant, in standard deviations of the scale. The
standard deviations do not include the error of the friction model. On recorded arms, this error shifted the scale of
joints with little load by up to 4.4 standard deviations."""

EXPLAINED = 0.9
"""Torque scales count as the cause of a disagreement only if they explain at least this share of it. If the cause was
another load, torque scales explained 0.66 to 0.85."""

LEFT = 1.5
"""Largest ratio at which torque scales count as the explanation of a disagreement: residual of the common fit with
torque scales, divided by the residual of separate fits. For a load of 10 kg the scales explained 97 % of the
disagreement, but the ratio was 3.7."""

ALIKE = 0.8
"""A separate fit of one recording decreases the cost, that is, the weighted sum of squared residuals. The recording
may be the wrong one if its decrease is at least this share of the largest decrease of all recordings."""

LARGER = 1.3
"""A validation recording is compared with the training recordings only if the error of some joint on it is larger
than the error on the training recordings by this factor. This saves time, because a contradiction makes the error
larger."""

TRIED = 3
"""Largest number of recordings for which torque scales are computed, to find the recording that is wrong."""


@dataclass(frozen=True, eq=False, slots=True)
class _Odd:
    """Recording that contradicts the others, with its torque scales.

    Attributes:
        agreement: Comparison of this recording with the others.
        scales: Scales of its torques relative to the other recordings.
        worst: Comparison of the recording whose residual grows most, relative to a separate fit, in the common fit.
    """

    agreement: Agreement
    scales: TorqueScales
    worst: Agreement


def disagreement_findings(
    model: DynamicsModel, base: BaseParameters, information: Information, choices: Sequence[RecordingChoice]
) -> list[Finding]:
    """Findings about training recordings that contradict the others, in the scale of the torque or in another way.

    Args:
        model: Arm and torque terms.
        base: Base parameters of the model.
        information: Factors of the training recordings.
        choices: Training recordings; the index is the number of the recording in `information`.
    """
    own = changing_parameters(model)[base.kept]
    names = _names(choices)
    found: list[Finding] = []
    while True:
        odd = _odd_recording(compare_recordings(information, own))
        if odd is None:
            return found
        deviation = scale_deviations(information, own, odd.agreement, odd.scales)
        others = [r for r in np.unique(information.recording) if r != odd.agreement.recording]
        against = names[others[0]] if len(others) == 1 else "the other training recordings"
        finding = _finding(model, odd, deviation, names[odd.agreement.recording], against)
        if finding is None:
            return found
        found.append(finding)
        information = select(information, np.isin(information.recording, others))


def validation_disagreements(
    model: DynamicsModel,
    base: BaseParameters,
    information: Information,
    training: Sequence[Score],
    judged: Sequence[tuple[ProcessedRecording, Score]],
    told: Sequence[Finding] = (),
) -> list[Finding]:
    """Findings about validation recordings that contradict all training recordings together.

    A validation recording is compared only if the error of some joint on it is much larger than on the training
    recordings. Friction and offsets may differ between training and validation. If a finding of severity `error`
    exists already, for instance because training recordings contradict each other, nothing is compared: the cause is
    reported, and the verdict is `fail`.

    Args:
        model: Arm and torque terms.
        base: Base parameters of the model.
        information: Factors of the training recordings.
        training: Torque error on each training recording.
        judged: Validation recordings, each with the torque error on it.
        told: Findings about the recordings that are already reported.
    """
    if any(finding.severity == "error" for finding in told):
        return []
    usual = np.max([each.rms for each in training], axis=0)
    together = replace(information, recording=np.zeros_like(information.recording))
    found: list[Finding] = []
    trained = RecordingChoice("the training recordings" if len(training) > 1 else training[0].path)
    for each, own in judged:
        if not (own.rms > LARGER * usual).any():
            continue
        try:
            other = accumulate_information(model, base, each.observations)
        except ArmidError:
            continue  # no row with known hysteresis: the score says so, and validation must not end a run
        other = replace(other, recording=np.ones_like(other.recording), scale_deviation=information.scale_deviation)
        found += disagreement_findings(model, base, merge([together, other]), (trained, each.choice))
    return found


def _names(choices: Sequence[RecordingChoice]) -> list[str]:
    """Names of recordings; if several recordings are parts of one file, the name contains the part."""
    names = labels(choices)
    return [
        name if names.count(name) == 1 else f"{name} from {choice.part[0]:.0%} to {choice.part[1]:.0%}"
        for name, choice in zip(names, choices, strict=True)
    ]


def _odd_recording(compared: Sequence[Agreement]) -> _Odd | None:
    """Recording whose torques agree least with those of the other recordings; `None` if all recordings agree."""
    if not any(each.cost - each.separate > each.expected for each in compared):
        return None
    most = max(each.cost - each.separate for each in compared)
    candidates = sorted(compared, key=lambda each: each.separate - each.cost)[:TRIED]
    worst = max(compared, key=lambda each: each.excess)
    tried = [
        _Odd(each, torque_scales(each), worst) for each in candidates if each.cost - each.separate >= ALIKE * most
    ]
    return min(tried, key=lambda odd: odd.scales.cost)


def _finding(model: DynamicsModel, odd: _Odd, deviation: Array, name: str, against: str) -> Finding | None:
    """Finding about a recording that contradicts others; `None` if the difference is small or not significant."""
    agreement, scales = odd.agreement, odd.scales
    best = min(agreement.separate, scales.cost)
    explained = (agreement.cost - scales.cost) / max(agreement.cost - best, np.finfo(float).tiny)
    left = np.sqrt(scales.cost / max(agreement.separate, np.finfo(float).tiny))
    other = scaled_joints(scales.scale, deviation) & (agreement.common >= WORSE * scales.residual)
    if explained >= EXPLAINED and left <= LEFT and other.any():
        return _scale_finding(model, scales.scale, deviation, other, name, against)
    if odd.worst.excess < OTHERWISE or odd.worst.relative < (LARGE if odd.worst.excess < CLEARLY else SMALL):
        return None
    return Finding(
        CODE,
        "error",
        "",
        f"{name} contradicts {against}: with one model for all recordings, the torque error in {name} is "
        f"{agreement.relative:.0%} of the torque, {agreement.excess:.2g} times the error with a model for {name} "
        "alone; both models have separate friction for each recording. Different scales of the torques do not "
        "explain the difference; the load, the signs or order of channels, or the zeros of the joints may differ.",
        f"check the load and the log format of {name} and of {against}, and leave out the recording that is wrong.",
    )


def scaled_joints(scale: Array, deviation: Array) -> NDArray[np.bool_]:
    """Mask (n,) of the joints whose torque scale differs from 1 significantly and by more than the factor `SCALED`.

    Args:
        scale: Torque scale of each joint relative to other recordings, shape (n,).
        deviation: Standard deviation of each torque scale, shape (n,).
    """
    return (_factor(scale) > SCALED) & (np.abs(scale - 1.0) > SURE * deviation)


def _factor(scale: Array) -> Array:
    """Larger one of each torque scale and its inverse, shape (n,); very large for a negative scale."""
    positive = np.where(scale > 0.0, scale, np.finfo(float).tiny)
    return np.maximum(positive, 1.0 / positive)


def _scale_finding(
    model: DynamicsModel, scale: Array, deviation: Array, other: NDArray[np.bool_], name: str, against: str
) -> Finding:
    """Finding about joints whose torque scale in one recording differs from that in the other recordings."""
    listed = ", ".join(
        f"{model.robot.joint_names[j]} {scale[j]:.3g} ± {2.0 * deviation[j]:.1g}" for j in np.flatnonzero(other)
    )
    return Finding(
        CODE,
        "error" if bool((_factor(scale)[other] > WRONG).any()) else "warning",
        "",
        f"The torques of {name} have another scale than those of {against}. The ratios of the scales are: {listed} "
        "(95 % intervals). Parameters that are estimated from all of them are a compromise between the scales.",
        f"find out which recording is right. If {name} is wrong, divide its key drive_gain by these ratios, or "
        "correct its unit or its key torque_sign; or leave out the recording that is wrong.",
    )
