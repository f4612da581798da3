"""Check for servos that do not follow their commands: dead, at a limit, or with a limited position error."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.measurement.remedy_builders import lines

ASKED = 0.1
"""Range of a command from which a joint must follow [rad or m]."""

FOLLOWED = 0.05
"""Share of the range of its command that a dead joint moves at most."""

FOLLOWS = 0.8
"""Correlation from which a joint follows its command, though in another unit."""

FEWEST, SHARE = 15, 0.03
"""Smallest number and share of rows at a limit."""

LEVEL = 5e-3
"""Largest difference from a limit, over the range."""

BEYOND, FAR = 0.2, 0.15
"""Distance of the command from a position at which a joint stops, and change of the command meanwhile: over the range
of the command, and at least [rad or m]. A servo that is stuck by dry friction stays closer."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports servos that do not move, that stop at a position, and position errors that are limited."""
    response, recording = evidence.response, evidence.recording
    if response is None or recording is None:
        return []
    found: list[Finding] = []
    for j, name in enumerate(evidence.robot.joint_names):
        command, q = response.command[:, j], response.q[:, j]
        asked, done = np.ptp(command), np.ptp(q)
        if asked < ASKED:
            continue
        if done < FOLLOWED * asked and abs(response.table[j, j]) < FOLLOWS:
            what = f"The command of {name} moves by {asked:.3g}, and the joint by {done:.3g}."
            remedy = "check the servo, its cable and its torque switch, or lock the joint: --lock " + name + "."
            found.append(Finding("servo-dead", "error", name, what, remedy))
            continue
        stop = _stop(command, q, asked)
        limited = _limited(command, q)
        if stop is not None:
            place, share = stop
            what = f"{name} stops at {place:.4g} in {share:.0%} of the rows, while its command is further on."
            remedy = "record a motion inside the range of the joint, or leave these rows out (`exclude`)."
            found.append(Finding("servo-saturated", "warning", name, what, remedy))
        elif limited is not None:
            size, share = limited
            what = f"The position error of {name} is ±{size:.4g} in {share:.0%} of the rows: it is limited."
            remedy = "log the command before it is limited, and state the largest torque of the servo: " + lines(
                table="servo", limit=1.0
            ).replace("1.0", "…")
            found.append(Finding("servo-saturated", "warning", name, what, remedy))
    return found


def _stop(command: Array, q: Array, asked: float) -> tuple[float, float] | None:
    """Position at which a joint stays although its command moves on, and the share of the rows."""
    beyond = max(BEYOND * asked, FAR)
    for end, ahead in ((q.max(), command - q), (q.min(), q - command)):
        rows = (np.abs(q - end) <= LEVEL * np.ptp(q)) & (ahead > beyond)
        if rows.sum() >= max(FEWEST, SHARE * len(q)) and np.ptp(command[rows]) > 0.5 * beyond:
            return float(end), float(rows.mean())
    return None


def _limited(command: Array, q: Array) -> tuple[float, float] | None:
    """Largest position error, and the share of the rows at it, if it stays the same while the command changes."""
    error = command - q
    size = float(np.abs(error).max())
    rows = np.abs(error) >= (1.0 - LEVEL) * size
    steady = rows.sum() < max(FEWEST, SHARE * len(error)) or np.ptp(command[rows]) < size
    if size > 0.0 and not steady:
        return size, float(rows.mean())
    return None


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "servo-dead": "A joint that does not move shows nothing, and its position error is no torque.",
        "servo-saturated": "The torque at the limit is smaller than the position error says, so the stiffness is too "
        "small.",
    },
    untested=dict.fromkeys(("servo-dead", "servo-saturated"), "only another motion or a repair removes the fault"),
    needs_torque=False,
    needs_command=True,
)
