"""Means of torque laws over the time between two samples, where a velocity changes its sign within it.

If the rate of a recording is reduced, the torque at a sample is a mean over the interval around it. Most laws hardly
change within an interval, but friction that depends on the sign of a velocity does when the joint reverses. Its mean
is computed on both sides of the reversal, with a velocity that changes linearly.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from armid.checked_array import Array
from armid.model.torque_law_expression import Expression, evaluate

GAUSS = 0.5 / np.sqrt(3.0)
"""Distance of the two points of Gaussian quadrature from the middle of an interval, divided by its length."""


def set_means_at_reversals(
    values: Array, expression: Expression, environment: Mapping[str, Array], acceleration: Array, seconds: float
) -> None:
    """Replaces values of a law by their means over an interval, at the samples whose interval contains a reversal.

    Args:
        values: Values of the law at N samples, shape (..., N); changed in place.
        expression: Expression of the law, without a hysteresis state.
        environment: Values of the symbols of the law at the samples, shape (..., N) each; `dq` is one of them.
        acceleration: Acceleration of the coordinate of the law, shape (..., N) [rad/s² or m/s²].
        seconds: Length of the interval around each sample [s].
    """
    half = 0.5 * seconds
    found = np.nonzero(np.abs(environment["dq"]) < half * np.abs(acceleration))
    if not found[0].size:
        return
    here = {name: each[found] for name, each in environment.items()}
    speed, acceleration = here["dq"], acceleration[found]
    crossing = -speed / acceleration  # time from the sample to the reversal
    mean = np.zeros(found[0].size)
    for begin, end in ((-half, crossing), (crossing, half)):
        length = end - begin
        for point in (-GAUSS, GAUSS):
            moment = 0.5 * (begin + end) + point * length
            then = {**here, "dq": speed + acceleration * moment}
            if "q" in here:
                then["q"] = here["q"] + (speed + 0.5 * acceleration * moment) * moment
            mean += 0.5 * length / seconds * evaluate(expression, then)
    values[found] = mean
