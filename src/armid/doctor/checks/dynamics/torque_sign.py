"""Torque measured against the description's convention, on all joints or on some."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from armid.doctor.evidence import LogEvidence
from armid.doctor.explanation import Explanation, LogState
from armid.doctor.quick_fit import QuickRows, cost_of, make_rows, products
from armid.errors import Finding
from armid.measurement.remedy import lines
from armid.values import Array

__all__ = ["FLIP", "check", "explain", "left_by", "relative", "signs"]

FLIP = 0.05
"""Fall of the residual, as a logarithm, from which another sign of one joint is taken: clean logs show none, and a
wrong sign of a joint that carries others costs a multiple of it."""

CLEAR = 0.2
"""Fall from which signs are believed whatever friction and inertia say of them: of wrong signs it is 0.4 and more, on
a recorded arm with more friction in the wrist than the model has another sign brings 0.06."""

CALM, MOST_TOGETHER = 0.15, 8
"""Conflict from which signs are tried all together, and joints up to which there are few enough of them; where joints
agree, no two of them are wrong."""

SURE = 8.0
"""Standard deviations from which friction that drives, instead of braking, is believed on real logs, whose
friction is none of the model's; controllers that compensate it come to 6."""

ALSO = 0.03
"""Difference of what two signs leave, as a logarithm, below which the log does not say which of them is wrong."""

MOST = 10.0
"""Standard deviations beyond which one joint's friction counts no more than another's."""

ALIKE = 0.8
"""Correlation with the description's torque from which that is a witness."""


def check(evidence: LogEvidence) -> list[Finding]:
    """The finding, if a sign is wrong."""
    return evidence.explained(CODE)


CODE = "torque-sign"


def explain(state: LogState) -> Explanation | None:
    """The signs that explain the log, or `None` if they are those that it has."""
    rows = state.rows
    sign, gain, indifferent = relative(state)
    votes = _votes(state if (sign > 0.0).all() else state.with_torque(sign))
    if votes.sum() < 0.0:
        sign, votes = -sign, -votes
    most = -1.0 if sign[~indifferent].sum() < 0.0 else 1.0
    for j in np.flatnonzero(indifferent):
        kept = sign[j]
        sign[j] = -kept if votes[j] <= -1.0 else kept if votes[j] >= 1.0 else most
        votes[j] *= sign[j] * kept
    wrong = np.flatnonzero(sign < 0.0)
    if not len(wrong) or (gain < CLEAR and votes[wrong].sum() < (1.0 if gain < FLIP else 0.0)):
        return None
    names = state.model.robot.joint_names
    everywhere = len(wrong) == rows.n
    return Explanation(
        CODE,
        max(gain, FLIP),
        "error",
        "" if everywhere else ", ".join(names[j] for j in wrong),
        _evidence(state, wrong, gain) + _doubt(state, sign),
        lambda evidence: lines(torque_sign=signs(np.asarray(evidence.reading.torque_sign) * sign)),
        state.with_torque(sign),
    )


def signs(sign: Array) -> int | list[int]:
    """Signs (n,) as a study has them: one where all are alike."""
    whole = [int(s) for s in sign]
    return whole[0] if len(set(whole)) == 1 else whole


def _evidence(state: LogState, wrong: NDArray[np.intp], gain: float) -> str:
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


def relative(state: LogState) -> tuple[Array, float, NDArray[np.bool_]]:
    """Signs that let one set of parameters fit all joints best, up to one for all, and what they gain.

    The third are the joints whose sign the others say nothing about, shape (n,).
    """
    rows = state.rows
    pairs = products(rows)
    first = cost_of(rows, pairs)
    sign, cost = np.ones(rows.n), first
    if CALM < state.conflict and rows.n <= MOST_TOGETHER:
        together, less = _best_of_all(rows, pairs, first)
        if less < first - FLIP:
            sign, cost = together, less
    while True:
        trials = np.array([cost_of(rows, pairs, _flipped(sign, j)) for j in range(rows.n)])
        best = int(np.argmin(trials))
        if trials[best] > cost - FLIP:
            return sign, first - cost, np.abs(trials - cost) < FLIP
        sign[best], cost = -sign[best], trials[best]


def _best_of_all(rows: QuickRows, pairs: Sequence[Array], first: float) -> tuple[Array, float]:
    """Signs, the first joint's kept, that leave least, and what they leave.

    One after the other does not find them: where several are wrong, the second may only pay with the third.
    """
    best = np.ones(rows.n), first
    for others in product((1.0, -1.0), repeat=rows.n - 1):
        sign = np.array([1.0, *others])
        cost = cost_of(rows, pairs, sign)
        if cost < best[1]:
            best = sign, cost
    return best


def left_by(state: LogState, sign: Array) -> float:
    """Return what is left of the torque with positions of these signs (n,)."""
    rows = make_rows(state.source, state.log.scaled(sign))
    return cost_of(rows, products(rows))


def _doubt(state: LogState, sign: Array) -> str:
    """That positions of the other sign would explain as much, where they would."""
    if (sign < 0.0).all() or left_by(state, sign) > cost_of(state.rows, products(state.rows), sign) + ALSO:
        return ""
    return f" Positions of the other sign, position_sign = {signs(sign)}, would explain as much."


def _flipped(sign: Array, j: int) -> Array:
    other = sign.copy()
    other[j] = -other[j]
    return other


def _votes(state: LogState) -> Array:
    """For each joint how friction, inertia and the description speak for its sign; 1 is sure, -1 against it."""
    votes = (np.clip(state.dissipation, -MOST, MOST) + np.clip(state.inertia, -MOST, MOST) / 2) / SURE
    if state.nominal is not None:
        r = state.nominal.correlation
        votes = votes + np.where(np.abs(r) > ALIKE, 2.0 * np.sign(r), r)
    return votes
