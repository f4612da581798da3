"""A small arm whose truth is known, for the tests of the lab."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from armid.excitation.fourier import Excitation
from armid.lab.friction import Friction
from armid.lab.known_arms import KnownArm
from armid.lab.options import LabOptions
from armid.lab.sensors import Sensing, SensorChannel
from labs import FRICTION, PERIOD, small_model, small_plan

EXACT = Sensing(100.0, SensorChannel(), SensorChannel())
"""Sensors that say what is."""


def small_arm(**changes: Any) -> KnownArm:
    """The small arm with its own plain friction."""
    robot = small_model().robot
    inertial = robot.inertial_vector
    assert inertial is not None
    friction = Friction(np.array(FRICTION["FV"]), np.array(FRICTION["FS"]))
    return replace(KnownArm(robot, inertial, friction, np.zeros(3)), **changes)


def smooth_arm(**changes: Any) -> KnownArm:
    """The small arm without friction."""
    return small_arm(friction=Friction.none(3), **changes)


def short_plan(seed: int = 1, period: float = PERIOD) -> Excitation:
    """A motion of the small arm, played over another period."""
    return small_plan(seed).stretched(period)


def lab(**changes: Any) -> LabOptions:
    """Options of a short simulation."""
    return replace(LabOptions(lead_in=0.5, physics_rate=2000.0, sensing=EXACT), **changes)
