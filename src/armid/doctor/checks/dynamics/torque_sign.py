"""Check for torques of joints whose sign is opposite to the convention of the description."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.changes.lost_signs import LostSigns, lost_signs
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import QuickRows, cost_of, make_rows, products
from armid.doctor.remedy_trial import CERTAIN, WORSE
from armid.errors import Finding
from armid.measurement.remedy_builders import lines

FLIP = 0.05
"""Decrease of the mean logarithm of the RMS residuals from which another sign of one joint is accepted. In logs
without fault there is no decrease; a wrong sign of a joint that carries others gives several times as much."""

CLEAR = 0.2
"""Decrease from which signs are accepted without support by friction and inertia. Wrong signs give 0.4 or more; on a
recorded arm with unmodelled wrist friction, changing a right sign gave 0.06."""

CALM, MOST_TOGETHER = 0.15, 8
"""Conflict from which all combinations of signs are tried, and largest number of joints for which this is done. If
the joints agree, either all signs are right or all are wrong."""

SURE = 8.0
"""Number of standard deviations from which negative friction is significant. In real logs, friction differs from the
model; with controllers that compensate friction, the number reaches 6 although the sign is right."""

NEGATIVE = 20.0
"""Number of standard deviations from which negative friction of all joints concerned leaves no doubt."""

ALSO = 0.03
"""Difference of the mean logarithms of the RMS residuals for two signs, below which the log does not show which of
them is wrong."""

MOST = 10.0
"""Largest number of standard deviations that the friction of one joint may contribute to the evidence."""

ALIKE = 0.8
"""Correlation with the torque of the description from which the description counts as evidence."""


NEAR_ZERO, TOUCHES, STEEP = 0.03, 4, 0.4
"""Share of the largest torque below which a torque counts as zero, smallest number of times at which a torque of one
sign comes to zero and turns back, and smallest slope there, relative to the usual one, from which its sign is
missing. The slope of a torque with its sign falls to zero where it turns back. Of 105 torques in 16 recordings of
eight arms, five have one sign; two of them, of a wrist, come to zero once and three times, the others stay above 0.11
of the largest torque."""

MOSTLY = 0.5
"""Share of the samples near zero from which a torque shows no sign. It is at most 0.02 for these five torques."""

LISTED = 6
"""Largest number of times that are listed."""

SMOOTHED = 0.1
"""Time over which such a torque is averaged, against noise [s]."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports joints with a wrong sign of the torque, or whose torque has no sign, or lacks it in some rows."""
    lost = [] if evidence.recording is None else lost_signs(evidence.recording)
    names = {evidence.robot.joint_names[each.joint] for each in lost}
    # A sign that is missing in some rows looks like a wrong sign of the joint or of all joints.
    explained = evidence.explained(CODE)
    if lost:
        explained = [each for each in explained if each.channel and each.channel not in names]
    return [*explained, *_without_sign(evidence), *(_lost(evidence, each) for each in lost)]


def _lost(evidence: LogEvidence, each: LostSigns) -> Finding:
    """Finding on a torque that lacks its sign in some rows."""
    recording, joint = evidence.recording, evidence.robot.joints[each.joint]
    assert recording is not None
    time = np.arange(recording.samples) / evidence.rate if recording.time is None else recording.time
    times = ", ".join(f"{float(time[row]):.2f}" for row in each.rows[:LISTED])
    more = "" if len(each.rows) <= LISTED else f" and {len(each.rows) - LISTED} more"
    text = (
        f"The torque of {joint.name} changes its sign from one row to the next, while its amount goes on and the "
        f"joint moves on, at t = {times}{more} s; its amount there is {each.smallest:.3g} {joint.effort_unit} or "
        "more. The sign is missing in some rows."
    )
    return Finding(
        CODE,
        "error",
        joint.name,
        text,
        "find out where the minus sign is lost (a field that is too narrow, an amount, a number without a sign) and "
        "log the torque with its sign",
    )


def _without_sign(evidence: LogEvidence) -> list[Finding]:
    """Reports torques that come to zero several times, at a slope, and never change their sign."""
    recording = evidence.recording
    if recording is None or recording.effort is None or recording.consecutive is False:
        return []
    findings: list[Finding] = []
    for j, joint in enumerate(evidence.robot.joints):
        torque = recording.effort[recording.valid[:, j], j]
        if not len(torque) or (torque.min() < 0.0 < torque.max()):
            continue
        rows = max(1, round(SMOOTHED * evidence.rate))
        amount = np.convolve(np.abs(torque), np.full(rows, 1.0 / rows), mode="valid")
        low = amount < NEAR_ZERO * amount.max()
        edges = np.flatnonzero(np.diff(np.concatenate([[0], low.astype(np.int8), [0]]))).reshape(-1, 2)
        inside = [(a, b) for a, b in edges if a > 0 and b < len(amount)]
        if len(inside) < TOUCHES or low.mean() > MOSTLY or not _turns_sharply(amount, inside):
            continue
        text = (
            f"The torque of {joint.name} comes to zero {len(inside)} times, but never changes its sign: amounts "
            "without signs were logged."
        )
        findings.append(Finding(CODE, "error", joint.name, text, "log the torque with its sign"))
    return findings


