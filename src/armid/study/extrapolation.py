"""Is a model asked for more than it was trained on? Friction is known at the speeds that were recorded, not above."""

from __future__ import annotations

import numpy as np

from armid.errors import Finding
from armid.measurement.observations import Observations
from armid.robot import Robot
from armid.values import Array

__all__ = ["highest_speeds", "speed_finding"]

FAR = 1.25
"""Speed asked for over the highest that trained, from which on it is worth a word: a quarter beyond is more than the
difference of two draws of one kind of motion."""

LEAST = 0.02
"""Speed by which it must be more [rad/s or m/s]: the width over which dry friction turns its sign, below which a
joint that rested in training still creeps."""


def highest_speeds(observations: Observations) -> Array:
    """Highest speed of each joint in its rows that count, shape (n,) [rad/s or m/s]; 0 where none does."""
    speeds = [np.max(np.abs(run.motion.dq[run.rows]) * run.mask, axis=0, initial=0.0) for run in observations.runs]
    return np.max(speeds, axis=0)


def speed_finding(robot: Robot, trained: Array | None, asked: Array, where: str) -> Finding | None:
    """Joints that are asked for torque far beyond the speeds that trained their friction, or `None`.

    Args:
        robot: The arm.
        trained: Highest speed that trained each joint, shape (n,) [rad/s or m/s]; `None` where it is not known.
        asked: Highest speed that is asked for, shape (n,).
        where: The recording or plan.
    """
    if trained is None:
        return None
    beyond = [
        f"{joint.name} was trained up to {known:.3g} {joint.unit}/s and is asked for {speed:.3g} {joint.unit}/s"
        for joint, known, speed in zip(robot.joints, trained, asked, strict=True)
        if speed > max(FAR * known, known + LEAST)
    ]
    if not beyond:
        return None
    return Finding(
        "speed-beyond",
        "warning",
        "",
        f"{where}: {'; '.join(beyond)}. Friction there is a continuation of its law, not a measurement.",
        "train on a motion as fast as what is asked for.",
    )
