"""Channels in another order than the joints: all of them, or those of the torque or of the positions alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from armid.doctor.checks.signals import velocity_mismatch
from armid.doctor.downsample import DownsampledLog
from armid.doctor.evidence import LogEvidence
from armid.doctor.explanation import Explanation, LogState
from armid.doctor.quick_fit import QuickRows, cost_of, make_rows, products
from armid.errors import Finding
from armid.measurement.columns.channels import channels_of_joints
from armid.measurement.remedy import lines, naming
from armid.values import Array

__all__ = ["check", "explain"]

CODE = "joint-order"

GAIN = 0.03
"""Fall of the residual, as a logarithm, that another order must bring where one set of parameters explains all
joints as well as one for each: logs in order rise by every exchange, by 0.02 and more. Below it the log does not say
which of two orders it has."""

SURE = 0.3
"""Fall that is enough whatever the joints say of each other."""

SHARE = 0.7
"""Share of the conflict between the joints that must fall between the two. On an arm with more friction in the
wrist than the model has, exchanging two wrist joints brings half of the conflict."""

CALM = 0.15
"""Conflict up to which joints agree."""

EXCHANGES = 3
"""Pairs that are exchanged one after the other; a log that is worse mixed up is only said to be mixed up."""

LOOKED_AT, NEAR = 4, 0.05
"""Exchanges that are looked at closely: the best of those that were tried quickly, if they leave no more than the
order as it is by a margin."""

FEW = 7
"""Joints up to which all orders are tried, in some milliseconds."""

BEYOND = 0.1
"""Share of the span of a joint's limits that positions may lie beyond them: limits are what a description says."""


Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False, slots=True)
class _Order:
    """Channels of each joint's motion and torque, and what is left then."""

    motion: NDArray[np.intp]
    torque: NDArray[np.intp]
    cost: float


def check(evidence: LogEvidence) -> list[Finding]:
    """The finding, if another order explains the log."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """The order that explains the log, or `None` if it is the one that it has."""
    n, coarse = state.rows.n, state.log.coarse()
    same = np.arange(n)
    best = begin = _Order(same, same, cost_of(state.rows, products(state.rows)))
    near = _tried(state, coarse, same, same).cost + NEAR
    others: list[_Order] = []
    takes = _takes(state)
    for step in range(EXCHANGES):
        rows = make_rows(state.source, coarse.reordered(best.motion, same))
        trials = [
            t for pair in combinations(range(n), 2) for t in _exchanged(state, coarse, best, rows, takes, *pair)
        ]
        if step == 0:
            more = [(same, _assigned(state)), (same[::-1], same[::-1]), (same[::-1], same)]
            trials += [_tried(state, coarse, *order) for order in more if _possible(takes, *order)]
        trials = sorted((t for t in _distinct(trials) if t.cost < near), key=lambda order: order.cost)[:LOOKED_AT]
        close = [_tried(state, state.log, t.motion, t.torque) for t in trials]
        found = min(close, key=lambda order: order.cost, default=best)
        if found.cost > best.cost - GAIN:
            break
        best, others = found, [order for order in close if order is not found]
    gain = begin.cost - best.cost
    if gain < (GAIN if state.conflict < CALM else min(SURE, SHARE * state.conflict)):
        return None
    names = state.model.robot.joint_names
    moved = np.flatnonzero((best.torque != same) | (best.motion != same))
    doubt = [_told(order) for order in others if order.cost < best.cost + GAIN]
    return Explanation(
        CODE,
        gain,
        "info" if doubt else "error",
        ", ".join(names[j] for j in moved),
        f"With {_told(best)} one set of parameters leaves {1 - np.exp(-gain):.0%} less of the torque"
        + (f"; with {' or '.join(doubt)} it leaves as little, and the log does not say which." if doubt else "."),
        lambda evidence: _remedy(evidence, best),
        state.on(state.log.reordered(best.motion, best.torque)),
    )


def _told(order: _Order) -> str:
    """The order in words, channels counted from 1."""
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
    """The order as a study says it: whose the channels are, or which columns hold a quantity."""
    channels = channels_of_joints(evidence.raw, evidence.reading, evidence.robot)
    if (order.motion == order.torque).all():
        return _renamed(evidence, channels, order.motion)
    quantities = {"q": order.motion, "dq": order.motion, "ddq": order.motion, "effort": order.torque}
    if any(f.severity == "error" for f in velocity_mismatch.check(evidence)):
        del quantities["dq"], quantities["ddq"]  # their order is not the positions'
    chosen: dict[str, list[str]] = {}
    for name, which in quantities.items():
        columns = evidence.raw.columns.get(name, ())
        if (which == np.arange(len(which))).all() or getattr(evidence.raw, name) is None:
            continue
        if len(columns) != evidence.raw.n:
            return f"rewrite the log with {_told(order)}"
        now = list(columns)
        for j, k in enumerate(which):
            now[channels[j]] = columns[channels[k]]
        chosen[name] = now
    return naming(evidence.reading, chosen)


def _renamed(evidence: LogEvidence, channels: list[int], order: NDArray[np.intp]) -> str:
    """All quantities of a channel given to another joint."""
    names = evidence.robot.joint_names
    owner = [""] * evidence.raw.n
    for j, k in enumerate(order):
        owner[channels[k]] = names[j]
    if not evidence.raw.joint_names:
        return lines(joints=owner)
    return lines(joints=dict(zip(evidence.raw.joint_names, owner, strict=True)))


def _tried(state: LogState, log: DownsampledLog, motion: NDArray[np.intp], torque: NDArray[np.intp]) -> _Order:
    same = np.arange(len(motion))
    return _with_torque(make_rows(state.source, log.reordered(motion, same)), log, motion, torque)


def _distinct(orders: Iterable[_Order]) -> list[_Order]:
    """Each order once: an exchange may also be what the joints' own columns say."""
    return list({(*order.motion, *order.torque): order for order in orders}.values())


