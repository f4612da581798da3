"""Check for commands in another unit, or with another sign, than the positions."""

from __future__ import annotations

import numpy as np

from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding

FOLLOWS = 0.8
"""Correlation from which the scale of a command counts."""

WITHIN = 1.7
"""Factor within which the motion of a joint that follows is that of its command; a soft or slow servo falls short."""

NEAR = 1.35
"""Factor within which a scale is that of a known unit."""

DEGREES = 180.0 / np.pi


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports joints whose position follows the command with another scale."""
    response = evidence.response
    if response is None:
        return []
    names, wrong = evidence.robot.joint_names, dict[int, float]()
    moves = np.ptp(response.command, axis=0) > 0.0
    for j in np.flatnonzero(moves & (np.ptp(response.q, axis=0) > 0.0)):
        if abs(response.table[j, j]) < FOLLOWS:
            continue
        slope = response.slope(int(j))
        if not 1.0 / WITHIN < slope < WITHIN:
            wrong[int(j)] = slope
    if not wrong:
        return []
    scales = ", ".join(f"{names[j]} by {slope:.3g}" for j, slope in wrong.items())
    typical = float(np.median(list(wrong.values())))
    unit = _unit(typical)
    what = f"For one unit of the command the joints move by another amount: {scales}.{unit}"
    remedy = "rewrite the commands in the unit and direction of the positions, radians or degrees for both."
    channel = "command" if len(wrong) == len(names) else ", ".join(names[j] for j in wrong)
    return [Finding("command-units", "error", channel, what, remedy)]


def _unit(slope: float) -> str:
    """Sentence about the unit that a scale suggests."""
    size = abs(slope)
    if 1.0 / NEAR < size * DEGREES < NEAR:
        return " The commands are in degrees and the positions in radians."
    if 1.0 / NEAR < size / DEGREES < NEAR:
        return " The commands are in radians and the positions in degrees."
    if slope < 0.0 and 1.0 / WITHIN < size < WITHIN:
        return " The commands count in the other direction."
    return " The commands may be normalised values, ticks or motor angles."


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={"command-units": "The position error is no error, so stiffness and friction are meaningless."},
    untested={"command-units": "no model is needed to compare a command with its own joint"},
    hides=("servo-saturated",),
    needs_torque=False,
    needs_command=True,
)
