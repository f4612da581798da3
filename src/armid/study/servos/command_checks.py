"""Checks of commands, and of the clock for gaps, by the doctor before an identification of servos."""

from __future__ import annotations

from collections.abc import Sequence

from armid.doctor import CHECKS, LogEvidence, examine
from armid.errors import Finding
from armid.measurement.recording import Recording
from armid.robot import Robot
from armid.study.config import RecordingChoice
from armid.study.diagnosis import merged

GAPS = "clock", "clock-gap"
"""Check of the clock, and code of its findings about gaps. Uneven steps are not reported: commands and positions are
used with their own times."""


def command_findings(robot: Robot, recordings: Sequence[tuple[RecordingChoice, Recording]]) -> list[Finding]:
    """Findings about commands and gaps of all recordings; equal ones on several recordings become one.

    Args:
        robot: The arm.
        recordings: Recordings in the robot's convention, with their options in the study.
    """
    checks = [name for name, check in CHECKS.items() if check.needs_command or name == GAPS[0]]
    found = [
        (k, finding)
        for k, (choice, recording) in enumerate(recordings)
        for finding in examine(LogEvidence(robot, recording, choice.reading, recording), checks)
        if finding.code == GAPS[1] or finding.code not in CHECKS[GAPS[0]].effects
    ]
    return merged([choice for choice, _ in recordings], found)
