"""Moments in which the arm touched something: bursts of what the model leaves.

A push moves the fit, too, and hides in what it makes of the rest. So the strongest bursts are left out one by one,
and those count that a model of the other rows leaves standing out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.doctor.evidence import LogEvidence
from armid.doctor.explanation import Explanation, LogState
from armid.errors import Finding
from armid.measurement.remedy import excluding
from armid.values import Array

__all__ = ["check", "explain"]

CODE = "contact"

WINDOW = 0.5
"""Seconds over which the residual is averaged: as long as a push lasts."""

BURST = 15.0
"""Residual of two joints over its usual size that no friction explains: on recorded arms it comes to 8, with a push
of a tenth of the joints' limits to 40."""

USUAL = 85.0
"""Percentile of the local residual that is its usual size: an arm that rests half of the time, or begins with
another motion than it goes on with, is not in contact for the rest."""

MOST = 4
"""Bursts that are looked for."""

JOINTS = 2
"""Joints that must feel it."""

SLOW = 0.06
"""Velocity below which dry friction is not what a smooth sign makes of it [rad/s or m/s]: three of its widths."""

LONGEST = 0.25
"""Share of a log in bursts from which they are no bursts but how the arm is."""


def check(evidence: LogEvidence) -> list[Finding]:
    """The finding, if a burst stands out."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """Bursts one after the other, the strongest first, and the log without them."""
    if state.log.band.is_open:
        return None
    time, run = state.rows.motion.time, state.rows.run
    left_out = np.zeros(len(time), dtype=np.bool_)
    after = state
    for _ in range(MOST):
        size = _bursts(after, _residual(state, after.fit.values), _extrapolation(after) + _held(after))
        level = np.where(left_out, 0.0, _level(size))
        peak = int(np.argmax(level))
        more = left_out | ((np.abs(time - time[peak]) < 2 * WINDOW) & (run == run[peak]))
        if more.mean() > LONGEST:
            break
        left_out, after = more, state.without(more)
    size = _bursts(after, _residual(state, after.fit.values), _extrapolation(after) + _held(after))
    level = np.where(left_out, _level(size), 0.0)
    hit = level > BURST
    if not hit.any():
        return None
    kept = _around(hit, time, run)
    peak = int(np.argmax(level))
    felt = np.flatnonzero(size[peak] > BURST / 2)
    names = state.model.robot.joint_names
    after = state.without(kept)
    return Explanation(
        CODE,
        state.fit.cost - after.fit.cost,
        "warning",
        ", ".join(names[j] for j in felt),
        f"At t = {time[peak]:.2f} s a model of the rest leaves {size[peak].max():.0f} times the usual, on "
        f"{len(felt)} joints together.",
        lambda evidence: excluding(evidence.reading, _stretches(kept, time, run)),
        after,
    )


def _around(hit: NDArray[np.bool_], time: Array, run: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Rows within a window of those that stand out, shape (M,)."""
    near = (np.abs(time[:, None] - time[None, hit]) <= WINDOW) & (run[:, None] == run[None, hit])
    return near.any(axis=1)


def _stretches(rows: NDArray[np.bool_], time: Array, run: NDArray[np.int64]) -> list[tuple[float, float]]:
    """Begin and end of each stretch of rows that follow each other [s]."""
    which = np.flatnonzero(rows)
    cuts = np.flatnonzero((np.diff(which) > 1) | (np.diff(run[which]) != 0)) + 1
    return [(float(time[part[0]]), float(time[part[-1]])) for part in np.split(which, cuts)]


def _residual(state: LogState, values: Array) -> Array:
    """Return what parameters leave of the torque in all rows that count, shape (M, n)."""
    rows = state.rows
    told = [x.T @ values[own] for x, own in zip(rows.columns, rows.parameters, strict=True)]
    return (rows.torque - np.column_stack(told)) * rows.mask


def _extrapolation(state: LogState) -> Array:
    """Variance of the torque that follows from the parameters', shape (M, n).

    What only the rows left out show of the arm is no burst.
    """
    rows, covariance = state.rows, state.fit.covariance
    return np.column_stack(
        [
            np.sum(x * (covariance[np.ix_(own, own)] @ x), axis=0)
            for x, own in zip(rows.columns, rows.parameters, strict=True)
        ]
    )


def _held(state: LogState) -> Array:
    """Square of the torque that dry friction may hold while a joint hardly moves, shape (M, n)."""
    rows = state.rows
    wide = np.ones(max(1, round(WINDOW * rows.rate)))
    slow = np.abs(rows.motion.dq) < SLOW
    result = np.empty_like(rows.torque)
    for j in range(rows.n):
        own = rows.parameters[j]
        dry = sum(float(state.fit.values[p]) ** 2 for p, s in zip(own, state.symbols(j), strict=True) if s == "FS")
        result[:, j] = dry * np.convolve(slow[:, j], wide / len(wide), mode="same")
    return result


def _level(size: Array) -> Array:
    """Tell how far the joints together stand out, shape (M,): as far as the second of them."""
    return np.sort(size, axis=1)[:, -min(JOINTS, size.shape[1])]


def _bursts(state: LogState, residual: Array, open_variance: Array | float = 0.0) -> Array:
    """Local size of each joint's residual (M, n) over its usual one in the rows that count, shape (M, n)."""
    rows = state.rows
    wide = max(1, round(WINDOW * rows.rate))
    power = np.empty_like(rows.torque)
    for j in range(rows.n):
        power[:, j] = np.convolve(residual[:, j] ** 2, np.ones(wide) / wide, mode="same")
    counted = [power[rows.mask[:, j], j] for j in range(rows.n)]
    usual = np.array([np.percentile(x, USUAL) if len(x) else 1.0 for x in counted])
    return np.sqrt(power / np.maximum(usual + open_variance, np.finfo(float).tiny))
