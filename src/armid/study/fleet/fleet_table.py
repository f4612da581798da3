"""Table of the own parameters and torque scales of all units of a fleet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.maths.distributions import NORMAL
from armid.study.fleet.identify_fleet import FleetIdentification


@dataclass(frozen=True, slots=True)
class FleetRow:
    """Own parameter or torque scale of one unit.

    Attributes:
        of: Name of the unit.
        joint: Name of the joint.
        parameter: Name of the parameter; `scale_2` is the torque scale of joint 2.
        value: Value.
        half: Half width of the 95 % interval.
        unit: Unit of the value.
        score: Difference from the other units, divided by its standard deviation; NaN if it is not judged.
        odd: True if the value differs from the other units.
    """

    of: str
    joint: str
    parameter: str
    value: float
    half: float
    unit: str
    score: float
    odd: bool


def fleet_rows(fleet: FleetIdentification) -> tuple[FleetRow, ...]:
    """Rows for all units, each with its own parameters and torque scales, in the order of the fleet file."""
    estimate, base = fleet.estimate, fleet.base
    joints = fleet.robot.joint_names
    place: dict[str, int] = {name: k for k, name in enumerate(base.names)}
    odd = {(each.unit, each.parameter): each.joint for each in estimate.odd}
    rows: list[FleetRow] = []
    for u, (name, result) in enumerate(zip(estimate.units, fleet.results, strict=True)):
        intervals = result.estimate.fit.intervals
        for k, parameter in enumerate(estimate.own.names):
            joint = joints[estimate.own.joint[k]]
            if parameter in place:
                at = place[parameter]
                value, half = estimate.values[u, at], 0.5 * float(np.ptp(intervals[at]))
                unit = base.units[at]
            else:
                j = int(estimate.own.joint[k])
                value, half, unit = estimate.scale[u, j], NORMAL * estimate.scale_deviation[u, j], ""
            is_odd = (name, parameter) in odd
            rows.append(
                FleetRow(name, joint, parameter, float(value), float(half), unit, estimate.score[u, k], is_odd)
            )
    return tuple(rows)
