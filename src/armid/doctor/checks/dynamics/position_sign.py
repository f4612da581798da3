"""Positions that count against the description's joints, some of them or one."""

from __future__ import annotations

import numpy as np

from armid.doctor.checks.dynamics.torque_sign import FLIP, left_by, relative, signs
from armid.doctor.evidence import LogEvidence
from armid.doctor.explanation import Explanation, LogState
from armid.doctor.quick_fit import cost_of, products
from armid.errors import Finding
from armid.measurement.remedy import lines
from armid.values import Array

__all__ = ["check", "explain"]

CODE = "position-sign"

GAIN = 0.15
"""Fall of the residual, as a logarithm, that another sign must bring: a joint that carries others brings 0.2 to 3, on
recorded arms with more friction in the wrist than the model has a wrist whose sign is right 0.06 and 0.11."""

HINT, DRIVEN = 0.02, -2.0
"""The same where friction drives the joint as it is logged while it brakes most others, and standard deviations from
which it does; right signs bring up to 0.01."""

BEYOND = 0.015
"""What it must bring beyond other signs of the torque, which are more common and nearly the same where a joint
carries little, as a logarithm."""

LOOKED_AT, NEAR = 2, 0.05
"""Joints that are looked at closely: the best of those that were tried quickly, if they leave no more than the signs
as they are by a margin."""

MOST = 3
"""Joints that are turned one after the other."""


def check(evidence: LogEvidence) -> list[Finding]:
    """The finding, if another sign explains the log."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """The signs that explain the log, or `None` if they are those that it has."""
    n = state.rows.n
    rough = state.on(state.log.coarse())
    sign, cost = np.ones(n), cost_of(state.rows, products(state.rows))
    near = cost_of(rough.rows, products(rough.rows)) + NEAR
    for _ in range(min(MOST, n)):
        trials = [(left_by(rough, _turned(sign, j)), j) for j in range(n)]
        close = [_turned(sign, j) for left, j in sorted(trials)[:LOOKED_AT] if left < near]
        costs = [left_by(state, trial) for trial in close]
        if min(costs, default=np.inf) > cost - HINT:
            break
        sign, cost = close[int(np.argmin(costs))], min(costs)
    wrong = np.flatnonzero(sign < 0.0)
    if not len(wrong):
        return None
    after = state.on(state.log.scaled(sign))
    gain = state.fit.cost - after.fit.cost
    braking = state.dissipation
    driven = bool((braking[wrong] < DRIVEN).all()) and float(np.median(braking)) > 0.0
    if gain < (HINT if driven else GAIN):
        return None
    by_torque = relative(state)[1]
    if gain < by_torque + BEYOND:
        return None
    names = ", ".join(state.model.robot.joint_names[j] for j in wrong)
    return Explanation(
        CODE,
        gain - by_torque + max(by_torque, FLIP),  # as signs of the torque count themselves
        "error",
        names,
        f"With positions of {names} counted the other way one set of parameters leaves {1 - np.exp(-gain):.0%} "
        "less of the torque.",
        lambda evidence: lines(position_sign=signs(np.asarray(evidence.reading.position_sign) * sign)),
        after,
    )


def _turned(sign: Array, j: int) -> Array:
    other = sign.copy()
    other[j] = -other[j]
    return other
