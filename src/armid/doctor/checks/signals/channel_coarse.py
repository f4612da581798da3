"""Check for channels with steps so coarse that rounding is a large part of the signal."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.measurement.processing.channels.isolated_samples import smallest_step

CODE = "channel-coarse"

COARSE_TORQUE = 0.04
"""Smallest step of a torque, relative to its range, that is reported. On recorded arms it is at most 0.02."""

COARSE_ANGLE, COARSE_LENGTH = 0.01, 0.005
"""Smallest step of a position that is reported [rad and m]. Encoders of servos with 4096 counts have 0.0015 rad."""

STILL = 0.5
"""Smallest share of rows in which a coarse channel keeps its value. If a channel changes in nearly every row, its
steps are those of the motion, at a low sample rate."""

HELD, ALIKE, OTHERS, ROWS = 0.03, 0.8, 4.0, 2.0
"""Shortest time for which a torque keeps each value [s], smallest share of these times that are equal up to a row,
smallest ratio of the changes of the position to those of the torque, and largest usual number of rows with one value
in a log that is not sampled too slowly. In 16 recordings of eight arms, the usual number of rows is 1 for every
joint, the time is at most 0.02 s, and the ratio at most 1.15; at least 98 % of the times are equal, as they are where
a torque is sampled more slowly."""

UPDATES = 25
"""Smallest number of changes of a torque from which its interval is determined: a fifth of the intervals may differ,
and of 25 these are five. Recordings of eight arms have 1359 and more."""

FEWEST = 100
"""Smallest number of rows."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports channels with coarse steps."""
    recording = evidence.recording
    if recording is None or recording.effort is None:
        return []
    findings: list[Finding] = []
    for j, joint in enumerate(evidence.robot.joints):
        rows = recording.valid[:, j]
        q, effort = recording.q[rows, j], recording.effort[rows, j]
        if len(effort) < FEWEST:
            continue
        step, size = _step(effort), float(np.ptp(effort))
        if step > COARSE_TORQUE * size:
            text = f"The torque has steps of {step:.3g} {joint.effort_unit}, {step / size:.0%} of its range."
            findings.append(Finding(CODE, "warning", joint.name, text, "log the torque with more digits"))
        elif (held := _held(effort, q) / evidence.rate) > HELD:
            text = f"The torque is new every {held:.3g} s only, and keeps its value in between."
            findings.append(Finding(CODE, "warning", joint.name, text, "log the torque at the rate of the positions"))
        step = _step(q)
        if step > (COARSE_LENGTH if joint.is_prismatic else COARSE_ANGLE):
            text = f"The position has steps of {step:.3g} {joint.unit}; its derivatives are those of the steps."
            findings.append(Finding(CODE, "warning", joint.name, text, "log the position with more digits"))
    return findings


def _step(x: Array) -> float:
    """Smallest step of a channel (N,) that keeps its value in most rows; 0 if it does not, or if it is constant."""
    steps = np.abs(np.diff(x))
    return smallest_step(steps) if len(steps) and np.mean(steps == 0.0) > STILL else 0.0


def _held(effort: Array, q: Array) -> float:
    """Number of rows for which a torque (N,) keeps each value; 0 if the number varies, or the position does so."""
    new = np.flatnonzero(np.diff(effort))
    if len(new) < UPDATES or np.count_nonzero(np.diff(q)) < OTHERS * len(new):
        return 0.0
    rows = np.diff(new)
    typical = float(np.median(rows))
    return typical if np.mean(np.abs(rows - typical) <= 1.0) >= ALIKE and typical > ROWS else 0.0


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        CODE: "Rounding acts as noise that depends on the motion; intervals are too narrow, and derivatives of "
        "coarse positions are useless.",
    },
    needs_torque=False,
)
