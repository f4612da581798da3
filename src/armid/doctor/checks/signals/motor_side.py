"""Torque in another unit than the joints': of the motors, or a current."""

from __future__ import annotations

import numpy as np

from armid.doctor.evidence import LogEvidence
from armid.doctor.explanation import Explanation, LogState
from armid.errors import Finding
from armid.measurement.remedy import lines

__all__ = ["check", "explain"]

MOTOR, CURRENT = "motor-side", "current-without-gain"

SMALL = 0.3
"""Share of the described torque below which it is none of the joints': descriptions and arms differ by a factor
2."""

MOTOR_SCALE = 0.04
"""Share from which down a torque is a motor's, before gears of 32 and more; currents of arm drives make 5 to 20
N·m an ampere at the joint."""

ALIKE = 0.85
"""Correlation of a joint with the description from which its scale is known."""

MOST_OF = 0.5
"""Share of the joints that count whose scale must be known: of channels in another order one may look alike."""

HEAVY = 0.05
"""Described torque, over that of the most loaded joint, below which a joint does not count."""


MOTOR_NOTE = "gear ratios, as the description's weight asks for them: positions are the joints'; take the maker's"
CURRENT_NOTE = "N·m/A, as the description's weight asks for them; take the maker's"


def check(evidence: LogEvidence) -> list[Finding]:
    """The finding, if the scale is another."""
    return [*evidence.explained(MOTOR), *evidence.explained(CURRENT)]


def explain(state: LogState) -> Explanation | None:
    """The scale that explains the log, or `None` if it is that of the description."""
    nominal = state.nominal
    if nominal is None:
        return None
    known = (np.abs(nominal.correlation) > ALIKE) & (nominal.size > HEAVY * nominal.size.max())
    heavy = nominal.size > HEAVY * nominal.size.max()
    if known.sum() < MOST_OF * heavy.sum():
        return None
    typical = float(np.median(np.abs(nominal.scale[known])))
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
        10.0,  # before anything else: all other numbers are in a wrong unit until then
        "error",
        "effort",
        f"The effort is a small share of the torque that the description asks for, in the same shape: {listed}.",
        lambda evidence: _gains(evidence, gains, MOTOR_NOTE if motor else CURRENT_NOTE),
        after,
    )


def _gains(evidence: LogEvidence, gains: list[float], note: str) -> str:
    """Torque at the joint over what is logged, on top of the gains that the reading has."""
    given = evidence.reading.drive_gain
    told = np.asarray(gains) * (1.0 if given is None else np.asarray(given))
    return lines(note, drive_gain=[float(f"{gain:.3g}") for gain in told])
