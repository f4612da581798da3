"""Moments in which the arm touched something: bursts of what the model leaves."""

from __future__ import annotations

import numpy as np

from armid.errors import Finding
from armid.validation.doctor.evidence import Evidence
from armid.validation.doctor.state import State
from armid.values import Array

__all__ = ["check"]

WINDOW = 0.5
"""Seconds over which the residual is averaged: as long as a push lasts."""

BURST = 8.0
"""Residual of several joints over its usual size that no friction explains on recorded arms."""

USUAL = 85.0
"""Percentile of the local residual that is its usual size: an arm that rests half of the time, or begins with
another motion than it goes on with, is not in contact for the rest."""

JOINTS = 2
"""Joints that must feel it."""

LONGEST = 0.25
"""Share of a log in bursts from which they are no bursts but how the arm is."""


def check(evidence: Evidence) -> list[Finding]:
    """One finding for the strongest burst."""
    state = evidence.understood
    if state is None or state.log.band.is_open:
        return []
    size = _bursts(state)
    level = np.sort(size, axis=1)[:, -JOINTS]
    hit = level > BURST
    if not hit.any() or hit.mean() > LONGEST:
        return []
    peak = int(np.argmax(level))
    time = state.rows.motion.time
    inside = hit & (np.abs(time - time[peak]) < 4 * WINDOW)
    low, high = float(time[inside].min()), float(time[inside].max())
    felt = np.flatnonzero(size[peak] > BURST / 2)
    names = evidence.robot.joint_names
    return [
        Finding(
            "contact",
            "warning",
            ", ".join(names[j] for j in felt),
            f"At t = {time[peak]:.2f} s the model leaves {size[peak].max():.0f} times what it usually leaves, on "
            f"{len(felt)} joints together.",
            f"exclude = [[{low - WINDOW:.2f}, {high + WINDOW:.2f}]]",
        )
    ]


def _bursts(state: State) -> Array:
    """Local size of each joint's residual over its usual one, shape (M, n)."""
    rows = state.rows
    wide = max(1, round(WINDOW * rows.rate))
    power = np.empty_like(rows.torque)
    for j in range(rows.n):
        power[:, j] = np.convolve(state.fit.residual[:, j] ** 2, np.ones(wide) / wide, mode="same")
    counted = [power[rows.mask[:, j], j] for j in range(rows.n)]
    usual = np.array([np.percentile(x, USUAL) if len(x) else 1.0 for x in counted])
    return np.sqrt(power / np.maximum(usual, np.finfo(float).tiny))
