"""Prior of the unknowns of a servo identification, from description, options and first estimate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.errors import EstimationError
from armid.servo.equation_error import EquationErrorFit
from armid.servo.options import ServoOptions
from armid.servo.parameters import ServoModel, ServoParameters
from armid.servo.servo_run import ServoRun
from armid.servo.unknowns import PriorDeviations, Unknowns

FRICTION = 1.5
"""Prior deviation of the logarithm of friction and rotor inertia: a factor of 4.5, since descriptions often state
values that were never measured."""

STIFFNESS = 1.0
"""Prior deviation of the logarithm of a stiffness that the description states: models in use of the same arm differ
by a factor of two and more."""

UNKNOWN_STIFFNESS = 2.0
"""Prior deviation of the logarithm of a stiffness of which nothing is known but its order of magnitude."""

OFFSET = 0.05
"""Prior deviation of an offset of horn or encoder [rad or m]: hobby servos have teeth of 0.25 rad, of which a
calibration leaves some percent."""

DELAY = 0.02
"""Prior deviation of a delay [s]."""

SMALLEST = {"inertia": 1e-5, "viscous": 1e-3, "dry": 1e-4}
"""Smallest values, relative to the stiffness, with which a search starts: J / K [s²], d / K [s] and F / K [rad or m].
A logarithm cannot leave zero."""

DIFFERENT = 5.0
"""Factor between the stiffness of a description and the one that loads show from which the description is not used:
simulators are often run with gains that have nothing to do with those of the arm."""

LEAST_LOAD = 1e-4
"""Torque or force at the usual position error below which the scale of a joint counts as unknown [N·m or N]."""

USUAL_ERROR = 0.05
"""Position error at which a servo without any other information is taken to give the largest torque that the links
need [rad or m]."""

LIMIT = 0.3
"""Prior deviation of the logarithm of a largest torque that the description states: it is a value of a data sheet, at
another voltage or temperature, or with another share of the current for the friction."""

OTHER_LIMIT = 2.0
"""Factor between the largest torque of a description and the one that the recordings show from which the description
is not used."""

FAR_BEYOND = 10.0
"""Factor by which the position error times the stiffness exceeds a described limit that is not used, where some rows
may be saturated: short steps of a command ask for some times the largest torque."""

UNKNOWN_LIMIT = 1.0
"""Prior deviation of the logarithm of a largest torque that only the recordings show."""


def make_unknowns(
    model: ServoModel,
    first: EquationErrorFit,
    bodies: Array,
    runs: Sequence[ServoRun],
    options: ServoOptions,
    *,
    saturated: bool = False,
) -> Unknowns:
    """Unknowns whose prior mean is the first estimate, with the stiffness of options, description or loads.

    A described stiffness that differs from that of the loads by more than a factor of `DIFFERENT` is not used. Where
    nothing shows the stiffness of a joint, it is the median of the other joints of the same kind, or one with which
    the largest torque that the links need makes an error of `USUAL_ERROR`.

    Raises:
        EstimationError: Nothing shows the scale of torques.
    """
    n = model.n
    stiffness, deviation = _stiffness(model, first, options)
    need = _needed_torque(model, bodies, runs)
    sliding = np.array([joint.is_prismatic for joint in model.robot.joints])
    for kind in (sliding, ~sliding):
        known = kind & np.isfinite(stiffness)
        usual = (
            float(np.median(stiffness[known])) if known.any() else float(need[kind].max(initial=0.0)) / USUAL_ERROR
        )
        stiffness = np.where(kind & ~known, usual, stiffness)
    if (stiffness * USUAL_ERROR < LEAST_LOAD).any():
        limp = ", ".join(model.robot.joint_names[j] for j in np.flatnonzero(stiffness * USUAL_ERROR < LEAST_LOAD))
        raise EstimationError(
            f"Nothing shows the scale of torques of {limp}: no stiffness is stated, and no load turns or moves the "
            "joints.",
            remedy="state the stiffness of the servos: --stiffness, or the table [servo] of a study.",
        )
    damping = np.zeros(n) if options.damping is None else np.asarray(options.damping, dtype=np.float64)
    limit, limit_deviation = _limits(model, first, stiffness, options, saturated=saturated)
    mean = ServoParameters(
        bodies,
        stiffness * np.maximum(first.inertia, SMALLEST["inertia"]),
        _friction(model, first, stiffness, damping),
        stiffness,
        damping,
        limit,
        np.clip(first.offset, -OFFSET, OFFSET),
        np.full(n, options.delay),
    )
    deviations = PriorDeviations(
        np.full(len(model.laws), FRICTION),
        np.full(n, FRICTION),
        deviation,
        np.zeros(n),
        limit_deviation,
        np.full(n, OFFSET),
        np.full(n, DELAY),
        options.bodies,
    )
    return Unknowns(model, mean, deviations)


def _friction(model: ServoModel, first: EquationErrorFit, stiffness: Array, damping: Array) -> Array:
    """Parameter of each friction law by the first estimate, shape (l,); small for laws that it does not have."""
    friction = np.empty(len(model.laws))
    for k, law in enumerate(model.laws):
        j = law.joint
        viscous = max(first.viscous[j] - damping[j] / stiffness[j], SMALLEST["viscous"])
        value = viscous if law.symbol == "FV" else max(first.dry[j], SMALLEST["dry"])
        friction[k] = stiffness[j] * (value if law.symbol in ("FV", "FS") else SMALLEST["dry"])
    return friction


def _stiffness(model: ServoModel, first: EquationErrorFit, options: ServoOptions) -> tuple[Array, Array]:
    """Stiffness of each joint, NaN where nothing is known, and the deviation of its logarithm, shape (n,) each."""
    n = model.n
    if options.stiffness is not None:
        return np.asarray(options.stiffness, dtype=np.float64), np.full(n, options.stiffness_deviation)
    servos = [joint.drive.servo for joint in model.robot.joints]
    described = np.array([np.nan if servo is None else servo.stiffness for servo in servos])
    loaded = np.where(first.loaded, 1.0 / np.maximum(first.compliance, 1e-9), np.nan)
    with np.errstate(invalid="ignore"):
        differs = np.abs(np.log(described / loaded)) > np.log(DIFFERENT)
    use = np.isfinite(described) & ~differs
    return np.where(use, described, loaded), np.where(use, STIFFNESS, UNKNOWN_STIFFNESS)


def _needed_torque(model: ServoModel, bodies: Array, runs: Sequence[ServoRun]) -> Array:
    """Largest gravity torque of the described links in the runs, shape (n,) [N·m or N]."""
    each = [np.abs(kernel.gravity_torque(model.robot.tree, bodies, run.q)).max(axis=0) for run in runs]
    return np.max(each, axis=0)


def _limits(
    model: ServoModel, first: EquationErrorFit, stiffness: Array, options: ServoOptions, *, saturated: bool
) -> tuple[Array, Array]:
    """Largest torque of each joint and the deviation of its logarithm, shape (n,) each.

    A described limit within a factor of `OTHER_LIMIT` of what the recordings show is taken, else what they show. Many
    descriptions state a continuous torque, or any number, so a limit that the first estimate exceeds without a sign
    of saturation is not used; if some rows may be saturated, only one that it exceeds by far.
    """
    if options.limit is not None:
        return np.asarray(options.limit, dtype=np.float64), np.zeros(model.n)
    described = np.array([joint.effort_limit for joint in model.robot.joints])
    shown, asked = stiffness * first.saturation, stiffness * first.largest
    with np.errstate(invalid="ignore", divide="ignore"):
        near = np.abs(np.log(shown / described)) < np.log(OTHER_LIMIT)
    found = np.isfinite(shown)
    exceeded = ~found & (asked > (FAR_BEYOND if saturated else 1.0) * described)
    mean = np.where(found & ~near, shown, np.where(exceeded, np.inf, described))
    return mean, np.where(found & ~near, UNKNOWN_LIMIT, LIMIT)
