"""Check for friction that changes during a log, for instance because gears warm up."""

from __future__ import annotations

import numpy as np

from armid.doctor.changes.explanation import explained_by, is_warming
from armid.doctor.changes.judgement import change_of
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import solve
from armid.errors import Finding
from armid.maths.median import median

CODE = "temperature-drift"

CHANGE = 0.15
"""Smallest relative change of friction during the log that is reported."""

SURE = 8.0
"""Number of standard deviations by which the change must differ from zero."""

GAIN = 0.02
"""Smallest decrease of the mean logarithm of the RMS residuals by the change for which it is reported."""

JOINTS = 0.4
"""Share of the joints whose friction must change in the same direction, because gears warm up together."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports the joints whose friction changes during the log, in one finding."""
    return evidence.explained(CODE) or _linear_drift(evidence)


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by friction that changes gradually on several joints; `None` otherwise."""
    change = change_of(state)
    return explained_by(change, CODE, "warning") if change is not None and is_warming(change) else None


def _linear_drift(evidence: LogEvidence) -> list[Finding]:
    """Reports friction that changes linearly with time, which the other faults leave."""
    state = evidence.corrected
    if state is None or state.log.band.is_open:
        return []
    rows, fit = state.rows, state.fit
    time = rows.motion.time
    if np.ptp(time) <= 0.0:
        return []
    share = (time - time.mean()) / float(np.ptp(time))
    extra = np.zeros((rows.n, *rows.torque.shape))
    for j in range(rows.n):
        friction = np.zeros(len(time))
        for symbol, column, p in zip(state.symbols(j), rows.columns[j], rows.parameters[j], strict=True):
            if symbol in ("FV", "FS"):
                friction += fit.values[p] * column
        extra[j, :, j] = friction * share
    drift_fit = solve(rows, extra=extra)
    change, deviation = drift_fit.values[rows.count :], drift_fit.deviation[rows.count :]
    sure = (np.abs(change) > SURE * deviation) & (np.abs(change) > CHANGE) & (deviation > 0.0)
    gain = fit.cost - drift_fit.cost
    sense = np.sign(median(change[sure])) if sure.any() else 0.0
    together = sure & (np.sign(change) == sense)
    if gain < GAIN or together.sum() < JOINTS * rows.n:
        return []
    names = evidence.robot.joint_names
    listed = ", ".join(f"{names[j]} {100 * change[j]:+.0f} %" for j in np.flatnonzero(together))
    return [
        Finding(
            CODE,
            "warning",
            ", ".join(names[j] for j in np.flatnonzero(together)),
            f"Friction changes within {np.ptp(time):.0f} s: {listed}. With this change in the model, the residual "
            f"is {1 - np.exp(-gain):.0%} smaller.",
            "record again with warm gears, or record one log for each temperature and set `friction_per_recording = "
            "true`",
        )
    ]


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        CODE: "The estimated friction is a mean over the log, so its intervals are too narrow for another day.",
    },
    explain=explain,
)
