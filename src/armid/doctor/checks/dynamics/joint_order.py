"""Check for a wrong order of channels: of all quantities, of the torques only or of the positions only."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.candidate_orders import BEYOND, LimitExcess, exchanges, limit_excess, shifts, usual_orders
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import ROWS, Explanation, LogEvidence
from armid.doctor.checks.signals import velocity_mismatch
from armid.doctor.checks.signals.position_limits import outside_limits
from armid.doctor.downsample import DownsampledLog
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import QuickRows, cost_of, make_rows, products, tables
from armid.doctor.remedy_trial import HELPS, WORSE, try_remedy
from armid.doctor.rows_away_from_reversals import is_significant, judged_away_from_reversals
from armid.errors import Finding
from armid.measurement.columns.joint_assignment import by_number
from armid.measurement.convention_conversion import understood
from armid.measurement.remedy_builders import lines, naming
from armid.remedy import Remedy

CODE = "joint-order"

GAIN = 0.03
"""Smallest decrease of the mean logarithm of the RMS residuals for another order if the joints agree. In logs of the
right order, each exchange increases the residual by 0.02 or more. Two orders whose residuals differ by less than the
limit cannot be distinguished."""

SURE = 0.3
"""Decrease of the mean logarithm of the RMS residuals from which another order is always accepted."""

SHARE = 0.7
"""Smallest decrease between `GAIN` and `SURE`, as a share of the conflict between the joints. On an arm with
unmodelled wrist friction, an exchange of two wrist joints decreases the residual by half of the conflict."""

CALM = 0.15
"""Conflict up to which the joints count as in agreement."""

EXCHANGES = 3
"""Largest number of pairs that are exchanged one after the other. If more pairs are wrong in a log, the reported
order is better, but not yet right."""

LOOKED_AT, NEAR = 4, 0.05
"""Number of exchanges that are fitted to all judged rows, chosen by a quick fit, and margin by which the residual of
that fit may exceed that of the logged order."""

FEW = 7
"""Joints up to which all orders are tried, which takes some milliseconds."""

AGREES = 0.005
"""Decrease of the mean logarithm of the RMS residuals from which the torque supports an order with all joints inside
their limits. If the logarithm increases by more than the same number, the torque contradicts the order. On sound
logs, such orders increase it by more."""


Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, slots=True)
class _Order:
    """Order of channels, with the residual of the model for this order.

    Attributes:
        motion: Channel of the motion of each joint, shape (n,).
        torque: Channel of the torque of each joint, shape (n,).
        cost: Mean over the joints of the logarithm of the RMS residual.
    """

    motion: NDArray[np.intp]
    torque: NDArray[np.intp]
    cost: float


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports another order of channels if the model fits the log better with this order."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a wrong order of channels; `None` if the order is right."""
    same, limits = np.arange(state.rows.n), limit_excess(state)
    judged, moving = judged_away_from_reversals(state)
    begin = _Order(same, same, cost_of(judged.rows, products(judged.rows)))
    best, others, few = _searched(state, judged, begin, limits)
    if few and not _is_worth(judged, begin.cost - best.cost, best, moving):
        # The rows away from reversals are those of the motion as logged; for another order they can be too few.
        judged, moving = state, np.zeros_like(moving)
        begin = _Order(same, same, state.fit.cost)
        best, others, _ = _searched(state, judged, begin, limits)
    gain = begin.cost - best.cost
    if not _is_worth(judged, gain, best, moving):
        return None if limits.given_fits else _by_limits(state, judged, begin, limits)
    equal = [order for order in others if order.cost < best.cost + GAIN]
    within = [order for order in (best, *equal) if limits.fits(order.motion)]
    if within and not limits.given_fits:  # limits decide what the torque does not
        best, *equal = sorted(within, key=lambda order: order.cost)
    gain, doubt = begin.cost - best.cost, [_order_text(order) for order in equal]
    evidence = (
        f"With {_order_text(best)}, the error of one model for all joints is {1 - np.exp(-gain):.0%} smaller"
        + (f"; with {' or '.join(doubt)} the error is equally small, so the log cannot decide." if doubt else ".")
    )
    return _explanation(state, judged, best, evidence, decided=not doubt)


