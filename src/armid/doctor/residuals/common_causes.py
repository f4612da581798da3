"""Explanation of a misfit by one cause in all torques: a wave in time, or gains that fall with the load.

What a model lacks differs from joint to joint. A cause in the supply, the grounding or the base is in all torques,
and with it the residuals of most joints fall together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_input import Explanation
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import QuickRows, solve
from armid.doctor.remedy_trial import HELPS, try_remedy
from armid.doctor.residuals.added_columns import AddedColumns
from armid.doctor.residuals.wave_in_time import strongest_wave

WAVE, GAIN = 0.4, 0.36
"""Smallest decrease of the mean logarithm of the RMS residuals by a wave in time, and by gains that depend on load.
In recordings of eight arms, whole, in halves and in thirds, it is at most 0.28 and 0.27; a hum of half the standard
deviation of each torque gives 0.5 to 1.3, a supply that sags by 45 % under load 0.4 to 0.8."""

JOINTS = 3
"""Smallest number of joints."""


@dataclass(frozen=True, slots=True, eq=False)
class CommonCause:
    """Functions that the residuals of all joints may follow.

    Attributes:
        code: Code of the finding.
        severity: Its severity.
        least: Smallest decrease of the mean logarithm of the RMS residuals.
        text: What the torques contain, in words.
        remedy: Remedy.
        columns: Values of the functions, shape (k, M, n); each joint has coefficients of its own.
    """

    code: str
    severity: Literal["warning"]
    least: float
    text: str
    remedy: str
    columns: Array


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a cause in all torques; `None` if there is none."""
    if state.rows.n < JOINTS or state.log.band.is_open or not all(run.consecutive for run in state.log.runs):
        return None
    added = AddedColumns(state)
    tried = [(_gain(added, cause), cause) for cause in (_wave(state), _load(state))]
    found = [each for each in tried if each[0] > each[1].least]
    best = max(found, key=lambda each: each[0] - each[1].least, default=None)
    return None if best is None else _explained(state, best[1])


def _gain(added: AddedColumns, cause: CommonCause) -> float:
    """Decrease of the mean logarithm of the RMS residuals by a cause, without what is expected by chance."""
    fit, rows = added.state.fit, added.state.rows
    chance = len(cause.columns) * fit.autocorrelation / np.maximum(rows.mask.sum(axis=0), 1)
    left = 1.0 + chance - [added.decrease_together(j, cause.columns[:, :, j]) for j in range(rows.n)]
    return float(np.mean(-0.5 * np.log(np.clip(left, 0.01, None))))


def _explained(state: LogState, cause: CommonCause) -> Explanation | None:
    """Explanation by a cause, whose torque is taken out of the log."""
    after = _with_columns(state.rows, cause.columns)
    fit = solve(after)
    gain = state.fit.cost - fit.cost
    if gain < cause.least:
        return None
    values = fit.values[state.rows.count :].reshape(state.rows.n, -1)
    torque = np.einsum("jk,kmj->mj", values, cause.columns)
    names = state.model.robot.joint_names
    sizes = ", ".join(
        f"{name} {float(np.std(torque[:, j])):.3g} {state.model.robot.joints[j].effort_unit}"
        for j, name in enumerate(names)
    )
    return Explanation(
        cause.code,
        gain,
        cause.severity,
        "",
        f"{cause.text} (standard deviation: {sizes}). With it in the model, the residual is "
        f"{1.0 - np.exp(-gain):.0%} smaller.",
        lambda evidence: cause.remedy,
        state.without_torque(torque),
        worse=HELPS,
        trial=try_remedy(state.rows, after),
    )


def _with_columns(rows: QuickRows, added: Array) -> QuickRows:
    """Rows with columns (k, M, n) that have coefficients of their own for each joint."""
    k, n = len(added), rows.n
    numbers = rows.count + np.arange(k * n, dtype=np.int32).reshape(n, k)
    columns = tuple(np.vstack([own, added[:, :, j]]) for j, own in enumerate(rows.columns))
    parameters = tuple(np.append(own, numbers[j]) for j, own in enumerate(rows.parameters))
    return QuickRows(
        columns, parameters, rows.count + k * n, rows.motion, rows.torque, rows.mask, rows.run, rows.rate
    )


def _wave(state: LogState) -> CommonCause:
    """Wave in time with the frequency that most residuals contain."""
    frequency, phase = strongest_wave(state.rows, state.fit.residual / state.fit.sigma)
    columns = np.repeat(phase[:, :, None], state.rows.n, axis=2)
    text = f"The torques contain a wave of {frequency:.2g} Hz that no motion causes"
    remedy = "find out where the wave comes from (hum of the mains, an alias, vibration of the base) and record again"
    return CommonCause("channel-noisy", "warning", WAVE, text, remedy, columns)


def _load(state: LogState) -> CommonCause:
    """Gains of all torques that depend on speed, torque and power of all joints together."""
    rows, fit = state.rows, state.fit
    torque = np.where(rows.mask, rows.torque - fit.residual, 0.0)
    # The measured torque would show a change of all torques along the log in their load.
    speed, effort = (
        np.abs(x) / np.maximum(np.sqrt(np.mean(x**2, axis=0)), np.finfo(float).tiny) for x in (rows.motion.dq, torque)
    )
    together = np.stack([each.sum(axis=1) for each in (speed, effort, speed * effort)])
    text = "The gains of the torques depend on the speed, torque or power of all joints together"
    remedy = "find out what limits the drives together (supply, brake chopper, temperature) and record more gently"
    return CommonCause("torque-gain", "warning", GAIN, text, remedy, together[:, :, None] * torque)
