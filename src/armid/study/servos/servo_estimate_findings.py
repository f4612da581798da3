"""Findings about an estimate of servos."""

from __future__ import annotations

import numpy as np

from armid.errors import Finding
from armid.servo.identify_servo import ServoEstimate
from armid.servo.servo_prior import UNKNOWN_LIMIT

LARGE_SHIFT = 1.0
"""Shift of a parameter by the steps of the integration, in standard deviations, above which a finding says so. A bias
of one deviation lowers the coverage of a 95 % interval to 83 %."""


def servo_estimate_findings(estimate: ServoEstimate) -> list[Finding]:
    """Findings about the search, the largest torques and the integration of the motion."""
    found: list[Finding] = []
    refined, first = (each.total for each in estimate.left_out)
    if not estimate.refined:
        what = (
            f"on parts of the recordings that were left out, the estimate by the output error has an error of "
            f"{1e3 * refined:.3g} mrad and the first estimate one of {1e3 * first:.3g} mrad; the first one was kept"
        )
        found.append(Finding("servo-not-refined", "warning", "", what, "record motion that moves every joint more"))
    if not estimate.fit.settled:
        what = f"the search for the smallest output error did not converge in {estimate.fit.steps} steps"
        found.append(Finding("not-converged", "warning", "", what, "check the commands with `armid doctor`"))
    described = np.array([joint.effort_limit for joint in estimate.model.robot.joints])
    unused = np.flatnonzero(np.isfinite(described) & np.isinf(estimate.parameters.limit))
    if unused.size:
        names = estimate.model.robot.joint_names
        what = (
            "the motion exceeds the largest torque that the description states, and no row looks saturated: "
            f"{', '.join(f'{names[j]} ({described[j]:.3g})' for j in unused)}; these joints are simulated without one"
        )
        remedy = "state the largest torque of the servos (limit in [servo]), or correct the effort limits"
        found.append(Finding("servo-limit-unused", "warning", "", what, remedy))
    recorded = estimate.unknowns.deviations.limit == UNKNOWN_LIMIT
    other = np.flatnonzero(recorded & np.isfinite(described) & (estimate.unknowns.mean.limit != described))
    if other.size:
        names, limit = estimate.model.robot.joint_names, estimate.parameters.limit
        what = (
            "the recordings show another largest torque than the description states: "
            f"{', '.join(f'{names[j]} ({limit[j]:.3g} instead of {described[j]:.3g})' for j in other)}"
        )
        remedy = "state the largest torque of the servos (limit in [servo]), or correct the effort limits"
        found.append(Finding("servo-limit-differs", "warning", "", what, remedy))
    if not estimate.fit.integration <= LARGE_SHIFT:  # also if the motion with shorter steps diverges
        what = (
            f"steps of the integration of {1e3 * estimate.model.longest_step:.3g} ms shift a parameter by "
            f"{estimate.fit.integration:.2g} of its standard deviations, so intervals are too narrow"
        )
        remedy = "take the intervals for lower limits; the positions are more exact than the simulated motion"
        found.append(Finding("integration-steps", "warning", "", what, remedy))
    if estimate.fit.unsettled:
        what = f"{estimate.fit.unsettled} integration steps did not converge"
        found.append(Finding("integration-unsettled", "warning", "", what, "check the limits of the torque"))
    return found
