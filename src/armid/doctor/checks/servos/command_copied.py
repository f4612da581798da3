"""Check for commands that are no commands: copies of the measured position, or a constant."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.doctor.command_response import MOVES
from armid.errors import Finding
from armid.measurement.recording import select_rows
from armid.notebook_display import plural

SHIFTS = 5
"""Largest number of rows by which a copy may be shifted."""

EQUAL = 2e-5
"""Largest difference of equal values, over the range of the position: single precision, and conversions of units."""

SHARE = 0.9
"""Share of the rows with motion in which command and position must be equal; coarse encoders give the command's value
in a few rows."""

STEADY = 1e-6
"""Range of a command below which it is constant [rad or m]."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports commands that are equal to positions, and commands that are constant while the joint moves."""
    recording = evidence.recording
    if recording is None or recording.command is None or recording.consecutive is False:
        return []
    names = evidence.robot.joint_names
    keep = np.asarray(recording.valid.all(axis=1) & np.isfinite(recording.q).all(axis=1), dtype=np.bool_)
    recording = select_rows(recording, keep)
    if recording.command is None or recording.samples < 2:
        return []
    moving = [j for j in range(recording.n) if np.ptp(recording.q[:, j]) > MOVES]
    copies: dict[int, list[str]] = {}
    findings: list[Finding] = []
    for j in moving:
        q, command = recording.q[:, j], recording.command[:, j]
        if not np.isfinite(command).any():
            continue
        if np.nanmax(command) - np.nanmin(command) < STEADY:
            what = f"The command of {names[j]} stays at {command[0]:.4g} while the joint moves by {np.ptp(q):.3g}."
            remedy = "find out which column is the command, or record the motion again with the command that is sent."
            findings.append(Finding("command-constant", "error", names[j], what, remedy))
            continue
        shift = _copied(q, command)
        if shift is not None:
            copies.setdefault(shift, []).append(names[j])
    for shift, joints in copies.items():
        when = "later" if shift > 0 else "earlier"
        rows = f", {plural(abs(shift), 'row')} {when}" if shift else ""
        what = f"The command is the measured position{rows}, so it was filled in after the fact."
        remedy = "record the motion again with the command that the program sends to the servos."
        channel = "command" if len(joints) == len(moving) else ", ".join(joints)
        findings.append(Finding("command-copied", "error", channel, what, remedy))
    return findings


def _copied(q: Array, command: Array) -> int | None:
    """Number of rows by which the command is the later position, if they are equal; `None` if they are not."""
    for shift in sorted(range(-SHIFTS, SHIFTS + 1), key=abs):
        begin, end = max(0, -shift), len(q) - max(0, shift)
        a, b = command[begin:end], q[begin + shift : end + shift]
        moved = np.append(np.diff(b) != 0.0, False)
        if moved.sum() >= 20 and np.mean(np.abs(a - b)[moved] <= EQUAL * np.ptp(q)) >= SHARE:
            return shift
    return None


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "command-copied": "A servo without any position error shows neither its gains nor friction.",
        "command-constant": "The position error of the joint is its motion, so its gains are meaningless.",
    },
    untested=dict.fromkeys(("command-copied", "command-constant"), "only a new recording removes the fault"),
    hides=("command-exchanged", "command-delay", "command-delay-changes", "command-units"),
    needs_torque=False,
    needs_command=True,
)
