"""Moments in which the arm touched something: bursts of what the model leaves.

A push moves the fit, too, and hides in what it makes of the rest. So the strongest burst is left out, and counts if a
model of the other rows leaves it standing out.
"""

from __future__ import annotations

import numpy as np

from armid.errors import Finding
from armid.validation.doctor.evidence import Evidence
from armid.validation.doctor.state import Explanation, State
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

JOINTS = 2
"""Joints that must feel it."""

LONGEST = 0.25
"""Share of a log in bursts from which they are no bursts but how the arm is."""


def check(evidence: Evidence) -> list[Finding]:
    """The finding, if a burst stands out."""
    return evidence.explained(CODE)


def explain(state: State) -> Explanation | None:
    """The strongest burst, and the log without it."""
    if state.log.band.is_open:
        return None
    time = state.rows.motion.time
    peak = int(np.argmax(_level(_bursts(state, state.fit.residual))))
    left_out = (np.abs(time - time[peak]) < 4 * WINDOW) & (state.rows.run == state.rows.run[peak])
    if left_out.mean() > LONGEST:
        return None
    after = state.without(left_out)
    size = _bursts(after, _residual(state, after.fit.values), _extrapolation(after))
    level = np.where(left_out, _level(size), 0.0)
    hit = level > BURST
    if not hit.any():
        return None
    peak = int(np.argmax(level))
    low, high = float(time[hit].min()), float(time[hit].max())
    felt = np.flatnonzero(size[peak] > BURST / 2)
    names = state.model.robot.joint_names
    return Explanation(
        CODE,
        state.fit.cost - after.fit.cost,
        "warning",
        ", ".join(names[j] for j in felt),
        f"At t = {time[peak]:.2f} s a model of the rest leaves {size[peak].max():.0f} times the usual, on "
        f"{len(felt)} joints together.",
        f"exclude = [[{low - WINDOW:.2f}, {high + WINDOW:.2f}]]",
        after,
    )


def _residual(state: State, values: Array) -> Array:
    """What parameters leave of the torque in all rows, shape (M, n)."""
    rows = state.rows
    told = [x.T @ values[own] for x, own in zip(rows.columns, rows.parameters, strict=True)]
    return rows.torque - np.column_stack(told)


def _extrapolation(state: State) -> Array:
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


def _level(size: Array) -> Array:
    """How far the joints together stand out, shape (M,): as far as the second of them."""
    return np.sort(size, axis=1)[:, -min(JOINTS, size.shape[1])]


def _bursts(state: State, residual: Array, open_variance: Array | float = 0.0) -> Array:
    """Local size of each joint's residual (M, n) over its usual one in the rows that count, shape (M, n)."""
    rows = state.rows
    wide = max(1, round(WINDOW * rows.rate))
    power = np.empty_like(rows.torque)
    for j in range(rows.n):
        power[:, j] = np.convolve(residual[:, j] ** 2, np.ones(wide) / wide, mode="same")
    counted = [power[rows.mask[:, j], j] for j in range(rows.n)]
    usual = np.array([np.percentile(x, USUAL) if len(x) else 1.0 for x in counted])
    return np.sqrt(power / np.maximum(usual + open_variance, np.finfo(float).tiny))
