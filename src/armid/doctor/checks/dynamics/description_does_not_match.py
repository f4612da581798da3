"""Check whether the description belongs to the recorded arm: described and measured torque are compared."""

from __future__ import annotations

import numpy as np

from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.doctor.checks.signals.motor_side import LARGE, has_placeholder_masses
from armid.errors import Finding

CODE = "description-does-not-match"

LEAST = 0.7
"""Correlation of the measured with the described torque below which the description does not match. With the right
description it was 0.965 or more on 16 recordings of eight arms and on 45 simulated logs, some with other masses."""

LEAST_OF_LARGE = 0.9
"""Correlation below which the description does not match, if the torque is more than `LARGE` times the described
torque. No arm with this description has such a torque."""

CLEAR = 2.0
"""Smallest ratio of the described torque of a joint to the residual of the fit for which the joint is compared. If
the measured torque is larger, the described torque is first multiplied by their ratio: the torque of a small arm is
below the residuals of a large arm."""

HEAVY = 0.05
"""Smallest ratio of the described torque of a joint to the largest described torque of all joints for which the joint
is compared."""

FEWEST = 2
"""Smallest number of joints to compare."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports that the described torque is not correlated with the measured torque, if no other fault is the reason.

    A model with free parameters always fits a log better than the description does. Therefore friction, offset, rotor
    inertia and a separate scale of each joint are fitted first. A finding is reported only if even then the shape of
    the torque differs.
    """
    state = evidence.state
    if state is None or evidence.explanations or state.nominal is None or has_placeholder_masses(state):
        return []
    nominal = state.nominal
    scale = np.abs(nominal.scale)
    compared = (np.maximum(scale, 1.0) * nominal.size > CLEAR * state.fit.sigma) & (
        nominal.size > HEAVY * nominal.size.max()
    )
    if compared.sum() < FEWEST:
        return []
    weight = nominal.size[compared]
    alike = float(weight @ nominal.correlation[compared] / weight.sum())
    names = state.model.robot.joint_names
    typical = float(np.median(scale[compared]))
    if alike >= (LEAST_OF_LARGE if typical > LARGE else LEAST):
        return []
    larger = f", and the measured torque is about {typical:.2g} times as large" if typical > LARGE else ""
    listed = ", ".join(f"{names[j]} {nominal.correlation[j]:.2f}" for j in np.flatnonzero(compared))
    cause = (
        f"Possible causes: the log or {state.reference} belongs to another arm, the measured torque does not contain "
        f"gravity, or springs or counterweights are missing in {state.reference}."
    )
    return [
        Finding(
            CODE,
            "error" if larger else "warning",
            "",
            f"The measured torque does not have the shape of the torque of {state.reference}: without friction and "
            f"rotor inertia, the correlation of the two is {alike:.2f} ({listed}){larger}. {cause}",
            f"check whether {state.reference} belongs to the recorded arm, and whether the torque contains gravity",
        )
    ]


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={CODE: "Parameters of one arm are fitted to the motion of another arm, and are valid for neither arm."},
    follows=(
        "channel-dead",
        "clock-gap",
        "clock-missing",
        "clock-rate",
        "clock-unit",
        "current-without-gain",
        "degrees",
        "effort-missing",
        "motor-side",
        "velocity-mismatch",
    ),
)