def _with_torque(rows: QuickRows, log: DownsampledLog, motion: NDArray[np.intp], torque: NDArray[np.intp]) -> _Order:
    """Another order of the torque of a log beside columns that are made already."""
    mask = log.mask[:, motion] & log.mask[:, torque]
    changed = replace(rows, torque=rows.torque[:, torque], mask=mask)
    return _Order(motion, torque, cost_of(changed, products(changed)))


def _exchanged(
    state: LogState, log: DownsampledLog, order: _Order, rows: QuickRows, takes: tuple[Flags, Flags], i: int, j: int
) -> Iterator[_Order]:
    """Two more channels exchanged: of all quantities, of the positions alone, of the torque alone."""
    motion, torque = order.motion.copy(), order.torque.copy()
    for each in (motion, torque):
        each[[i, j]] = each[[j, i]]
    if _possible(takes, motion, order.torque):
        moved = make_rows(state.source, log.reordered(motion, np.arange(len(motion))))
        yield _with_torque(moved, log, motion, order.torque)
        if _possible(takes, motion, torque):
            yield _with_torque(moved, log, motion, torque)
    if _possible(takes, order.motion, torque):
        yield _with_torque(rows, log, order.motion, torque)


def _takes(state: LogState) -> tuple[Flags, Flags]:
    """Tell which joint could have which channel's positions, and which its torque, (n, n) each.

    No joint has a channel of the other kind, in metres or in radians, nor positions far beyond its limits, unless
    those that it has are as far beyond.
    """
    joints = state.model.robot.joints
    slides = np.array([joint.is_prismatic for joint in joints])
    alike = slides[:, None] == slides
    q = np.concatenate([run.motion.q[run.rows] for run in state.log.runs])
    low, high = np.array([joint.position_limits for joint in joints]).T[:, :, None]
    beyond = np.maximum(low - q.min(axis=0), q.max(axis=0) - high)
    span = np.where(np.isfinite(high - low) & (high > low), high - low, np.inf)
    return alike & (beyond <= np.maximum(BEYOND * span, np.diag(beyond)[:, None])), alike


def _possible(takes: tuple[Flags, Flags], motion: NDArray[np.intp], torque: NDArray[np.intp]) -> bool:
    """Tell whether every joint could have the channels of an order."""
    joints = np.arange(len(motion))
    return bool(takes[0][joints, motion].all() and takes[1][joints, torque].all())


def _assigned(state: LogState) -> NDArray[np.intp]:
    """Tell which torque channel each joint's own columns explain best."""
    rows, n = state.rows, state.rows.n
    left: Array = np.zeros((n, n))
    tau = rows.torque - rows.torque.mean(axis=0)
    for j in range(n):
        Q = np.linalg.qr(rows.columns[j].T)[0]
        rest = np.linalg.norm(rows.torque - Q @ (Q.T @ rows.torque), axis=0)
        left[j] = np.log(np.maximum(rest, 1e-12) / np.maximum(np.linalg.norm(tau, axis=0), 1e-12))
    if n <= FEW:
        orders = np.array(list(permutations(range(n))))
        return orders[left[np.arange(n), orders].sum(axis=1).argmin()]
    from scipy.optimize import linear_sum_assignment  # a seventh of a second to import

    return np.asarray(linear_sum_assignment(left)[1], dtype=np.intp)
