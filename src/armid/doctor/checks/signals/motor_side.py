"""Torque of the motors, or a motor current, in the place of joint torque."""

from __future__ import annotations

import numpy as np

from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.log_check import LogCheck
from armid.doctor.log_interpretation import LogState
from armid.errors import Finding
from armid.maths.median import median
from armid.measurement.log_format_remedies import lines

MOTOR, CURRENT = "motor-side", "current-without-gain"

SMALL = 0.3
"""Share of the described torque below which a torque is not that of the joints: descriptions and arms differ by up to
a factor of 2."""

MOTOR_SCALE = 0.04
"""Share below which the effort is a motor torque: then the gear ratio is 25 or more. Drives of arms give 5 to 20 N·m
at the joint for an ampere."""

ALIKE = 0.85
"""Correlation of a joint with the description from which its scale is known."""

MOST_OF = 0.5
"""Share of the loaded joints whose scale must be known: with channels in a wrong order one may correlate by
chance."""

HEAVY = 0.05
"""Described torque, over that of the most loaded joint, below which a joint does not count."""


MOTOR_NOTE = (
    "gear ratios that fit the description's gravity torque; positions are the joints'; use the maker's values"
)
CURRENT_NOTE = "N·m/A that fit the description's gravity torque; use the maker's values"


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports motor torques or currents."""
    return [*evidence.explained(MOTOR), *evidence.explained(CURRENT)]


def explain(state: LogState) -> Explanation | None:
    """Explanation by another scale; `None` if the scale is that of the description."""
    nominal = state.nominal
    if nominal is None:
        return None
    known = (np.abs(nominal.correlation) > ALIKE) & (nominal.size > HEAVY * nominal.size.max())
    heavy = nominal.size > HEAVY * nominal.size.max()
    if known.sum() < MOST_OF * heavy.sum():
        return None
    typical = float(median(np.abs(nominal.scale[known])))
    if typical >= SMALL or typical <= 0.0:
        return None
    scale = np.where(known, np.abs(nominal.scale), typical)
    after = state.with_torque(1.0 / scale)
    names = state.model.robot.joint_names
    listed = ", ".join(f"{names[j]} 1/{1 / abs(nominal.scale[j]):.3g}" for j in np.flatnonzero(known))
    motor = typical < MOTOR_SCALE
    gains = [float(f"{1 / s:.3g}") for s in scale]
    return Explanation(
        MOTOR if motor else CURRENT,
        10.0,  # corrected first, since all other numbers depend on the unit
        "error",
        "effort",
        f"The effort has the shape of the description's torque, but is only a small share of it: {listed}.",
        lambda evidence: _gains(evidence, gains, MOTOR_NOTE if motor else CURRENT_NOTE),
        after,
    )


def _gains(evidence: LogEvidence, gains: list[float], note: str) -> str:
    """Drive gains that correct the log format: joint torque over logged effort, times the gains that it has."""
    given = evidence.reading.drive_gain
    total = np.asarray(gains) * (1.0 if given is None else np.asarray(given))
    return lines(note, drive_gain=[float(f"{gain:.3g}") for gain in total])


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        "motor-side": "All parameters are too small by the gear ratio.",
        "current-without-gain": "All parameters are in units of the drive's current.",
    },
    explain=explain,
    hides=("saturation",),
)
