"""Delay of the torques of all joints against the positions, estimated by Gauss-Newton steps."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import QuickRows, solve
from armid.maths.birge_ratio import birge_ratio
from armid.maths.signals.fourier_transform import frequencies, inverse, spectrum
from armid.maths.spline import spline_slopes
from armid.measurement.observations import ObservedRun

STEPS, SETTLED = 8, 0.1
"""Largest number of Gauss-Newton steps, and size of a step, in standard deviations, below which the iteration
ends."""

LEAST_SHARE = 0.2
"""Smallest share of a delay that a Gauss-Newton step is assumed to remove."""

PADDING = 0.25
"""Padding of a run at its ends before it is shifted [s]."""


def delay_of(state: LogState) -> tuple[float, float, LogState]:
    """Estimates the delay of the torque against the positions [s].

    Also returns its standard deviation and the corrected log.

    Each Gauss-Newton step uses the time derivative of the model's torque, because noise in the derivative of the
    measured torque would bias the step towards zero. Noise of the positions makes every step too small by the same
    factor; this factor is estimated from two steps. If the delays of single joints differ by more than their standard
    deviations, for instance because of noisy positions or unmodelled friction, the standard deviation is enlarged.
    """
    delay, deviation, share, before, step = 0.0, np.inf, 1.0, 0.0, 0.0
    for _ in range(STEPS):
        rows = state.rows
        fit = solve(rows, extra=slopes_of(rows, rows.torque - state.fit.residual)[None])
        late = -float(fit.values[-1])
        if step:
            share = min(max((before - late) / step, LEAST_SHARE), 1.0)
        before, step, deviation = late, late / share, float(fit.deviation[-1]) / share
        delay += step
        state = with_torque_advanced(state, step)
        if abs(step) < SETTLED * deviation:
            break
    return delay, deviation * birge_ratio(*delay_of_each_joint(state)), state


def delay_of_each_joint(state: LogState) -> tuple[Array, Array]:
    """Separate delays of the torques of the joints and their standard deviations, shape (n,) each [s]."""
    rows = state.rows
    extra = np.zeros((rows.n, *rows.torque.shape))
    across = np.arange(rows.n)
    extra[across, :, across] = slopes_of(rows, rows.torque - state.fit.residual).T
    fit = solve(rows, extra=extra)
    return -fit.values[-rows.n :], fit.deviation[-rows.n :]


def with_torque_advanced(state: LogState, seconds: float) -> LogState:
    """The log with its torque moved to earlier times by some seconds, which corrects a delay of the torque."""
    return state.with_torques([_advanced(run, seconds) for run in state.log.runs])


def slopes_of(rows: QuickRows, values: Array) -> Array:
    """Time derivative of values that are given at the M rows, shape (M, …), computed separately for each run."""
    slopes = np.zeros_like(values)
    for run in np.unique(rows.run):
        inside = rows.run == run
        slopes[inside] = spline_slopes(np.arange(inside.sum()) / rows.rate, values[inside])
    return slopes


def _advanced(run: ObservedRun, seconds: float) -> Array:
    """Torque (N, n) of a run, moved to earlier times by some seconds and continued by odd reflection."""
    samples = seconds * run.rate
    pad = min(len(run.torque) - 1, int((PADDING + abs(seconds)) * run.rate) + 8)
    x: Array = run.torque
    before, behind = 2 * x[0] - x[pad:0:-1], 2 * x[-1] - x[-2 : -pad - 2 : -1]
    whole = np.concatenate([before, x, behind])
    line = np.linspace(0.0, 1.0, len(whole))[:, None]
    trend = whole[0] + (whole[-1] - whole[0]) * line  # makes the ends equal
    turn = np.exp(2j * np.pi * frequencies(len(whole)) * samples)[:, None]
    moved = (
        inverse(spectrum(whole - trend) * turn, len(whole)) + trend + (whole[-1] - whole[0]) * samples / len(whole)
    )
    return np.ascontiguousarray(moved[pad : pad + len(x)])
