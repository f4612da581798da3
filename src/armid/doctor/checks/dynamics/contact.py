"""Check for contact of the arm with its surroundings: bursts of the residual, or a force at the tip.

A push also biases the fit, which makes the burst smaller. The strongest bursts are therefore left out one by one. A
burst is reported if it exceeds the residual of a model that was fitted to the other rows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.residuals import force_at_tip
from armid.errors import Finding
from armid.measurement.remedy_builders import excluding

CODE = "contact"

WINDOW = 0.5
"""Time over which the squared residual is averaged [s]; it is about the duration of a push."""

BURST = 15.0
"""Ratio of the residual to its usual size, on two joints at the same time, from which it is a burst. Recorded arms
reach 8 without contact, and 40 with a push of a tenth of the effort limits."""

USUAL = 85.0
"""Percentile of the local residual that defines its usual size. It is high because of arms that rest half of the
time: the other half must not be reported as contact."""

MOST = 4
"""Largest number of bursts."""

JOINTS = 2
"""Smallest number of joints with a burst at the same time."""

SLOW = 0.06
"""Velocity below which smoothed Coulomb friction differs from dry friction [rad/s or m/s]: three smoothing widths."""

LONGEST = 0.25
"""Share of a log above which large residuals count as unmodelled effects of the arm and not as bursts."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports a contact if the residual is large on several joints for a short time, or is that of a force."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by contact: by bursts of the residual, or by a force at the tip.

    The result is `None` if there is neither. Rows with bursts are left out, as the force is not known there.
    """
    return _explained_by_bursts(state) or force_at_tip.explain(CODE, state)


def _explained_by_bursts(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by bursts of the residual, and the log without them; `None` without bursts."""
    if state.log.band.is_open:
        return None
    time, run = state.rows.motion.time, state.rows.run
    left_out = np.zeros(len(time), dtype=np.bool_)
    after = state
    for _ in range(MOST):
        size = _bursts(after, _residual(state, after.fit.values), _extrapolation(after) + _static_friction(after))
        level = np.where(left_out, 0.0, _level(size))
        peak = int(np.argmax(level))
        extended = left_out | ((np.abs(time - time[peak]) < 2 * WINDOW) & (run == run[peak]))
        if extended.mean() > LONGEST:
            break
        left_out, after = extended, state.without(extended)
    size = _bursts(after, _residual(state, after.fit.values), _extrapolation(after) + _static_friction(after))
    level = np.where(left_out, _level(size), 0.0)
    hit = level > BURST
    if not hit.any():
        return None
    near_burst = _around(hit, time, run)
    peak = int(np.argmax(level))
    felt = np.flatnonzero(size[peak] > BURST / 2)
    names = state.model.robot.joint_names
    after = state.without(near_burst)
    return Explanation(
        CODE,
        state.fit.cost - after.fit.cost,
        "warning",
        ", ".join(names[j] for j in felt),
        f"At t = {time[peak]:.2f} s the residual is {size[peak].max():.0f} times its usual size, on "
        f"{len(felt)} joints at the same time. The arm probably touched something.",
        lambda evidence: excluding(evidence.reading, _segments(near_burst, time, run)),
        after,
    )


def _around(hit: NDArray[np.bool_], time: Array, run: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mask of the rows that are at most `WINDOW` before or after a burst, shape (M,)."""
    near = (np.abs(time[:, None] - time[None, hit]) <= WINDOW) & (run[:, None] == run[None, hit])
    return near.any(axis=1)


def _segments(rows: NDArray[np.bool_], time: Array, run: NDArray[np.int64]) -> list[tuple[float, float]]:
    """Begin and end of each segment of consecutive rows in a mask (M,) [s]."""
    which = np.flatnonzero(rows)
    cuts = np.flatnonzero((np.diff(which) > 1) | (np.diff(run[which]) != 0)) + 1
    return [(float(time[part[0]]), float(time[part[-1]])) for part in np.split(which, cuts)]


def _residual(state: LogState, values: Array) -> Array:
    """Residual torque with given base parameters (b,), zero in rows that are not used, shape (M, n) [N·m or N]."""
    rows = state.rows
    predicted = [x.T @ values[parameters] for x, parameters in zip(rows.columns, rows.parameters, strict=True)]
    return (rows.torque - np.column_stack(predicted)) * rows.mask


def _extrapolation(state: LogState) -> Array:
    """Variance of the predicted torque, computed from the covariance of the parameters, shape (M, n) [(N·m)² or N²].

    If only a few rows determine a parameter, the prediction at these rows has a large variance. They are therefore
    not mistaken for bursts.
    """
    rows, covariance = state.rows, state.fit.covariance
    return np.column_stack(
        [
            np.sum(x * (covariance[np.ix_(parameters, parameters)] @ x), axis=0)
            for x, parameters in zip(rows.columns, rows.parameters, strict=True)
        ]
    )


def _static_friction(state: LogState) -> Array:
    """Square of the Coulomb friction of each joint, reduced where the joint moves, shape (M, n).

    The reduction is the share of time around a row in which the joint hardly moves. There the friction can have any
    value up to the Coulomb friction.
    """
    rows = state.rows
    wide = np.ones(max(1, round(WINDOW * rows.rate)))
    slow = np.abs(rows.motion.dq) < SLOW
    result = np.empty_like(rows.torque)
    for j in range(rows.n):
        parameters = rows.parameters[j]
        dry = sum(
            float(state.fit.values[p]) ** 2 for p, s in zip(parameters, state.symbols(j), strict=True) if s == "FS"
        )
        result[:, j] = dry * np.convolve(slow[:, j], wide / len(wide), mode="same")
    return result


def _level(size: Array) -> Array:
    """Second largest relative residual among the joints in each row, shape (M,).

    If the arm has one joint, the residual of this joint is returned.
    """
    return np.sort(size, axis=1)[:, -min(JOINTS, size.shape[1])]


def _bursts(state: LogState, residual: Array, open_variance: Array | float = 0.0) -> Array:
    """RMS residual of each joint around each row, divided by the usual residual of the joint, shape (M, n)."""
    rows = state.rows
    wide = max(1, round(WINDOW * rows.rate))
    power = np.empty_like(rows.torque)
    for j in range(rows.n):
        power[:, j] = np.convolve(residual[:, j] ** 2, np.ones(wide) / wide, mode="same")
    counted = [power[rows.mask[:, j], j] for j in range(rows.n)]
    usual = np.array([np.percentile(x, USUAL) if len(x) else 1.0 for x in counted])
    return np.sqrt(power / np.maximum(usual + open_variance, np.finfo(float).tiny))


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "contact": "External forces are attributed to parameters of the arm.",
    },
    explain=explain,
)
