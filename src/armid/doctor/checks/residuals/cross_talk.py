"""Check for a torque that contains a share of the torque of another joint, or is that torque.

Crosstalk between channels, a coupling of drives that the log format does not state, or a channel that was logged
twice adds a multiple of one measured torque to another one. The model cannot follow it, because the friction and
the weight of the other joint do not depend on the motion in the way in which the torque of the joint does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import solve
from armid.doctor.remedy_trial import HELPS, RemedyTrial, heldout_error, try_remedy
from armid.doctor.residuals.added_columns import AddedColumns
from armid.doctor.rows_away_from_reversals import judged_away_from_reversals
from armid.errors import Finding

CODE = "cross-talk"

EXPLAINED = 0.7
"""Smallest decrease of the squared residual by the torque of another joint, relative to the squared residual of the
joint. On 16 recordings of eight arms it is at most 0.67; a share of 0.3 of another torque gives 0.7 to 3."""

GAIN = 0.09
"""Smallest decrease of the mean logarithm of the RMS residuals for a positive share. On recorded arms without this
fault it is at most 0.071."""

GAIN_OF_NEGATIVE = 0.14
"""Smallest decrease for a negative share, which only a coupling of drives causes. On a recorded arm whose first
joints have opposite errors of geometry it is 0.105."""

SURE = 8.0
"""Smallest number of standard deviations by which the share must differ from zero."""

CALM = 0.8
"""Share of the rows with the smallest residuals, on which the share of the torque is estimated once more. A
contact of the arm resembles crosstalk in a few rows only; a joint that sticks, near its reversals only."""

CALM_GAIN, AWAY_GAIN = 0.4, 0.3
"""Smallest decrease of the mean logarithm of the RMS residuals on the calm rows, and on rows away from reversals,
relative to that on all rows."""

LOOKED_AT = 3
"""Number of pairs of joints for which the share is estimated."""

MOST = 3
"""Largest number of shares that are found in one log."""

COPY = 1e-3
"""Ratio of the difference of two torques to the torque, both standard deviations, below which they are the same. Two
joints that stick most of the time differ by 1e-2."""


@dataclass(frozen=True, slots=True, eq=False)
class TorqueShare:
    """Share of the torque of one joint in the torque of another joint.

    Attributes:
        joint: Index of the joint whose torque contains the share.
        other: Index of the other joint.
        factor: Share of the torque of the other joint.
        deviation: Standard deviation of the share.
        gain: Decrease of the mean logarithm of the RMS residuals when the share is removed.
        after: The log without the share.
    """

    joint: int
    other: int
    factor: float
    deviation: float
    gain: float
    after: LogState


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports the joints whose torque contains a share of the torque of another joint."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by shares of other torques; `None` if there are none."""
    if state.rows.n < 2 or state.log.band.is_open:
        return None
    if (same := _same_torque(state)) is not None:
        return same
    shares: list[TorqueShare] = []
    now = state
    for _ in range(MOST):
        found = _largest_share(now)
        if found is None or (found.joint, found.other) in {(each.joint, each.other) for each in shares}:
            break
        shares.append(found)
        now = found.after
    if not shares:
        return None
    names = state.model.robot.joint_names
    gain = state.fit.cost - now.fit.cost
    return Explanation(
        CODE,
        gain,
        "error",
        ", ".join(dict.fromkeys(names[each.joint] for each in shares)),
        f"{' '.join(_sentence(each, names) for each in shares)} Without it, the residual of one model for all joints "
        f"is {1 - np.exp(-gain):.0%} smaller.",
        lambda evidence: _remedy(shares, names),
        now,
        worse=HELPS,
        trial=_trial(state, now),
    )


def _largest_share(state: LogState) -> TorqueShare | None:
    """Share of a torque that lowers the residuals most; `None` if no share is significant."""
    rows, added = state.rows, AddedColumns(state)
    explained = np.array([added.decreases(j, rows.torque.T)[0] for j in range(rows.n)])
    explained[np.diag_indices(rows.n)] = 0.0
    pairs = [divmod(int(k), rows.n) for k in np.argsort(-explained, axis=None)[:LOOKED_AT]]
    found = [each for j, k in pairs if explained[j, k] > EXPLAINED and (each := _share(state, j, k)) is not None]
    return max(found, key=lambda each: each.gain, default=None)


