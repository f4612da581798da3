"""Channels that are stuck at one value for some time, and standstill of the arm."""

from __future__ import annotations

import numpy as np

from armid.doctor.check_input import LogEvidence
from armid.doctor.log_check import LogCheck
from armid.doctor.stuck_channels import longest
from armid.errors import Finding
from armid.measurement.log_format_remedies import excluding

STANDSTILL = 1.0
"""Shortest standstill of all joints that is reported [s]."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports stuck channels as errors and standstill as information."""
    recording = evidence.recording
    if recording is None or recording.effort is None or recording.consecutive is False:
        return []
    rate = evidence.rate
    findings: list[Finding] = []
    names = evidence.robot.joint_names
    counts = recording.valid[1:].any(axis=1) & recording.valid[:-1].any(axis=1)
    still = longest(np.all(recording.q[1:] == recording.q[:-1], axis=1) & counts)
    seconds = (still[1] - still[0]) / rate
    if seconds >= STANDSTILL:
        findings.append(
            Finding(
                "standstill",
                "info",
                "",
                f"No joint moves for {seconds:.1f} s, rows {still[0]} to {still[1]}.",
                excluding(
                    evidence.reading,
                    [_times(evidence, *still)],
                    "at standstill, static friction and gravity cannot be separated",
                ),
            )
        )
    for j, quantity, a, b in evidence.stuck:
        value = getattr(recording, quantity)[a, j]
        findings.append(
            Finding(
                "channel-dead",
                "error",
                names[j],
                f"{quantity} stays at {value:.6g} for {(b - a) / rate:.2f} s, rows {a} to {b}, while the arm moves. "
                "Check the sensor, the cable and the logger of this channel first.",
                excluding(evidence.reading, [_times(evidence, a, b)], "or record it again"),
            )
        )
    return findings


def _times(evidence: LogEvidence, first: int, last: int) -> tuple[float, float]:
    """Times of a first and a last row on the clock of the recording [s]."""
    recording = evidence.recording
    assert recording is not None
    time = np.arange(recording.samples) / evidence.rate if recording.time is None else recording.time
    return float(time[first]), float(time[min(last, recording.samples - 1)])


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "channel-dead": "The joint's parameters are fitted to values that were not measured.",
    },
    untested={
        "channel-dead": "the rows that it leaves out contain no measurement",
    },
    hides=(
        "contact",
        "temperature-drift",
        "excitation-weak",
        "rotor-inertia-missing",
        "channel-delay",
        "position-offset",
        "velocity-mismatch",
        "period-misaligned",
    ),
    needs_torque=False,
)
