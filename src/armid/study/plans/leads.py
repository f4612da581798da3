"""Motions before and after an excitation: from a given pose to the start pose, and from the start pose to another."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.excitation.collision.closest_approach import closest_approaches
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.limits.joint_limits import (
    Limits,
)
from armid.excitation.plan import Plan, seconds_for
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.robot.robot import Robot
from armid.study.plans.design_options import DesignGoal

LEAD_SHARE = 0.5
"""Share of the velocity limits that the motions to and from the start pose use."""

LEAD_CHECKS = 200.0
"""Rate at which the motions to and from the start pose are checked for collisions [Hz]."""

LEAD_ACCELERATION = 2.0
"""Acceleration of the motions to and from the start pose if no acceleration limit is given [rad/s² or m/s²]."""


def add_leads(basis: SeriesBasis, x: Array, goal: DesignGoal, limits: Limits, name: str) -> Plan:
    """Plan with motions to and from the start pose, which use at most half of the velocity limits."""
    series = basis.excitation(x, name)
    start = series.at([0.0]).q[0]
    acceleration = np.where(np.isfinite(limits.acceleration), limits.acceleration, LEAD_ACCELERATION)

    def seconds(pose: Array | None) -> float:
        if pose is None:
            return 0.0
        if np.shape(pose) != start.shape:
            raise ArmidError(
                f"A pose before or after the motion has {np.size(pose)} numbers, but the arm has {len(start)} "
                "joints.",
                remedy="give one number for each joint with --begin or --end.",
            )
        return max(seconds_for(pose - start, LEAD_SHARE * limits.velocity, acceleration, limits.jerk), 0.1)

    return Plan(series, goal.goal.repetitions, goal.begin, goal.end, seconds(goal.begin), seconds(goal.end))


def check_leads(plan: Plan, robot: Robot, collision: CollisionOptions | None) -> None:
    """Raises an error if bodies come too close to each other during the motions to and from the start pose.

    Raises:
        ArmidError: Bodies come too close to each other; the message names the pair.
    """
    if collision is None or not plan.lead_in + plan.lead_out:
        return
    series = plan.lead_in + plan.repetitions * plan.excitation.period
    for name, since, seconds in (("begin", 0.0, plan.lead_in), ("end", series, plan.lead_out)):
        if not seconds:
            continue
        q = plan.at(since + np.linspace(0.0, seconds, max(50, round(LEAD_CHECKS * seconds)))).q
        times = since + np.linspace(0.0, seconds, len(q))
        nearest = closest_approaches(collision, robot, times, q)
        close = [each for each in nearest if not each.is_sufficient]
        if close:
            raise ArmidError(
                f"During the motion from or to the {name} pose, {close[0].pair} come too close to each other: "
                f"{1000 * max(close[0].distance, 0.0):.0f} mm instead of at least "
                f"{1000 * close[0].required_distance:.0f} mm.",
                remedy=f"choose another pose with --{name}, or leave --{name} out and move the arm by hand "
                "between this pose and the start pose.",
            )
