"""Check for efforts without a sign: amounts of current or load, as hobby servos report them."""

from __future__ import annotations

import numpy as np

from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.measurement.recording import select_rows
from armid.measurement.remedy_builders import naming

MOVES = 0.05
"""Range of a position from which a joint counts as moving [rad or m]."""

FEWEST = 3
"""Smallest number of moving joints."""

REVERSALS, BACK = 2, 0.1
"""Smallest number of reversals of a joint, and the way back over its range; friction changes its sign at each."""

NEAR_ZERO = 0.05
"""Smallest effort over the largest one of a joint that would have changed its sign; one joint must be such."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports efforts that are never negative, or never positive, although the joints move in both directions."""
    recording = evidence.recording
    if recording is None or recording.effort is None:
        return []
    keep = np.asarray(recording.valid.all(axis=1) & np.isfinite(recording.q).all(axis=1), dtype=np.bool_)
    recording = select_rows(recording, keep)
    if recording.effort is None or recording.samples < 2:
        return []
    moving = [j for j in range(recording.n) if _reverses(recording.q[:, j]) and np.ptp(recording.effort[:, j]) > 0.0]
    if len(moving) < FEWEST:
        return []
    efforts = recording.effort[:, moving]
    low, high = np.nanmin(efforts, axis=0), np.nanmax(efforts, axis=0)
    near, far = np.minimum(np.abs(low), np.abs(high)), np.maximum(np.abs(low), np.abs(high))
    if not ((low >= 0.0) | (high <= 0.0)).all() or not (near < NEAR_ZERO * far).any():
        return []
    what = (
        f"The effort of all {len(moving)} joints that move never changes its sign, although they move in both "
        "directions: it is an amount, as of current or load, and no torque."
    )
    remedy = naming(evidence.reading, {"effort": ""}, "armid servo identifies the arm from commands and positions")
    return [Finding("effort-unsigned", "error", "effort", what, remedy)]


def _reverses(q: np.ndarray) -> bool:
    """True if a position moves up and down again, several times."""
    span = np.ptp(q)
    if not span > MOVES:
        return False
    turns, last, direction = 0, q[0], 0.0
    for x in q[:: max(1, len(q) // 2000)]:
        if direction >= 0.0 and x < last - BACK * span:
            turns, last, direction = turns + (direction > 0.0), x, -1.0
        elif direction <= 0.0 and x > last + BACK * span:
            turns, last, direction = turns + (direction < 0.0), x, 1.0
        elif direction * (x - last) > 0.0:
            last = x
    return turns >= REVERSALS


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={"effort-unsigned": "All parameters are wrong, because half of the torques have the wrong sign."},
    untested={"effort-unsigned": "without torques there is nothing to compare with the prediction"},
    hides=(
        "torque-sign",
        "position-sign",
        "joint-order",
        "gravity-direction",
        "position-offset",
        "torque-gain",
        "residual-large",
        "description-does-not-match",
        "friction-negative",
        "contact",
        "changes-midway",
        "cross-talk",
        "friction-missing",
        "residual-by-angle",
        "channel-delay",
        "rotor-inertia-missing",
    ),
    needs_torque=False,
)