def _is_worth(judged: LogState, gain: float, best: _Order, moving: Flags) -> bool:
    """True if an order decreases the residual by more than unmodelled friction and noise can do.

    Args:
        judged: The log with the rows on which orders are compared.
        gain: Decrease of the mean logarithm of the RMS residuals.
        best: The order.
        moving: Mask of the joints that have enough rows away from reversals, shape (n,).
    """
    if gain < GAIN:
        return False
    same = np.arange(len(moving))
    moved = (best.motion != same) | (best.torque != same)
    if not moving[moved].all():
        least = SURE
    else:
        least = GAIN if judged.conflict < CALM else min(SURE, SHARE * judged.conflict)
    return gain > least and is_significant(judged, gain)


def _explanation(
    state: LogState,
    judged: LogState,
    best: _Order,
    evidence: str,
    *,
    decided: bool = True,
    supported: bool = True,
) -> Explanation:
    """Explanation of the misfit of the model, with the order that corrects the fault.

    Args:
        state: The log.
        judged: The log with the rows on which orders are compared.
        best: The order that corrects the fault.
        evidence: Observation, with numbers.
        decided: False if the model fits the log equally well with other orders.
        supported: False if the torque agrees equally well with the order of the log.
    """
    same, names = np.arange(state.rows.n), state.model.robot.joint_names
    moved = np.flatnonzero((best.torque != same) | (best.motion != same))
    after = state.on(state.log.reordered(best.motion, best.torque))
    judged_after = judged.on(judged.log.reordered(best.motion, best.torque))
    return Explanation(
        CODE,
        max(state.fit.cost - after.fit.cost, AGREES),
        "info" if not decided else "error" if supported else "warning",
        ", ".join(names[j] for j in moved),
        evidence,
        lambda evidence: _remedy(evidence, best),
        after,
        worse=HELPS if supported else WORSE,
        trial=try_remedy(judged.rows, judged_after.rows),
    )


def _searched(
    state: LogState, judged: LogState, begin: _Order, limits: LimitExcess
) -> tuple[_Order, list[_Order], bool]:
    """Order with the smallest residual, found by exchanges of pairs, and the orders that were tried last.

    The third value is true if an order that fits far better was left out, because too few rows judge it.
    """
    same, coarse = begin.motion, state.log.coarse()
    takes = limits.allowed, limits.excess < np.inf
    near = _evaluated(state, coarse, same, same).cost + NEAR
    best, others, few = begin, list[_Order](), False
    for step in range(EXCHANGES):
        trials = list(_exchanged(state, coarse, best, takes))
        if step == 0:
            guesses = [(same, [_assigned(state)]), (same[::-1], [same[::-1], same])]
            if state.conflict >= CALM or not limits.given_fits:
                guesses += [(shift, [shift, same]) for shift in shifts(len(same))]
            trials += [order for guess in guesses for order in _with_motion(state, coarse, takes, *guess)]
        trials = sorted((t for t in _distinct(trials) if t.cost < near), key=lambda order: order.cost)[:LOOKED_AT]
        few = few or any(t.cost < near - NEAR - SURE and not _has_rows(judged, t) for t in trials)
        close = [_evaluated(state, judged.log, t.motion, t.torque) for t in trials if _has_rows(judged, t)]
        better = min(close, key=lambda order: order.cost, default=best)
        if better.cost > best.cost - GAIN:
            break
        best, others = better, [order for order in close if order is not better]
    return best, others, few


def _has_rows(judged: LogState, order: _Order) -> bool:
    """True if, in an order, enough rows are used for each joint to fit the model."""
    counted = (judged.rows.mask[:, order.motion] & judged.rows.mask[:, order.torque]).sum(axis=0)
    return all(k > ROWS * len(own) for k, own in zip(counted, judged.rows.parameters, strict=True))


