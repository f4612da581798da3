"""Check for saturated torque (a plateau, or torque at the limit of the description) and torque beyond the limit."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.measurement.processing.saturation import FEWEST, NOT_USED, SHARE, Plateau, plateaus
from armid.measurement.remedy_builders import lines
from armid.remedy import Remedy, setting
from armid.robot.robot import Joint

LIMIT = 0.98
"""Share of the limit of the description from which the limit counts as reached."""

SPOILING = 0.01
"""Share of samples at a plateau from which most of an estimate is wrong if they are used."""

NEAR_END, OVERFLOWS = 0.8, 3
"""Share of the largest torque beyond which a torque is near the end of its range, and smallest number of steps from
one end to the other in one row from which its number overflows. On recorded and simulated logs there is none."""

BEYOND = 1.5
"""Ratio of torque to the limit of the description from which this limit cannot have been in force."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports each joint whose torque saturates or is beyond its limit."""
    recording = evidence.recording
    if recording is None or recording.effort is None:
        return []
    findings: list[Finding] = []
    counted = recording.valid
    if isinstance(evidence.saturation, float):
        limits = np.array([joint.effort_limit for joint in evidence.robot.joints])
        counted = counted & ~((limits > 0.0) & (np.abs(recording.effort) >= evidence.saturation * limits))
    flat = {each.joint: each for each in plateaus(recording.effort, counted)}
    for j, joint in enumerate(evidence.robot.joints):
        tau = recording.effort[counted[:, j], j]
        if not len(tau) or np.ptp(tau) == 0.0:
            continue
        at_limit = int((np.abs(tau) >= LIMIT * joint.effort_limit).sum()) if joint.effort_limit > 0.0 else 0
        overflows = 0 if recording.consecutive is False else _overflows(recording.effort[:, j])
        if overflows >= OVERFLOWS:
            findings.append(_overflowing(joint, overflows))
        elif j in flat:
            findings.append(_clipped(joint, flat[j], kept=evidence.saturation == "keep"))
        elif at_limit >= FEWEST and np.sort(np.abs(tau))[-FEWEST] > BEYOND * joint.effort_limit:
            findings.append(_beyond(joint, tau))
        elif at_limit >= max(FEWEST, SHARE * len(tau)):
            text = (
                f"{at_limit} of {len(tau)} samples reach {LIMIT:.0%} of the effort limit of the description, "
                f"{joint.effort_limit:.4g} {joint.effort_unit}."
            )
            remedy = lines(table="processing", saturation=LIMIT)
            findings.append(Finding("saturation", "warning", joint.name, text, remedy))
    return findings


def _overflows(tau: Array) -> int:
    """Number of steps of a torque (N,) from one end of its range to the other in one row, in its direction."""
    end = NEAR_END * float(np.abs(tau).max())
    at = np.flatnonzero((np.abs(tau[1:]) > end) & (np.abs(tau[:-1]) > end) & (tau[1:] * tau[:-1] < 0.0))
    # It moves on in the same direction, which friction that reverses does not.
    goes_on = [
        0 < k < len(tau) - 2 and (tau[k] - tau[k - 1]) * tau[k] > 0.0 and (tau[k + 2] - tau[k + 1]) * tau[k] > 0.0
        for k in at
    ]
    return int(np.count_nonzero(goes_on))


def _overflowing(joint: Joint, count: int) -> Finding:
    """Finding about a torque that steps from one end of its range to the other."""
    return Finding(
        "saturation",
        "error",
        joint.name,
        f"The torque of {joint.name} steps {count} times from one end of its range to the other in one row, and "
        "stays there: its number overflows beyond the end.",
        "log the torque in a number with a larger range, or correct the log by the range after each such step",
    )


def _clipped(joint: Joint, flat: Plateau, *, kept: bool) -> Finding:
    """Finding about a plateau of the torque.

    It is an error if the study uses the samples of the plateau (`kept`) and their number is not small.
    """
    text = (
        f"{flat.count} of {flat.samples} samples have the same extreme value, {flat.level:.4g} {joint.effort_unit}; "
        "the true torque is larger."
    )
    if kept:
        remedy = Remedy("rewrite the study without ", setting("saturation", "keep"), ", which uses these samples")
        return Finding(
            "saturation",
            "error" if flat.count >= SPOILING * flat.samples else "warning",
            joint.name,
            text,
            remedy,
        )
    remedy = "record a motion that needs less torque, or find out where the range of the sensor or the drive ends"
    return Finding("saturation", "warning", joint.name, f"{text} {NOT_USED}", remedy)


def _beyond(joint: Joint, tau: Array) -> Finding:
    """Finding about torque of a joint that is beyond the effort limit of the description."""
    unit, limit, size = joint.effort_unit, joint.effort_limit, np.abs(tau)
    return Finding(
        "torque-beyond-limit",
        "warning",
        joint.name,
        f"{int((size > limit).sum())} of {len(tau)} samples are beyond the effort limit of the description, "
        f"{limit:.4g} {unit}; the largest is {size.max():.4g} {unit}.",
        f"check the unit of this torque (the key `drive_gain`, one number for each joint, converts it to {unit}) and "
        "the limit in the description.",
    )


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "saturation": "The largest logged torques are too small, and so are the estimated inertias and friction.",
        "torque-beyond-limit": "If the unit is wrong, the friction of this joint is wrong by the factor between "
        "the units, and inertial parameters that also affect other joints are a compromise.",
    },
    untested={
        "saturation": "it removes rows without a measurement, so there is nothing to compare with the prediction",
    },
    hides=(
        "contact",
        "temperature-drift",
    ),
    needs_torque=False,
)
