"""Torque measured against the description's convention, on all joints or on some."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.errors import Finding
from armid.validation.doctor.evidence import Evidence
from armid.validation.doctor.rows import Rows, cost_of, products
from armid.validation.doctor.state import Explanation, State
from armid.values import Array

__all__ = ["check", "explain"]

FLIP = 0.05
"""Fall of the residual, as a logarithm, from which another sign of one joint is taken: clean logs show none, and a
wrong sign of a joint that carries others costs a multiple of it."""

INDIFFERENT = 0.02
"""Change of the residual below which the other joints say nothing about the sign of one, as at the last joint."""

SURE = 8.0
"""Standard deviations from which friction that drives, instead of braking, is believed on real logs, whose
friction is none of the model's; controllers that compensate it come to 6."""

MOST = 10.0
"""Standard deviations beyond which one joint's friction counts no more than another's."""

ALIKE = 0.8
"""Correlation with the description's torque from which that is a witness."""


def check(evidence: Evidence) -> list[Finding]:
    """The finding, if a sign is wrong."""
    return evidence.explained(CODE)


CODE = "torque-sign"


def explain(state: State) -> Explanation | None:
    """The signs that explain the log, or `None` if they are those that it has."""
    rows = state.rows
    sign, gain, indifferent = _relative(rows)
    votes = _votes(state if (sign > 0.0).all() else state.with_torque(sign))
    if votes.sum() < 0.0:
        sign, votes = -sign, -votes
    for j in np.flatnonzero(indifferent):
        if votes[j] <= -1.0:
            sign[j] = -sign[j]
    if (sign > 0.0).all() or (gain < FLIP and votes.sum() < 1.0):
        return None
    wrong = np.flatnonzero(sign < 0.0)
    names = state.model.robot.joint_names
    everywhere = len(wrong) == rows.n
    value = "-1" if everywhere else "[" + ", ".join(f"{int(s)}" for s in sign) + "]"
    return Explanation(
        CODE,
        max(gain, FLIP),
        "error",
        "" if everywhere else ", ".join(names[j] for j in wrong),
        _evidence(state, wrong, gain),
        f"torque_sign = {value}",
        state.with_torque(sign),
    )


def _evidence(state: State, wrong: NDArray[np.intp], gain: float) -> str:
    z = state.dissipation[wrong]
    worst = int(wrong[np.argmin(z)])
    text = f"As logged, friction drives {state.model.robot.joint_names[worst]} ({z.min():.0f} standard deviations)"
    if gain >= FLIP:
        text += f"; with other signs the residual of all joints falls by {1 - np.exp(-gain):.0%}"
    if state.nominal is not None:
        j = int(np.argmax(np.where(np.isin(np.arange(state.rows.n), wrong), state.nominal.size, -1.0)))
        text += (
            f"; torque of {state.model.robot.joint_names[j]} against the description's has correlation "
            f"{state.nominal.correlation[j]:.2f}"
        )
    return f"{text}."


def _relative(rows: Rows) -> tuple[Array, float, NDArray[np.bool_]]:
    """Signs that let one set of parameters fit all joints best, up to one for all, and what they gain.

    The third are the joints whose sign the others say nothing about, shape (n,).
    """
    sign, pairs = np.ones(rows.n), products(rows)
    first = cost = cost_of(rows, pairs)
    while True:
        trials = np.array([cost_of(rows, pairs, _flipped(sign, j)) for j in range(rows.n)])
        best = int(np.argmin(trials))
        if trials[best] > cost - FLIP:
            return sign, first - cost, np.abs(trials - cost) < INDIFFERENT
        sign[best], cost = -sign[best], trials[best]


def _flipped(sign: Array, j: int) -> Array:
    other = sign.copy()
    other[j] = -other[j]
    return other


def _votes(state: State) -> Array:
    """For each joint how friction, inertia and the description speak for its sign; 1 is sure, -1 against it."""
    votes = (np.clip(state.dissipation, -MOST, MOST) + np.clip(state.inertia, -MOST, MOST) / 2) / SURE
    if state.nominal is not None:
        r = state.nominal.correlation
        votes = votes + np.where(np.abs(r) > ALIKE, 2.0 * np.sign(r), r)
    return votes
