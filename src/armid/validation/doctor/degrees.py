"""Angles in another unit than the study says, where no limit gives it away."""

from __future__ import annotations

import numpy as np

from armid.errors import Finding
from armid.validation.doctor.evidence import Evidence
from armid.validation.doctor.state import Explanation, State

__all__ = ["check", "explain"]

CODE = "degrees"

DEGREES = 180.0 / np.pi

WIDEST, NARROWEST = 7.0, 0.1
"""Largest angle of an arm whose joints turn about once at most, and the largest of one that moves at all [rad]."""

GAIN = 0.3
"""Fall of the residual, as a logarithm, that the other unit must bring: weights change their course with it, and so
do inertias, by a factor 57."""


def check(evidence: Evidence) -> list[Finding]:
    """The finding, if the other unit explains the log."""
    return evidence.explained(CODE)


def explain(state: State) -> Explanation | None:
    """The unit that explains the log, or `None` if it is the one that it is read with."""
    turns = np.array([not joint.is_prismatic for joint in state.model.robot.joints])
    if not turns.any():
        return None
    largest = float(np.abs(state.rows.motion.q[:, turns]).max())
    if largest * DEGREES <= WIDEST:
        factor, said, unit = DEGREES, "degrees", "rad"
    elif largest > WIDEST and largest / DEGREES >= NARROWEST:
        factor, said, unit = 1.0 / DEGREES, "radians", "deg"
    else:
        return None
    after = state.on(state.log.scaled(np.where(turns, factor, 1.0)))
    gain = state.fit.cost - after.fit.cost
    if gain < GAIN:
        return None
    return Explanation(
        CODE,
        gain,
        "error",
        "q",
        f"Read as {said}, no joint turns beyond {largest:.3g} rad; in the other unit {1 - np.exp(-gain):.0%} less of "
        "the torque is left.",
        f'units = "{unit}"',
        after,
    )
