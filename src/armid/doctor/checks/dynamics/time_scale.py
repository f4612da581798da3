"""Check for a wrong sample rate or unit of the clock, from the ratio of gravity torques to inertial torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.downsample import DownsampledLog
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import cost_of, make_rows, tables
from armid.doctor.remedy_trial import HELPS
from armid.errors import Finding
from armid.measurement.remedy_builders import lines
from armid.model.motion import Motion

CODE = "time-scale"

FACTORS = 2.0 ** (np.arange(-6.0, 6.5) / 2.0)
"""Factors on velocities that are tried first."""

HINT = 0.15
"""Decrease of the mean logarithm of the RMS residuals from which the best of `FACTORS` is refined."""

GAIN = 0.35
"""Smallest decrease of the mean logarithm of the RMS residuals. On the recorded arms it is up to 0.2, for a factor of
one half."""

APART = 1.35
"""Smallest factor, or its inverse, that is a fault. A wrong rate differs from the true one by a factor of two or
more."""

SHARP = 0.1
"""Smallest increase of the mean logarithm of the RMS residuals for half and twice the factor, with dry friction of
the same shape. If accelerations are too slow to matter, another shape of dry friction alone would look like another
scale of time."""

CALM = 0.15
"""Conflict up to which the joints agree in the scale of time."""

STEPS = 7
"""Number of steps in which the factor is refined. Each halves the distance to the neighbouring factors."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports a wrong scale of time if the model fits the log better with another scale."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a wrong scale of time; `None` if the scale of the log is correct.

    The torque by gravity does not depend on time, the torque by inertia does. Both depend on the same first moments,
    so a wrong scale of time increases the residual: if velocities are too large by a factor s, the first moments from
    inertia are too small by s².
    """
    if state.conflict < CALM:
        return None
    rough = _costs(state, 1.0)
    cost = [rough(factor) for factor in FACTORS]
    if min(cost) > rough(1.0) - HINT:
        return None
    first = float(FACTORS[np.argmin(cost)])
    cost_with = _costs(state, first)
    factor = _refined(cost_with, first)
    around = min(cost_with(0.5 * factor), cost_with(2.0 * factor))
    if max(factor, 1.0 / factor) < APART or around < cost_with(factor) + SHARP:
        return None
    after = state.on(_scaled(state.log, factor))
    gain = state.fit.cost - after.fit.cost
    if gain < GAIN:
        return None
    return Explanation(
        CODE,
        gain,
        "error",
        "time",
        f"With rows {1.0 / factor:.3g} times as far apart in time, so that velocities are {factor:.3g} times as "
        f"large, the residual of one model for all joints is {1 - np.exp(-gain):.0%} smaller.",
        lambda evidence: _remedy(evidence, factor),
        after,
        worse=HELPS,
    )


def _costs(state: LogState, about: float) -> Callable[[float], float]:
    """Function of a factor on the velocities, which returns the mean logarithm of the RMS residuals with this factor.

    The torque of the links is the sum of a part at rest (gravity) and a part that is proportional to the square of
    the factor. The columns of friction and rotors have no part at rest, and their length has no effect on a fit. So
    the products of these two parts of the columns are sufficient for all factors near `about`, for which the shape of
    dry friction is computed.
    """
    rows = state.rows
    at_rest = make_rows(state.source, _scaled(state.log, 0.0))
    there = rows if about == 1.0 else make_rows(state.source, _scaled(state.log, about))
    both = zip(*(tables(replace(each, mask=rows.mask)) for each in (at_rest, there)), strict=True)
    pairs = [_products(still, whole) for still, whole in both]

    def cost_with(factor: float) -> float:
        square = (factor / about) ** 2
        return cost_of(rows, [rest + square * (mixed + square * moving) for rest, mixed, moving in pairs])

    return cost_with


def _products(still: Array, whole: Array) -> tuple[Array, Array, Array]:
    """Scalar products of columns at rest and of their changes by motion: rest-rest, rest-change, change-change."""
    moving = whole - still  # zero in the row of the torque
    mixed = still @ moving.T
    return still @ still.T, mixed + mixed.T, moving @ moving.T


def _refined(cost_with: Callable[[float], float], factor: float) -> float:
    """Factor with the smallest residual near a given factor, found by halving the distance to the neighbours."""
    ratio, best = np.sqrt(FACTORS[1] / FACTORS[0]), cost_with(factor)
    for _ in range(STEPS):
        for trial in (factor * ratio, factor / ratio):
            cost = cost_with(trial)
            if cost < best:
                factor, best = trial, cost
        ratio = np.sqrt(ratio)
    return float(factor)


def _scaled(log: DownsampledLog, factor: float) -> DownsampledLog:
    """The log with its velocities multiplied by a factor, and its accelerations by the square of the factor."""

    def changed(m: Motion) -> Motion:
        ddq: Array = m.ddq * factor**2
        return replace(m, dq=m.dq * factor, ddq=ddq)

    return replace(log, runs=tuple(replace(run, motion=changed(run.motion)) for run in log.runs))


def _remedy(evidence: LogEvidence, factor: float) -> str:
    """Line of a study with the sample rate or the unit of time that corrects a wrong factor on the velocities."""
    recording, reading = evidence.recording, evidence.reading
    assert recording is not None
    note = "about; use the true value"
    if reading.rate is not None or recording.time is None:
        return lines(note, rate=float(f"{evidence.rate * factor:.3g}"))
    return lines(f"s, {note}", time_unit=float(f"{(reading.time_unit or 1.0) / factor:.3g}"))


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        CODE: "Velocities are wrong by a factor and accelerations by its square, so inertia and friction are wrong.",
    },
    explain=explain,
    hides=("velocity-mismatch",),
)