def _by_limits(state: LogState, judged: LogState, begin: _Order, limits: LimitExcess) -> Explanation | None:
    """Explains the misfit by the order that puts all joints inside their limits.

    The result is `None` if the torque contradicts the order, or if several orders are equally good.

    If the torque does not support the order, a joint must be far outside its limits, and its motion must be larger
    than the range of the limits. A smaller excess may have other causes: inaccurate limits, a wrong zero or a wrong
    direction.
    """
    same, coarse = begin.motion, state.log.coarse()
    fitting = [order for order in usual_orders(len(same)) if limits.fits(order)]
    trials = sorted((_evaluated(state, coarse, order, order) for order in fitting), key=lambda order: order.cost)
    close = [_evaluated(state, judged.log, t.motion, t.torque) for t in trials[:LOOKED_AT] if _has_rows(judged, t)]
    close.sort(key=lambda order: order.cost)
    if not close or any(order.cost < close[0].cost + GAIN for order in close[1:]):
        return None
    best, gain = close[0], begin.cost - close[0].cost
    far = [j for j in same if limits.excess[j, j] > BEYOND]
    supported = gain > AGREES
    if not supported and (gain < -AGREES or not limits.far.any()):
        return None
    told = "; ".join(outside_limits(state.model.robot, state.rows.motion.q, j) for j in far)
    torque = (
        f"the error of one model for all joints is {1 - np.exp(-gain):.1%} smaller"
        if supported
        else "the torque agrees equally well; if the given order is right, the limits of the description are wrong"
    )
    evidence = (
        f"In the order of the log, {told}. With {_order_text(best)}, all joints are inside their limits, and "
        f"{torque}."
    )
    return _explanation(state, judged, best, evidence, supported=supported)


def _order_text(order: _Order) -> str:
    """Text that states an order of channels; the first channel has the number 1."""
    same = np.arange(len(order.motion))
    if (order.motion == order.torque).all():
        return f"the position and torque channels in the order {_listed(order.motion)}"
    parts = [
        f"the {what} channels in the order {_listed(which)}"
        for what, which in (("position", order.motion), ("torque", order.torque))
        if (which != same).any()
    ]
    return " and ".join(parts)


def _listed(order: NDArray[np.intp]) -> str:
    return ", ".join(str(k + 1) for k in order)


def _remedy(evidence: LogEvidence, order: _Order) -> str:
    """Lines of a study that correct the order: the columns of each quantity, or the joint of each channel."""
    recording = evidence.recording
    assert recording is not None
    quantities = {**dict.fromkeys(("q", "dq", "ddq", "command"), order.motion), "effort": order.torque}
    found = {name: recording.columns.get(name, ()) for name in quantities if getattr(recording, name) is not None}
    if any(len(columns) != recording.n for columns in found.values()):
        alike = (order.motion == order.torque).all()
        return (_renamed(evidence, order.motion) if alike else None) or f"rewrite the log with {_order_text(order)}"
    if any(f.severity == "error" for f in velocity_mismatch.check(evidence)):
        quantities |= dict.fromkeys(("dq", "ddq"), np.arange(recording.n))  # their order is not the positions'
    reading = understood(recording, evidence.reading)
    # Columns in the order of the joints need no `joints`, and those guessed by names of joints are all to be named.
    every = bool(recording.guessed.get("columns") or reading.joints)
    chosen = {
        name: [columns[k] for k in quantities[name]]
        for name, columns in found.items()
        if every or (quantities[name] != np.arange(recording.n)).any()
    }
    named = naming(reading, chosen)
    if not evidence.reading.joints:
        return named
    return Remedy(*named.parts, *lines(joints=evidence.robot.joint_names).parts)


def _renamed(evidence: LogEvidence, order: NDArray[np.intp]) -> str | None:
    """Line of a study that assigns all quantities of a channel to another joint; `None` if the channels are unknown.

    Channels of messages have names; channels of matrices have numbers.
    """
    names, given = evidence.robot.joint_names, evidence.reading.joint_map
    owner = dict(zip((names[k] for k in order), names, strict=True))
    if evidence.raw.joint_names and not evidence.raw.columns:
        in_file = {joint: name for name, joint in given.items() if joint}
        return lines(joints={**given, **{in_file.get(name, name): joint for name, joint in owner.items()}})
    channels = list(given.values()) or list(by_number(evidence.raw, evidence.robot))
    unknown = evidence.raw is evidence.recording and evidence.robot.held and not given
    return None if unknown else lines(joints=[owner.get(name, name) for name in channels])


def _evaluated(state: LogState, log: DownsampledLog, motion: NDArray[np.intp], torque: NDArray[np.intp]) -> _Order:
    same = np.arange(len(motion))
    return next(_with_torques(make_rows(state.source, log.reordered(motion, same)), log, motion, [torque]))


