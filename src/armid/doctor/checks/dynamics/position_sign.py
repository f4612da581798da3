"""Check for positions of joints whose sign is opposite to that of the description."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.checks.dynamics.torque_sign import FLIP, cost_with_signs, relative_signs, signs_value
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import cost_of, products
from armid.doctor.remedy_trial import HELPS
from armid.errors import Finding
from armid.maths.median import median
from armid.measurement.remedy_builders import lines

CODE = "position-sign"

GAIN = 0.15
"""Smallest decrease of the mean logarithm of the RMS residuals for another sign. Correcting a wrong sign of a joint
that carries others gives 0.2 to 3; on recorded arms with unmodelled wrist friction, changing a right sign of the
wrist gave 0.06 and 0.11."""

HINT, DRIVEN = 0.02, -2.0
"""Smallest decrease if the friction of the joint, as logged, is negative while the friction of most other joints is
positive, and multiple of the standard deviation below which it counts as negative. Right signs give up to 0.01."""

BEYOND = 0.015
"""Smallest amount by which other signs of the positions must decrease the residual more than other signs of the
torque do. Wrong signs of the torque are more common, and they have nearly the same effect if a joint carries little
mass."""

LOOKED_AT, NEAR = 2, 0.05
"""Number of joints that are fitted to all rows, chosen by a quick fit, and margin by which the residual of that fit
may exceed that of the logged signs."""

MOST = 3
"""Largest number of joints whose sign is changed one after the other."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports joints with wrong signs of the positions, if the model fits the log better with other signs."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by wrong signs of positions; `None` if the signs are right."""
    n = state.rows.n
    rough = state.on(state.log.coarse())
    sign, cost = np.ones(n), cost_of(state.rows, products(state.rows))
    near = cost_of(rough.rows, products(rough.rows)) + NEAR
    for _ in range(min(MOST, n)):
        trials = [(cost_with_signs(rough, _turned(sign, j)), j) for j in range(n)]
        close = [_turned(sign, j) for left, j in sorted(trials)[:LOOKED_AT] if left < near]
        costs = [cost_with_signs(state, trial) for trial in close]
        if min(costs, default=np.inf) > cost - HINT:
            break
        sign, cost = close[int(np.argmin(costs))], min(costs)
    wrong = np.flatnonzero(sign < 0.0)
    if not len(wrong):
        return None
    after = state.on(state.log.scaled(sign))
    gain = state.fit.cost - after.fit.cost
    braking = state.dissipation
    driven = bool((braking[wrong] < DRIVEN).all()) and float(median(braking)) > 0.0
    if gain < (HINT if driven else GAIN):
        return None
    by_torque = relative_signs(state)[1]
    if gain < by_torque + BEYOND:
        return None
    names = ", ".join(state.model.robot.joint_names[j] for j in wrong)
    return Explanation(
        CODE,
        gain - by_torque + max(by_torque, FLIP),  # comparable with the gain of the torque's signs
        "error",
        names,
        f"With the opposite sign of the positions of {names}, the residual of one model for all joints is "
        f"{1 - np.exp(-gain):.0%} smaller.",
        lambda evidence: lines(position_sign=signs_value(np.asarray(evidence.reading.position_sign) * sign)),
        after,
        worse=HELPS,
    )


def _turned(sign: Array, j: int) -> Array:
    other = sign.copy()
    other[j] = -other[j]
    return other


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        "position-sign": "Gravity and coupling torques of the joint and of the links that it carries are "
        "fitted at mirrored poses.",
    },
    explain=explain,
)
