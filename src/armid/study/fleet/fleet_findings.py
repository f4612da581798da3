"""Findings about the units of a fleet: which unit is odd, in which joint, and in what."""

from __future__ import annotations

from armid.errors import Finding
from armid.estimation.fleet.fleet_estimate import FleetEstimate
from armid.estimation.fleet.odd_units import FALSE_ALARM, FEWEST, OddBodies, OddUnknown
from armid.robot import Robot


def fleet_findings(estimate: FleetEstimate, robot: Robot) -> tuple[Finding, ...]:
    """Findings about odd units, the clearest first.

    Args:
        estimate: Estimate of the fleet.
        robot: The type of arm.
    """
    if len(estimate.units) < FEWEST:
        evidence = (
            f"With {len(estimate.units)} units no unit is compared with the others; this needs at least {FEWEST}."
        )
        return (Finding("fleet-small", "info", "", evidence, "add the recordings of more units."),)
    return (
        *(_unknown(each, robot) for each in estimate.odd),
        *(_bodies(each, robot) for each in estimate.odd_bodies),
    )


def _unknown(odd: OddUnknown, robot: Robot) -> Finding:
    """Finding about an own parameter or torque scale of a unit that differs from the other units."""
    joint = robot.joints[odd.joint].name
    size = f"{odd.value:.4g}, but {odd.expected:.4g} ± {odd.deviation:.2g} (standard deviation) in the other units"
    evidence = (
        f"unit {odd.unit}: {odd.parameter} is {size}; {abs(odd.score):.1f} standard deviations apart. A fleet "
        f"without odd units has such a finding with a probability of {100.0 * FALSE_ALARM:g} %."
    )
    remedy = f"check the gear, drive and torque sensor of joint {joint} of unit {odd.unit}."
    if odd.parameter.startswith("scale"):
        remedy = (
            f"check the torque constant or torque sensor of joint {joint} of unit {odd.unit}, and its unit of torque."
        )
    return Finding("unit-odd", "warning", joint, evidence, remedy)


def _bodies(odd: OddBodies, robot: Robot) -> Finding:
    """Finding about a unit whose bodies differ from the other units."""
    joint = robot.joints[odd.joint].name
    evidence = (
        f"unit {odd.unit}: its bodies differ from those of the other units. The torques differ most at this joint, "
        f"by {100.0 * odd.effect:.2g} % of its RMS torque; the squared difference is {odd.ratio:.3g} times the "
        "expected one."
    )
    remedy = f"check what unit {odd.unit} carries at joint {joint} and beyond it: tool, cables, or another version."
    return Finding("unit-bodies-odd", "warning", joint, evidence, remedy)