def _turns_sharply(amount: Array, inside: Sequence[tuple[int, int]]) -> bool:
    """True if an amount (N,) falls to zero and rises again about as fast as it changes elsewhere.

    Args:
        amount: Amount of a torque.
        inside: First row and row after the last one of each segment near zero.
    """
    rows = max(3, int(np.median([b - a for a, b in inside])))
    usual = float(np.median(np.abs(amount[rows:] - amount[:-rows])))
    wide = [(a, b) for a, b in inside if a >= rows and b + rows <= len(amount)]
    falls = [min(amount[a - rows] - amount[a], amount[b + rows - 1] - amount[b - 1]) for a, b in wide]
    return bool(falls) and float(np.median(falls)) > STEEP * usual


CODE = "torque-sign"


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by wrong signs of torques; `None` if the signs are right."""
    rows = state.rows
    sign, gain, indifferent = relative_signs(state)
    votes = _votes(state if (sign > 0.0).all() else state.with_torque(sign))
    if votes.sum() < 0.0:
        sign, votes = -sign, -votes
    most = -1.0 if sign[~indifferent].sum() < 0.0 else 1.0
    for j in np.flatnonzero(indifferent):
        before = sign[j]
        sign[j] = -before if votes[j] <= -1.0 else before if votes[j] >= 1.0 else most
        votes[j] *= sign[j] * before
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
        lambda evidence: lines(torque_sign=signs_value(np.asarray(evidence.reading.torque_sign) * sign)),
        state.with_torque(sign),
        worse=CERTAIN if (state.dissipation[wrong] < -NEGATIVE).all() else WORSE,
    )


def signs_value(sign: Array) -> int | list[int]:
    """Value of a key of the study for the signs (n,): one number if all signs are equal, otherwise a list."""
    whole = [int(s) for s in sign]
    return whole[0] if len(set(whole)) == 1 else whole


def _evidence(state: LogState, wrong: NDArray[np.intp], gain: float) -> str:
    z = state.dissipation[wrong]
    worst = int(wrong[np.argmin(z)])
    names = state.model.robot.joint_names
    text = f"With the logged signs, the friction of {names[worst]} is negative ({z.min():.0f} standard deviations)"
    if gain >= FLIP:
        text += f"; with other signs, the residual of all joints is {1 - np.exp(-gain):.0%} smaller"
    if state.nominal is not None:
        j = int(np.argmax(np.where(np.isin(np.arange(state.rows.n), wrong), state.nominal.size, -1.0)))
        text += (
            f"; the correlation of the torque of {names[j]} with the torque of {state.reference} is "
            f"{state.nominal.correlation[j]:.2f}"
        )
    return f"{text}."


def relative_signs(state: LogState) -> tuple[Array, float, NDArray[np.bool_]]:
    """Relative signs of the torques with which one model fits all joints best, and the decrease of `QuickFit.cost`.

    The common sign remains unknown. The third value, shape (n,), flags the joints whose sign relative to the others
    cannot be determined.
    """
    rows = state.rows
    pairs = products(rows)
    begin = cost_of(rows, pairs)
    sign, cost = np.ones(rows.n), begin
    if CALM < state.conflict and rows.n <= MOST_TOGETHER:
        together, less = _best_of_all(rows, pairs, begin)
        if less < begin - FLIP:
            sign, cost = together, less
    while True:
        trials = np.array([cost_of(rows, pairs, _flipped(sign, j)) for j in range(rows.n)])
        best = int(np.argmin(trials))
        if not trials[best] <= cost - FLIP:  # also where costs are not finite
            return sign, begin - cost, np.abs(trials - cost) < FLIP
        sign[best], cost = -sign[best], trials[best]


def _best_of_all(rows: QuickRows, pairs: Sequence[Array], first: float) -> tuple[Array, float]:
    """Signs (n,) of the torques with the smallest cost (`QuickFit.cost`), and this cost; the first sign is fixed.

    All combinations are tried: if several signs are wrong, a change of only one sign may not reduce the residual.
    """
    best = np.ones(rows.n), first
    for others in product((1.0, -1.0), repeat=rows.n - 1):
        sign = np.array([1.0, *others])
        cost = cost_of(rows, pairs, sign)
        if cost < best[1]:
            best = sign, cost
    return best


def cost_with_signs(state: LogState, sign: Array) -> float:
    """Mean logarithm of the RMS residuals, with the motion of each joint multiplied by a sign.

    `sign` has shape (n,).
    """
    rows = make_rows(state.source, state.log.scaled(sign))
    return cost_of(rows, products(rows))


def _doubt(state: LogState, sign: Array) -> str:
    """Sentence that the model fits equally well with other signs of the positions; empty if it fits less well."""
    if (sign < 0.0).all() or cost_with_signs(state, sign) > cost_of(state.rows, products(state.rows), sign) + ALSO:
        return ""
    return (
        " The model would fit the log equally well with the opposite sign of positions, position_sign = "
        f"{signs_value(sign)}."
    )


def _flipped(sign: Array, j: int) -> Array:
    other = sign.copy()
    other[j] = -other[j]
    return other


def _votes(state: LogState) -> Array:
    """Evidence for the torque sign of each joint, shape (n,): above 1 the sign is right, below -1 it is wrong.

    The evidence comes from the signs of friction and inertia, and from the torque of the description.
    """
    votes = (np.clip(state.dissipation, -MOST, MOST) + np.clip(state.inertia, -MOST, MOST) / 2) / SURE
    if state.nominal is not None:
        r = state.nominal.correlation
        votes = votes + np.where(np.abs(r) > ALIKE, 2.0 * np.sign(r), r)
    return votes


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        "torque-sign": "All parameters have the wrong sign: negative friction and negative masses.",
    },
    explain=explain,
)
