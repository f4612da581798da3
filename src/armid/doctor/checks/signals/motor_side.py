"""Torque of the motors, a motor current, or a torque in another unit, in the place of joint torque."""

from __future__ import annotations

import numpy as np

from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.log_check import LogCheck
from armid.doctor.log_interpretation import LogState
from armid.errors import Finding
from armid.maths.median import median
from armid.measurement.log_format_remedies import lines

MOTOR, CURRENT, UNIT = "motor-side", "current-without-gain", "torque-unit"

SMALL = 0.3
"""Share of the described torque below which a torque is not that of the joints: descriptions and arms differ by up to
a factor of 2."""

MOTOR_SCALE = 0.04
"""Share below which the effort is a motor torque: then the gear ratio is 25 or more. Drives of arms give 5 to 20 N·m
at the joint for an ampere."""

LARGE = 4.0
"""Multiple of the described torque from which a torque is in another unit. On eight recorded arms the joints that
count have 0.7 to 2.3 times the described torque, and their median 0.8 to 1.5 times."""

UNITS = ((10.197, "kgf·cm"), (100.0, "N·cm"), (1000.0, "mN·m"), (1e4, "0.1 mN·m"))
"""Torque units by their number in a newton metre."""

NEAR_UNIT = 1.6
"""Factor of a description's torque from that of the arm within which a unit is named, as on recorded arms."""

AFTER_DEGREES = 1.0
"""Fall of the log residual that stands for the correction of a large torque: other numbers depend on it, but angles
in a wrong unit make a described torque too small, and cost more than this."""

SAME_MASS = 0.5
"""Share of the links with one and the same mass above which the masses stand for others, as 1 kg each does."""

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
UNIT_NOTE = "N·m for one of the log's units"


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports motor torques, currents and torques in another unit."""
    return [finding for code in (MOTOR, CURRENT, UNIT) for finding in evidence.explained(code)]


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
    if typical > LARGE:
        return None if _placeholders(state) else _too_large(state, typical)
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


def _too_large(state: LogState, typical: float) -> Explanation:
    """Explanation of a torque that is a multiple of the described one by its unit.

    All joints get one factor: it corrects the unit and leaves the description's errors to the estimate.
    """
    assert state.nominal is not None
    unit = next((u for u in UNITS if 1.0 / NEAR_UNIT < typical / u[0] < NEAR_UNIT), None)
    factor = float(f"{typical:.2g}") if unit is None else unit[0]
    what = (
        "That is no usual unit of torque; it may be raw units of the drive, a motor current or a wrong gain, "
        "unless the description's masses are too small"
        if unit is None
        else f"It is probably in {unit[1]}, unless the description's masses are too small"
    )
    names = state.model.robot.joint_names
    loaded = int(np.argmax(state.nominal.size))
    note = UNIT_NOTE if unit is not None else f"{UNIT_NOTE}, as fits the description; use the maker's value"
    return Explanation(
        UNIT,
        AFTER_DEGREES,
        "error",
        "effort",
        f"The effort has the shape of the description's torque, but is {typical:.3g} times as large (median of the "
        f"joints; {names[loaded]}: {state.nominal.scale[loaded]:.3g}). {what}.",
        lambda evidence: _gains(evidence, [1.0 / factor] * state.rows.n, note),
        state.with_torque(np.full(state.rows.n, 1.0 / factor)),
    )


def _placeholders(state: LogState) -> bool:
    """True if the described masses stand for others, so that the torque has no scale."""
    theta = state.model.nominal_parameters()
    if theta is None:
        return True
    masses = theta[state.model.inertial_columns].reshape(-1, 10)[:, 0]
    masses = masses[masses > 0.0]
    if len(masses) < 2:
        return False
    return bool(np.unique(masses, return_counts=True)[1].max() > SAME_MASS * len(masses))


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
        "torque-unit": "All parameters are too large by one factor; a validation in the same unit does not show it.",
    },
    explain=explain,
    hides=("saturation",),
    fails=(UNIT,),
)