def _distinct(orders: Iterable[_Order]) -> list[_Order]:
    """The given orders, each one once."""
    return list({(*order.motion, *order.torque): order for order in orders}.values())


def _with_torques(
    rows: QuickRows, log: DownsampledLog, motion: NDArray[np.intp], torques: Sequence[NDArray[np.intp]]
) -> Iterator[_Order]:
    """Orders with one motion and several orders of the torque, with their costs, from columns that exist already.

    If the same rows are used for all joints, the scalar products of the columns are computed once for all orders of
    the torque.
    """
    alike = len(torques) > 1 and bool((log.mask == log.mask[:, :1]).all())
    shared = [table @ table.T for table in tables(rows, np.tile(rows.torque.T[:, :, None], rows.n))] if alike else []
    for torque in torques:
        changed = replace(rows, torque=rows.torque[:, torque], mask=log.mask[:, motion] & log.mask[:, torque])
        picked = (_picked(P, rows.n, k) for P, k in zip(shared, torque, strict=alike))
        pairs = tuple(picked) if alike else products(changed)
        yield _Order(motion, torque, cost_of(changed, pairs))


def _picked(P: Array, n: int, k: int) -> Array:
    """Scalar products of the columns of one joint and torque k.

    Args:
        P: Scalar products of the columns of the joint and of the torques of all joints.
        n: Number of torques.
        k: Index of the torque that is taken.
    """
    at = np.append(np.arange(len(P) - n - 1), len(P) - n - 1 + k)
    return P[at[:, None], at]


def _exchanged(state: LogState, log: DownsampledLog, order: _Order, takes: tuple[Flags, Flags]) -> Iterator[_Order]:
    """Orders with two more channels exchanged than in a given order: in positions, torques, or all quantities."""
    pairs = exchanges(len(order.motion))
    torques = [order.torque[exchange] for exchange in pairs]
    for motion, torque in zip((order.motion[exchange] for exchange in pairs), torques, strict=True):
        yield from _with_motion(state, log, takes, motion, [order.torque, torque])
    yield from _with_motion(state, log, takes, order.motion, torques)


def _with_motion(
    state: LogState,
    log: DownsampledLog,
    takes: tuple[Flags, Flags],
    motion: NDArray[np.intp],
    torques: Sequence[NDArray[np.intp]],
) -> Iterator[_Order]:
    """Orders with one given motion and each possible order of the torque, with their costs.

    Columns are computed once.
    """
    possible = [torque for torque in torques if _possible(takes, motion, torque)]
    if possible:
        rows = make_rows(state.source, log.reordered(motion, np.arange(len(motion))))
        yield from _with_torques(rows, log, motion, possible)


def _possible(takes: tuple[Flags, Flags], motion: NDArray[np.intp], torque: NDArray[np.intp]) -> bool:
    """True if an order gives every joint only channels that this joint may have."""
    joints = np.arange(len(motion))
    return bool(takes[0][joints, motion].all() and takes[1][joints, torque].all())


def _assigned(state: LogState) -> NDArray[np.intp]:
    """Order (n,) of torque channels with the smallest residual when each joint is fitted with separate parameters."""
    rows, n = state.rows, state.rows.n
    residual: Array = np.zeros((n, n))
    tau = rows.torque - rows.torque.mean(axis=0)
    for j in range(n):
        Q = np.linalg.qr(rows.columns[j].T)[0]
        rest = np.linalg.norm(rows.torque - Q @ (Q.T @ rows.torque), axis=0)
        residual[j] = np.log(np.maximum(rest, 1e-12) / np.maximum(np.linalg.norm(tau, axis=0), 1e-12))
    if n <= FEW:
        orders = np.array(list(permutations(range(n))))
        return orders[residual[np.arange(n), orders].sum(axis=1).argmin()]
    from scipy.optimize import linear_sum_assignment  # slow to import

    return np.asarray(linear_sum_assignment(residual)[1], dtype=np.intp)


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        "joint-order": "Parameters of one joint are fitted to the torque of another joint; the estimate is useless.",
    },
    explain=explain,
    hides=(
        "saturation",
        "velocity-mismatch",
    ),
)
