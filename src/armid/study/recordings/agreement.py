"""Findings about training recordings of a study that contradict each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding
from armid.estimation.agreement_of_recordings import (
    Agreement,
    TorqueScales,
    compare_recordings,
    scale_deviations,
    torque_scales,
)
from armid.estimation.friction_per_recording import changing_parameters
from armid.information.information import Information, select
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.study.config import RecordingChoice
from armid.study.recordings.labels import labels

CODE = "recordings-disagree"

WORSE = 1.2
"""Least ratio of the residuals of a joint in a recording without and with a scale of torque that is reported."""

OTHERWISE = 1.5
"""Least ratio of the residual of a recording in the common fit to that of the recording alone, from which it is
reported although scales of torque do not explain it. Between recordings of one arm it was at most 1.11."""

LARGE = 0.08
"""Least residual in the common fit, relative to the torque, for such a recording. Recorded parts of five seconds had
ratios of up to 2.2, since separate fits follow the noise, but residuals of 5 %; with a load of 2.8 kg it was 15 %."""

SCALED = 1.15
"""Scale of a torque, or one over it, from which it is reported."""

WRONG = 1.3
"""Scale of a torque, or one over it, from which it is an error."""

SURE = 5.0
"""Least distance of a scale from one, in standard deviations. These do not contain the error of the friction model,
which shifted the scale of hardly loaded joints of recorded arms by up to 4.4."""

EXPLAINED = 0.9
"""Least share of the disagreement that scales of torque must explain. They explained 0.66 to 0.85 of another load."""

LEFT = 1.5
"""Largest residual with scales of torque, relative to separate fits, at which scales explain the disagreement. Of a
load of 10 kg they explained 97 %, and left 3.7."""

ALIKE = 0.8
"""Share of the largest decrease of the cost from which a recording may also be the one that is wrong."""

TRIED = 3
"""Largest number of recordings of which scales are computed at a time."""


@dataclass(frozen=True, eq=False, slots=True)
class _Odd:
    """Recording that contradicts the others, with its scales of torque, and that with the largest excess."""

    agreement: Agreement
    scales: TorqueScales
    worst: Agreement


def disagreement_findings(
    model: DynamicsModel, base: BaseParameters, information: Information, choices: Sequence[RecordingChoice]
) -> list[Finding]:
    """Findings about training recordings that contradict the others in the scale of the torque or otherwise.

    Args:
        model: Arm and torque terms.
        base: Base parameters of the model.
        information: Factors of the training recordings.
        choices: Training recordings, by their number.
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


def _names(choices: Sequence[RecordingChoice]) -> list[str]:
    """Names of recordings, with their part where several are parts of one file."""
    names = labels(choices)
    return [
        name if names.count(name) == 1 else f"{name} from {choice.part[0]:.0%} to {choice.part[1]:.0%}"
        for name, choice in zip(names, choices, strict=True)
    ]


def _odd_recording(compared: Sequence[Agreement]) -> _Odd | None:
    """Recording whose torques agree least with the others; `None` if all agree."""
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
    """Finding about a recording, or `None` if its disagreement is not significant or small."""
    agreement, scales = odd.agreement, odd.scales
    best = min(agreement.separate, scales.cost)
    explained = (agreement.cost - scales.cost) / max(agreement.cost - best, np.finfo(float).tiny)
    left = np.sqrt(scales.cost / max(agreement.separate, np.finfo(float).tiny))
    other = scaled_joints(scales.scale, deviation) & (agreement.common >= WORSE * scales.residual)
    if explained >= EXPLAINED and left <= LEFT and other.any():
        return _scale_finding(model, scales.scale, deviation, other, name, against)
    if odd.worst.excess < OTHERWISE or odd.worst.relative < LARGE:
        return None
    return Finding(
        CODE,
        "error",
        "",
        f"{name} contradicts {against}: one model for all leaves in {name} a torque error of "
        f"{agreement.relative:.0%} of the torque, {agreement.excess:.2g} times that of a model for {name} alone, "
        "each with friction of its own. Scales of the torques do not explain it; the load, the signs or the order "
        "of channels, or the zeros of the joints may differ.",
        f"check the load and the log format of {name} and of {against}, and leave out the recording that is wrong.",
    )


def scaled_joints(scale: Array, deviation: Array) -> NDArray[np.bool_]:
    """Mask of the joints whose torque has another scale, significantly and by more than `SCALED`, shape (n,)."""
    return (_factor(scale) > SCALED) & (np.abs(scale - 1.0) > SURE * deviation)


def _factor(scale: Array) -> Array:
    """Scale or one over it, whichever is larger; infinite for one of another sign."""
    positive = np.where(scale > 0.0, scale, np.finfo(float).tiny)
    return np.maximum(positive, 1.0 / positive)


def _scale_finding(
    model: DynamicsModel, scale: Array, deviation: Array, other: NDArray[np.bool_], name: str, against: str
) -> Finding:
    """Finding about scales of torque."""
    listed = ", ".join(
        f"{model.robot.joint_names[j]} {scale[j]:.3g} ± {2.0 * deviation[j]:.1g}" for j in np.flatnonzero(other)
    )
    return Finding(
        CODE,
        "error" if bool((_factor(scale)[other] > WRONG).any()) else "warning",
        "",
        f"The torques of {name} have another scale than those of {against}, relative to which they are: {listed} "
        "(95 % intervals). Parameters that are estimated from both are a compromise between the scales.",
        f"find out which of them is right. If it is not {name}, divide its drive_gain by these factors, or correct "
        "its unit or torque_sign; or leave out the recording that is wrong.",
    )
