"""Check for friction that drives instead of braking, while weights and inertias have the right sign.

A controller that compensates friction adds the torque of a friction law to the command. If the logged torque lacks
this part, or lacks more than the friction there is, the motion seems to gain power at every joint.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.doctor.fitted_log import LogState
from armid.errors import Finding

CODE = "friction-negative"

NEGATIVE, JOINTS = 8.0, 2
"""Standard deviations from which the power that a joint loses by friction is negative, and smallest number of joints
where it is. On recorded arms it is down to -6 on one joint."""

POSITIVE = 0.1
"""Standard deviations, relative to the most negative ones, from which a joint brakes: of torques of which some have a
wrong sign, the others brake."""

SIGN = 0.05
"""Decrease of the mean logarithm of the RMS residuals by other signs of the torques, above which signs are wrong."""

OPPOSITE = -0.5
"""Correlation with the described torque below which the torque of a joint has the wrong sign."""

RIGHT = 3.0
"""Mean standard deviations, times the root of the number of joints, from which inertias are positive."""

ALIKE = 0.9
"""Correlation with the described torque from which the sign of the torque is right, too."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports joints with negative friction if the sign of the torque is right."""
    state = evidence.state
    if state is None or state.log.band.is_open:
        return []
    z = state.dissipation
    negative = np.flatnonzero(z < -NEGATIVE)
    if len(negative) < JOINTS or z.max() > -POSITIVE * z.min() or _signs_are_wrong(evidence, state, negative):
        return []
    inertia = float(state.inertia.sum()) / np.sqrt(len(z))
    alike = -1.0 if state.nominal is None else state.nominal.alike
    if inertia < RIGHT and alike < ALIKE:
        return []
    names = [evidence.robot.joint_names[j] for j in negative]
    why = f"inertias are positive ({inertia:.0f} standard deviations)"
    if alike >= ALIKE:
        why = f"the torque agrees with that of {state.reference} (correlation {alike:.2f})"
    listed = ", ".join(f"{name} ({value:.0f})" for name, value in zip(names, z[negative], strict=True))
    text = (
        f"The friction of {len(names)} joints is negative, and no joint brakes clearly, although {why}. Power by "
        f"friction, in standard deviations: {listed}. The torque lacks more than the friction there is: a "
        "compensation of friction was subtracted from it, with a law that is too large, or twice."
    )
    remedy = (
        "log the torque of the motors before friction is subtracted, or switch the compensation of friction off and "
        "record again"
    )
    return [Finding(CODE, "error", ", ".join(names), text, remedy)]


def _signs_are_wrong(evidence: LogEvidence, state: LogState, negative: NDArray[np.intp]) -> bool:
    """True if residuals, or the description, ask for another sign of a torque."""
    if any(each.code == "torque-sign" and each.gain > SIGN for each in evidence.explanations):
        return True
    return state.nominal is not None and bool((state.nominal.correlation[negative] < OPPOSITE).any())


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        CODE: "The estimated friction is negative, so the model gains energy in motion; friction that was subtracted "
        "with another law than that of the model biases the other parameters.",
    },
    hides=("torque-sign",),
    follows=("channel-dead", "velocity-mismatch", "motor-side"),
)