def _share(state: LogState, j: int, k: int) -> TorqueShare | None:
    """Share of the torque of joint k in that of joint j; `None` if it is not significant in most of the log."""
    rows = state.rows
    column = np.zeros((1, *rows.torque.shape))
    column[0, :, j] = rows.torque[:, k]
    fit = solve(rows, extra=column)
    factor, deviation, gain = float(fit.values[-1]), float(fit.deviation[-1]), state.fit.cost - fit.cost
    least = GAIN if factor > 0.0 else GAIN_OF_NEGATIVE
    if gain < least or abs(factor) < SURE * deviation:
        return None
    for part, share in ((_calm(state), CALM_GAIN), (judged_away_from_reversals(state)[0], AWAY_GAIN)):
        if part.fit.cost - solve(part.rows, extra=column).cost < share * gain:
            return None
    return TorqueShare(j, k, factor, deviation, gain, _without_share(state, j, k, factor))


def _calm(state: LogState) -> LogState:
    """The log without the rows in which the residuals of all joints together are largest."""
    level = np.sum((state.fit.residual / state.fit.sigma) ** 2, axis=1)
    return state.without(level > np.quantile(level, CALM))


def _without_share(state: LogState, j: int, k: int, factor: float) -> LogState:
    """The log without a share of the torque of joint k in that of joint j; the regressor columns are reused."""

    def without(torque: Array) -> Array:
        result = torque.copy()
        result[:, j] -= factor * torque[:, k]
        return result

    runs = tuple(replace(run, torque=without(run.torque)) for run in state.log.runs)
    after = state.on(replace(state.log, runs=runs))
    after.__dict__["rows"] = replace(state.rows, torque=without(state.rows.torque))
    return after


def _trial(before: LogState, after: LogState) -> RemedyTrial:
    """Held-out errors without and with the correction, both relative to the torque as logged."""
    size = [
        np.sqrt(np.mean(np.where(state.rows.mask, state.rows.torque, 0.0) ** 2, axis=0)) for state in (before, after)
    ]
    known = (size[0] > 0.0) & (size[1] > 0.0)
    change = float(np.sum(np.log(size[1][known] / size[0][known]))) / len(known)
    return RemedyTrial(heldout_error(before.rows), heldout_error(after.rows) + change)


def _sentence(each: TorqueShare, names: tuple[str, ...]) -> str:
    """Sentence that states one share."""
    return (
        f"The torque of {names[each.joint]} contains {each.factor:.2f} ± {each.deviation:.2f} times the torque of "
        f"{names[each.other]}."
    )


def _remedy(shares: list[TorqueShare], names: tuple[str, ...]) -> str:
    """Remedy by hand: no key of a study subtracts torques of other joints."""
    steps = [
        f"subtract {each.factor:.2f} times the torque of {names[each.other]} from that of {names[each.joint]}"
        for each in shares
    ]
    return (
        "find out the cause, in the wiring, the logger or coupled drives (`transmission`), or correct the log: "
        f"{', then '.join(steps)}"
    )


def _same_torque(state: LogState) -> Explanation | None:
    """Explains the misfit by two joints with the same torque; `None` if all torques differ.

    The fit does not use the torques of these joints any more, because the log does not show whose torque it is.
    """
    rows = state.rows
    torque = rows.torque - rows.torque.mean(axis=0)
    same: list[tuple[int, int, float]] = []
    for j in range(rows.n):
        for k in range(j):
            power = float(torque[:, k] @ torque[:, k])
            factor = float(torque[:, k] @ torque[:, j]) / power if power > 0.0 else 0.0
            size, rest = np.linalg.norm(torque[:, j]), np.linalg.norm(torque[:, j] - factor * torque[:, k])
            if 0.0 < size and rest < COPY * size:
                same.append((k, j, factor))
    if not same:
        return None
    names = state.model.robot.joint_names
    left_out = np.zeros(rows.mask.shape, dtype=np.bool_)
    left_out[:, list({j for each in same for j in each[:2]})] = True
    after = state.without(left_out)
    pairs = "; ".join(f"{names[j]} is {factor:.3g} times that of {names[k]}" for k, j, factor in same)
    return Explanation(
        CODE,
        np.inf,
        "error",
        ", ".join(dict.fromkeys(names[j] for each in same for j in each[:2])),
        f"Two joints have the same torque, up to {COPY:.1%}: the torque of {pairs}.",
        lambda evidence: (
            "log the torque of each joint itself; find out in the logger which joint the torque belongs to"
        ),
        after,
        trial=try_remedy(after.rows, after.rows),
    )


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        CODE: "The friction and the weight of another joint are attributed to this joint, and a common model of the "
        "links is a compromise.",
    },
    explain=explain,
    follows=("motor-side", "current-without-gain", "torque-unit"),
)
