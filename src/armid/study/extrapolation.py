"""Extrapolation in speed: joints whose friction is used beyond the speeds of the training recordings."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.measurement.observations import Observations
from armid.robot import Robot

FAR = 1.25
"""Ratio of the speed of a joint to its highest speed in training, above which a finding is reported. The highest
speeds of two random motions with the same limits differ by less than this ratio."""

LEAST = 0.02
"""Smallest difference between a speed and the highest speed in training at which a finding is reported [rad/s or
m/s]. It is the width of Coulomb friction: a joint that rested in training may move more slowly than this."""


def highest_speeds(observations: Observations) -> Array:
    """Highest speed of each joint in the rows that are used, shape (n,) [rad/s or m/s]; 0 if none are used."""
    speeds = [np.max(np.abs(run.motion.dq[run.rows]) * run.mask, axis=0, initial=0.0) for run in observations.runs]
    return np.max(speeds, axis=0)


def speed_finding(robot: Robot, trained: Array | None, requested: Array, where: str) -> Finding | None:
    """Finding on joints whose speed is far above their highest speed in training; `None` without such joints.

    Args:
        robot: The arm.
        trained: Highest speed of each joint in training, shape (n,) [rad/s or m/s]; `None` where it is unknown.
        requested: Highest speed of each joint in the new motion, shape (n,) [rad/s or m/s].
        where: Name of the recording or plan.
    """
    if trained is None:
        return None
    beyond = [
        f"{joint.name} reaches {speed:.3g} {joint.unit}/s, but only {known:.3g} {joint.unit}/s in training"
        for joint, known, speed in zip(robot.joints, trained, requested, strict=True)
        if speed > max(FAR * known, known + LEAST)
    ]
    if not beyond:
        return None
    return Finding(
        "speed-beyond",
        "warning",
        "",
        f"{where}: {'; '.join(beyond)}. At such speeds, friction is extrapolated, not measured.",
        "record a training motion that is as fast as this motion, and identify again.",
    )
