"""Friction around reversals of a joint, where hysteresis is visible."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from armid.checked_array import Array
from armid.report.data.recording_data import RecordingData

HALF_WINDOW = 0.6
"""Time that a plot shows before and after a reversal [s]; several times the duration of presliding in a gear."""

STEPS = 41

MOVING = 0.05
"""Smallest speed of a joint before and after a reversal, as a share of the largest speed of the joint. Sign changes
of the velocity at lower speeds are noise at standstill."""


@dataclass(frozen=True, eq=False, slots=True)
class Reversals:
    """Friction of one joint around R reversals, at K instants; positive along the motion after the reversal.

    The mean of the model's friction around each reversal is subtracted from the measured friction and from the
    model's friction. This removes offsets between reversals.

    Attributes:
        time: Time since the reversal, shape (K,) [s].
        observed: Measured torque minus the torque of the model without friction, shape (R, K) [N·m or N].
        fitted: Friction of the model, shape (R, K) [N·m or N].
    """

    time: Array
    observed: Array
    fitted: Array


def find_reversals(recordings: Sequence[RecordingData], j: int) -> Reversals:
    """Friction of joint `j` around each reversal whose rows within `HALF_WINDOW` are all valid."""
    grid = np.linspace(-HALF_WINDOW, HALF_WINDOW, STEPS)
    fastest = max((float(np.abs(each.dq[:, j]).max()) for each in recordings), default=0.0)
    observed: list[Array] = []
    fitted: list[Array] = []
    for each in (each for each in recordings if each.is_consecutive):
        friction = each.residual[:, j] + each.friction[:, j]
        for start, stop in pairwise(each.starts):
            time, dq = each.time[start:stop], each.dq[start:stop, j]
            for at, direction in _crossings(time, dq, MOVING * fastest):
                around = at + grid
                if around[0] < time[0] or around[-1] > time[-1]:
                    continue
                measured = direction * np.interp(around, time, friction[start:stop])
                if np.isfinite(measured).all():
                    model = direction * np.interp(around, time, each.friction[start:stop, j])
                    observed.append(measured - model.mean())
                    fitted.append(model - model.mean())
    empty = np.zeros((0, STEPS))
    return Reversals(grid, np.array(observed) if observed else empty, np.array(fitted) if fitted else empty)


def since_reversal(time: Array, dq: Array) -> Array:
    """Time since the last reversal of a joint at M instants, shape (M,) [s]; NaN before the first reversal."""
    turned = np.flatnonzero(np.diff(np.sign(dq)) != 0) + 1
    last = np.searchsorted(turned, np.arange(len(dq)), side="right") - 1
    elapsed = np.full(len(dq), np.nan)
    known = last >= 0
    elapsed[known] = time[known] - time[turned[last[known]]]
    return elapsed


def _crossings(time: Array, dq: Array, least: float) -> list[tuple[float, float]]:
    """Time [s] of each reversal of a joint, and sign of the velocity after it.

    A reversal counts only if the speed reaches `least` [rad/s or m/s] before and after it, within `HALF_WINDOW`.
    """
    crossings: list[tuple[float, float]] = []
    rows = np.flatnonzero(np.sign(dq[:-1]) * np.sign(dq[1:]) < 0.0)
    for k in rows:
        at = float(time[k] - dq[k] * (time[k + 1] - time[k]) / (dq[k + 1] - dq[k]))
        near = np.abs(time - at) <= HALF_WINDOW
        before, after = near & (time < at), near & (time > at)
        direction = float(np.sign(dq[k + 1]))
        if before.any() and after.any():
            enough = min(float(np.max(-direction * dq[before])), float(np.max(direction * dq[after])))
            if enough >= least:
                crossings.append((at, direction))
    return crossings
