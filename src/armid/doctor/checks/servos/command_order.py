"""Check for commands in another order of joints than the positions."""

from __future__ import annotations

import numpy as np

from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.measurement.remedy_builders import naming

FOLLOWS, ALONE = 0.8, 0.6
"""Correlation from which a joint follows a command, and correlation with its own command up to which it does not."""

AHEAD = 0.3
"""Smallest excess of the correlation with another command."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports joints that follow the command of another joint."""
    response = evidence.response
    if response is None or response.moves.sum() < 2:
        return []
    table, moving = response.table, np.flatnonzero(response.moves)
    strength = table[np.ix_(moving, moving)]
    own = np.diag(strength)
    from scipy.optimize import linear_sum_assignment  # slow to import

    commands, joints = linear_sum_assignment(-strength)
    found = np.empty(len(moving), dtype=np.intp)
    found[joints] = commands
    follows = strength[found, np.arange(len(moving))]
    other = found != np.arange(len(moving))
    wrong = other & (follows > FOLLOWS) & (own < ALONE) & (follows > own + AHEAD)
    if not wrong.any() or not np.array_equal(np.sort(found[wrong]), np.flatnonzero(wrong)):
        return []
    names = [evidence.robot.joint_names[j] for j in moving]
    pairs = "; ".join(
        f"{names[j]} follows the command of {names[found[j]]} (correlation {follows[j]:.2f}, own {own[j]:.2f})"
        for j in np.flatnonzero(wrong)
    )
    order = np.arange(len(evidence.robot.joint_names))
    order[moving[wrong]] = moving[found[wrong]]
    return [Finding("command-order", "error", "command", f"{pairs}.", _remedy(evidence, order))]


def _remedy(evidence: LogEvidence, order: np.ndarray) -> str:
    """Columns of the command in the order of the joints, if the log has one column for each channel."""
    recording, raw = evidence.recording, evidence.raw
    columns = list(raw.columns.get("command", ()))
    aligned = raw.n == len(columns) == len(order) and not evidence.reading.joints
    if aligned and recording is not None and raw.joint_names in ((), recording.joint_names):
        return naming(evidence.reading, {"command": [columns[k] for k in order]})
    names = evidence.robot.joint_names
    wanted = ", ".join(names[k] for k in order)
    return f"rewrite the commands: those logged for {wanted} belong to {', '.join(names)}."


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={"command-order": "Gains and friction of these joints are fitted to the motion of others."},
    untested={"command-order": "the correlations show it without a model"},
    hides=("command-exchanged", "command-units", "command-delay", "command-delay-changes", "servo-saturated"),
    needs_torque=False,
    needs_command=True,
)
