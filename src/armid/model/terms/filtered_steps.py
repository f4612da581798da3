"""Steps of torque laws at reversals in recordings whose samples were filtered and decimated.

Where a joint reverses, friction steps within a moment. In a recording whose rate was reduced, this step has passed
the filter of the reduction and appears in several samples. A column of the law, evaluated at the samples, would step
between two samples wherever between them the joint reversed; so the filtered step takes its place.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from armid.checked_array import Array
from armid.model.torque_law_expression import Expression, evaluate

SLOW = 1e-9
"""Velocity on each side of a reversal at which the step of a law is measured [rad/s or m/s]: far below the width of
every smooth sign."""


def sign_deviations(dq: Array, taps: Array, step: int) -> Array:
    """Filtered signs of velocities, less their signs at the samples, shape (N, n).

    The instant of a reversal is interpolated linearly. The deviations are zero away from reversals.

    Args:
        dq: Velocities at the reduced rate, shape (N, n).
        taps: Symmetric taps of the filter at the full rate, with the sum one, shape (2h + 1,).
        step: Number of samples at the full rate for each sample.
    """
    half = len(taps) // 2
    # The sum of the taps behind an instant, whose samples are centred on the taps.
    places = (np.arange(len(taps) + 1) - half - 0.5) / step
    passed = 2.0 * np.concatenate([[0.0], np.cumsum(taps)]) - 1.0
    reach = int(np.ceil(half / step)) + 1
    found = np.zeros_like(dq)
    for j in range(dq.shape[1]):
        moving = np.flatnonzero(dq[:, j])  # a sample of exactly zero belongs to the reversal around it
        speed = dq[moving, j]
        turns = np.flatnonzero((speed[1:] > 0.0) != (speed[:-1] > 0.0))
        before, behind = moving[turns], moving[turns + 1]
        brief = behind - before <= 2  # otherwise the joint rested
        before, behind, turns = before[brief], behind[brief], turns[brief]
        share = speed[turns] / (speed[turns] - speed[turns + 1])
        instant = before + share * (behind - before)
        rows = before[:, None] + np.arange(-reach, reach + 2)
        away = rows - instant[:, None]
        inside = (rows >= 0) & (rows < len(dq))
        still = (np.abs(away) < 1.0) & (dq[np.clip(rows, 0, len(dq) - 1), j] == 0.0)  # whose sign is zero
        change = np.interp(away, places, passed) - np.where(still, 0.0, np.sign(away))
        change *= np.sign(speed[turns + 1])[:, None]
        np.add.at(found[:, j], rows[inside], change[inside])
    return found


def filtered_steps(expression: Expression, environment: Mapping[str, Array], deviation: Array) -> Array:
    """Filtered steps of a law at reversals, less the steps between samples, shape (..., N).

    A law that is continuous in the velocity has none.

    Args:
        expression: Expression of the law, without a hysteresis state.
        environment: Values of the symbols of the law at the samples, shape (..., N) each; `dq` is one of them.
        deviation: Filtered sign of the velocity of the coordinate, less its sign, shape (..., N).
    """
    result, found = np.zeros_like(deviation), np.nonzero(deviation)
    if found[0].size:
        here = {name: each[found] for name, each in environment.items()}
        at_rest = np.full(found[0].size, SLOW)
        before, behind = (evaluate(expression, {**here, "dq": sign * at_rest}) for sign in (-1.0, 1.0))
        result[found] = 0.5 * (behind - before) * deviation[found]
    return result
