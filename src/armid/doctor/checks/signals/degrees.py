"""Check for angles in another unit than the study states, from the torque: joint limits may not show the fault."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.remedy_trial import HELPS
from armid.errors import Finding
from armid.measurement.log_format import LogFormat
from armid.measurement.position_range_check import WIDEST
from armid.measurement.remedy_builders import lines

CODE = "degrees"

DEGREES = 180.0 / np.pi

NARROWEST = 0.1
"""Smallest plausible range of a motion [rad]."""

GAIN = 0.3
"""Smallest decrease of the mean logarithm of the RMS residuals for the other unit. A wrong unit changes the shape of
gravity torques, and it changes inertias by a factor of 57."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports a wrong unit of angles if the model fits the log better with the other unit."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a wrong unit of angles; `None` if the unit is correct."""
    best: tuple[float, LogState, NDArray[np.bool_], str] | None = None
    for which, factor, unit in _suspects(state):
        after = state.on(state.log.scaled(np.where(which, factor, 1.0)))
        gain = state.fit.cost - after.fit.cost
        if gain > GAIN and (best is None or gain > best[0]):
            best = gain, after, which, unit
    if best is None:
        return None
    gain, after, turned, unit = best
    largest = float(np.abs(state.rows.motion.q[:, turned]).max())
    joints = state.model.robot.joints
    everywhere = all(one or joint.is_prismatic for one, joint in zip(turned, joints, strict=True))
    names = ", ".join(joint.name for one, joint in zip(turned, joints, strict=True) if one)
    return Explanation(
        CODE,
        gain,
        "error",
        "q" if everywhere else names,
        f"Read as {unit}, the largest angle of {'all joints' if everywhere else names} is {largest:.3g} rad; with "
        f"the other unit, the residual is {1 - np.exp(-gain):.0%} smaller.",
        lambda evidence: lines(units=_units(evidence.reading, turned, everywhere=everywhere)),
        after,
        worse=HELPS,
    )


def _suspects(state: LogState) -> list[tuple[NDArray[np.bool_], float, str]]:
    """Masks (n,) of joints that may have the other unit; factor on their angles; and name of the unit in use.

    One mask contains all revolute joints; the others contain joints that are outside their limits by whole turns or
    that hardly move.
    """
    joints = state.model.robot.joints
    turns = np.array([not joint.is_prismatic for joint in joints])
    if not turns.any():
        return []
    size: Array = np.abs(state.rows.motion.q).max(axis=0)
    largest = float(size[turns].max())
    suspects: list[tuple[NDArray[np.bool_], float, str]] = []
    if largest * DEGREES <= WIDEST:
        suspects.append((turns, DEGREES, "degrees"))
    elif largest > WIDEST and largest / DEGREES >= NARROWEST:
        suspects.append((turns, 1.0 / DEGREES, "radians"))
    limits = np.array([joint.position_limits for joint in joints])
    widest = np.where(np.isfinite(limits).all(axis=1), np.abs(limits).max(axis=1), WIDEST)
    beyond = turns & (size > np.maximum(widest, WIDEST))
    moves: Array = np.ptp(state.rows.motion.q, axis=0)
    hardly_moving = turns & (size * DEGREES <= np.minimum(widest, WIDEST)) & (moves > 0.0)
    for which, factor, unit in ((beyond, 1.0 / DEGREES, "radians"), (hardly_moving, DEGREES, "degrees")):
        if which.any() and (which != turns).any():
            suspects.append((which, factor, unit))
    return suspects


def _units(reading: LogFormat, turned: NDArray[np.bool_], *, everywhere: bool) -> str | list[str]:
    """Value of the key `units` that corrects the log format."""
    degrees = reading.degrees(len(turned)) != turned
    if everywhere and (reading.units is None or isinstance(reading.units, str)):
        return "rad" if reading.units == "deg" else "deg"
    return ["deg" if one else "rad" for one in degrees]


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        "degrees": "The motion, and with it inertias and friction, are wrong by a factor of 57.",
    },
    explain=explain,
    untested={
        "degrees": "without the remedy, the positions are outside all limits",
    },
)
