"""Findings about servos of a description of which armid does not use all that is stated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.errors import Finding
from armid.robot import Robot
from armid.servo.servo_run import ServoRun


def described_servo_findings(robot: Robot, runs: Sequence[ServoRun]) -> list[Finding]:
    """Findings about damping ratios, ranges of commands that recorded commands leave, and further actuators.

    Args:
        robot: The arm.
        runs: Runs with the recorded commands.
    """
    servos = [(j, joint.name, joint.drive.servo) for j, joint in enumerate(robot.joints)]
    known = [(j, name, servo) for j, name, servo in servos if servo is not None]
    found: list[Finding] = []
    ratios = [name for _, name, servo in known if servo.damping_ratio > 0.0]
    if ratios:
        what = (
            f"the damping of the servos of {', '.join(ratios)} is stated by a ratio (dampratio), which depends on "
            "the mass matrix in MuJoCo; the description is compared without this damping"
        )
        remedy = "state the damping as kv, so that the comparison with the description is that of MuJoCo"
        found.append(Finding("servo-damping-ratio", "warning", "", what, remedy))
    several = [f"{name} ({servo.actuators})" for _, name, servo in known if servo.actuators > 1]
    if several:
        what = f"several actuators act on {', '.join(several)}; only the first position servo of a joint is used"
        remedy = "leave one actuator for each joint, so that the comparison with the description is that of MuJoCo"
        found.append(Finding("servo-several-actuators", "warning", "", what, remedy))
    beyond: list[str] = []
    for j, name, servo in known:
        low, high = servo.command_range or (-np.inf, np.inf)
        ends = [(float(run.command[:, j].min()), float(run.command[:, j].max())) for run in runs]
        least, most = min(a for a, _ in ends), max(b for _, b in ends)
        if least < low or most > high:
            beyond.append(f"{name} ({least:.3g} … {most:.3g} beside {low:.3g} … {high:.3g})")
    if beyond:
        what = (
            "recorded commands leave the range that the description states for them (ctrlrange): "
            f"{', '.join(beyond)}; they are simulated as recorded"
        )
        remedy = "correct the range in the description, or check the units and the zero of the commands"
        found.append(Finding("servo-command-range", "warning", "", what, remedy))
    return found
