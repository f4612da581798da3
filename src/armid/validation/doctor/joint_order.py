"""Channels in another order than the joints, all of them or those of the torque alone."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from armid.errors import Finding
from armid.validation.doctor.evidence import Evidence
from armid.validation.doctor.rows import Thin, cost_of, make_rows, products
from armid.validation.doctor.state import Explanation, State
from armid.values import Array

__all__ = ["check", "explain"]

CODE = "joint-order"

GAIN = 0.02
"""Fall of the residual, as a logarithm, that another order must bring where one set of parameters explains all
joints as well as one for each: logs in order rise by every exchange, by 0.02 and more."""

SURE = 0.3
"""Fall that is enough whatever the joints say of each other."""

SHARE = 0.7
"""Share of the conflict between the joints that must fall between the two. On an arm with more friction in the
wrist than the model has, exchanging two wrist joints brings half of the conflict."""

CALM = 0.15
"""Conflict up to which joints agree."""

EXCHANGES = 3
"""Pairs that are exchanged one after the other; a log that is worse mixed up is only said to be mixed up."""

LOOKED_AT, NEAR = 3, 0.05
"""Exchanges that are looked at closely: the best of those that were tried quickly, if they leave no more than the
order as it is by a margin."""

FEW = 7
"""Joints up to which all orders are tried, in some milliseconds."""


@dataclass(frozen=True, eq=False, slots=True)
class _Order:
    motion: NDArray[np.intp]
    torque: NDArray[np.intp]
    cost: float


def check(evidence: Evidence) -> list[Finding]:
    """The finding, if another order explains the log."""
    return evidence.explained(CODE)


def explain(state: State) -> Explanation | None:
    """The order that explains the log, or `None` if it is the one that it has."""
    n, coarse = state.rows.n, state.log.coarse()
    same = np.arange(n)
    best = begin = _Order(same, same, cost_of(state.rows, products(state.rows)))
    near = _tried(state, coarse, same, same).cost + NEAR
    for step in range(EXCHANGES):
        trials = [_exchanged(state, coarse, best, i, j) for i in range(n) for j in range(i + 1, n)]
        if step == 0:
            trials += [_tried(state, coarse, same, _assigned(state)), _tried(state, coarse, same[::-1], same[::-1])]
        trials = [t for t in trials if (t.torque != best.torque).any() and t.cost < near]
        trials = sorted(trials, key=lambda order: order.cost)[:LOOKED_AT]
        close = [_tried(state, state.log, t.motion, t.torque) for t in trials]
        found = min(close, key=lambda order: order.cost, default=best)
        if found.cost > best.cost - GAIN:
            break
        best = found
    gain = begin.cost - best.cost
    if gain < (GAIN if state.conflict < CALM else min(SURE, SHARE * state.conflict)):
        return None
    names = state.model.robot.joint_names
    alone = bool((best.motion == same).all())
    order = [names[k] for k in np.argsort(best.torque)]
    what = "torque" if alone else "position and torque"
    moved = np.flatnonzero(best.torque != same)
    remedy = (
        f"columns = {{ effort = [{', '.join(f'column {k + 1}' for k in best.torque)}] }}"
        if alone
        else "joints = [" + ", ".join(f'"{name}"' for name in order) + "]"
    )
    return Explanation(
        CODE,
        gain,
        "error",
        ", ".join(names[j] for j in moved),
        f"With the {what} channels in the order {', '.join(str(k + 1) for k in best.torque)} one set of parameters "
        f"leaves {1 - np.exp(-gain):.0%} less of the torque.",
        remedy,
        state.on(state.log.reordered(best.motion, best.torque)),
    )


def _tried(state: State, log: Thin, motion: NDArray[np.intp], torque: NDArray[np.intp]) -> _Order:
    rows = make_rows(state.source, log.reordered(motion, torque))
    return _Order(motion, torque, cost_of(rows, products(rows)))


def _exchanged(state: State, log: Thin, order: _Order, i: int, j: int) -> _Order:
    """Two more channels exchanged; where the motion is in order, the torque's go with it."""
    motion, torque = order.motion.copy(), order.torque.copy()
    for each in (motion, torque):
        each[[i, j]] = each[[j, i]]
    return _tried(state, log, motion, torque)


def _assigned(state: State) -> NDArray[np.intp]:
    """Which torque channel each joint's own columns explain best."""
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
