"""Checks of commands, and of the clock for gaps, by the doctor before an identification of servos."""

from __future__ import annotations

from collections.abc import Sequence

from armid.doctor import CHECKS, LogEvidence, examine
from armid.errors import Finding
from armid.measurement.recording import Recording
from armid.robot import Robot
from armid.study.config import RecordingChoice
from armid.study.diagnosis import merged

GAP = "clock-gap"
"""Code of findings about gaps. Uneven steps are not reported, as commands and positions keep their own times."""


def command_findings(robot: Robot, recordings: Sequence[tuple[RecordingChoice, Recording]]) -> list[Finding]:
    """Findings about commands and gaps of all recordings; equal ones on several recordings become one.

    Args:
        robot: The arm.
        recordings: Recordings in the robot's convention, with their options in the study.
    """
    checks = {name: check for name, check in CHECKS.items() if check.needs_command or GAP in check.effects}
    codes = {GAP, *(code for check in checks.values() if check.needs_command for code in check.effects)}
    found = [
        (k, finding)
        for k, (choice, recording) in enumerate(recordings)
        for finding in examine(LogEvidence(robot, recording, choice.reading, recording), checks)
        if finding.code in codes
    ]
    return merged([choice for choice, _ in recordings], found)
