"""Identification of an arm from commands and measured positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.errors import EstimationError
from armid.robot.robot import Robot
from armid.servo.equation_error import EquationErrorFit, fit_equation_error
from armid.servo.options import ServoOptions
from armid.servo.output_error import MOST_STEPS, TRANSIENT, OutputErrorFit, minimise_output_error
from armid.servo.parameters import ServoModel, ServoParameters
from armid.servo.score import ClosedLoopError, closed_loop_error
from armid.servo.servo_run import ServoRun
from armid.servo.unknowns import PriorDeviations, Unknowns
from armid.threads import one_blas_thread

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

FEW_STEPS = 8
"""Largest number of steps of the search without the left-out parts, whose result need not be exact."""

LEFT_OUT = 0.3
"""Share at the end of each training run on which the first estimate and the refined one are compared."""


@dataclass(frozen=True, eq=False, slots=True)
class ServoEstimate:
    """Identified servos, friction and links.

    Attributes:
        model: Arm and friction laws.
        unknowns: Unknowns with their prior.
        first: First estimate, from the position error.
        fit: Estimate by the output error; the first estimate with its intervals where that predicts better.
        parameters: Estimated parameters: those of `fit`.
        refined: True if the output error was minimised; false if the first estimate was kept.
        left_out: Closed-loop error of the refined and of the first estimate on parts that were left out of training.
        training: Closed-loop error on the training runs.
        without_left_out: Parameters that were estimated without the left-out parts, in the way that was kept.
    """

    model: ServoModel
    unknowns: Unknowns
    first: EquationErrorFit
    fit: OutputErrorFit
    parameters: ServoParameters
    refined: bool
    left_out: tuple[ClosedLoopError, ClosedLoopError]
    training: ClosedLoopError
    without_left_out: ServoParameters


@one_blas_thread
def identify_servo(
    model: ServoModel,
    runs: Sequence[ServoRun],
    options: ServoOptions | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> ServoEstimate:
    """Identifies servos, friction, rotor inertias and links from recorded commands and positions.

    Args:
        model: Arm, with inertial parameters in its description, and friction laws.
        runs: Training runs.
        options: What is known of the servos.
        progress: Function that is called with the name of a stage and the share of it that is done.

    Raises:
        EstimationError: The description has no masses or impossible links, nothing shows the scale of torques, or the
            simulated motion diverges.
    """
    options, tell = options or ServoOptions(), progress or _silent
    bodies = described_bodies(model.robot)
    tell("first estimate", 0.0)
    cut = [round((1.0 - LEFT_OUT) * run.samples) for run in runs]
    shorter = [run.part(0, end) for run, end in zip(runs, cut, strict=True)]
    later = [run.part(end, run.samples) for run, end in zip(runs, cut, strict=True)]
    tell("left-out parts", 0.0)
    _, start = _first_estimate(model, bodies, shorter, options)
    partial = minimise_output_error(
        start, shorter, most_steps=FEW_STEPS, progress=lambda share: tell("left-out parts", share)
    )
    left_out = (
        closed_loop_error(model, partial.parameters, later, after=TRANSIENT),
        closed_loop_error(model, start.mean, later, after=TRANSIENT),
    )
    refined = not left_out[1].total < left_out[0].total and bool(np.isfinite(left_out[0].total))
    tell("output error", 0.0)
    first, unknowns = _first_estimate(model, bodies, runs, options)
    fit = minimise_output_error(
        unknowns,
        runs,
        start=unknowns.near(partial.parameters) if refined else None,
        most_steps=MOST_STEPS if refined else 0,
        progress=lambda share: tell("output error", share),
    )
    training = closed_loop_error(model, fit.parameters, runs, after=TRANSIENT)
    kept = partial.parameters if refined else start.mean
    return ServoEstimate(model, unknowns, first, fit, fit.parameters, refined, left_out, training, kept)


def described_bodies(robot: Robot) -> Array:
    """Inertial parameters of the links of a description, shape (n, 10).

    Raises:
        EstimationError: A link has no mass, or no real body has its inertial parameters.
    """
    bodies = robot.inertial_vector
    if bodies is None or (bodies[:, 0] <= 0.0).any():
        raise EstimationError(
            f"The description of {robot.name} gives no mass for some links. Without torque in the log, the links are "
            "the only known load.",
            remedy="use a description with masses; estimates from CAD are good enough.",
        )
    impossible = [
        link.name for link in robot.links if link.inertial is not None and not link.inertial.is_consistent()
    ]
    if impossible:
        raise EstimationError(
            f"No real body has the inertial parameters that the description of {robot.name} gives for "
            f"{', '.join(impossible)}.",
            remedy="correct them; `armid certify` says what is wrong.",
        )
    return bodies


def _first_estimate(
    model: ServoModel, bodies: Array, runs: Sequence[ServoRun], options: ServoOptions
) -> tuple[EquationErrorFit, Unknowns]:
    """First estimate from the position error, and the unknowns whose prior mean it is."""
    exact = options.stiffness if options.stiffness_deviation == 0.0 else None
    first = fit_equation_error(model.robot.tree, bodies, runs, exact, options.delay)
    return first, make_unknowns(model, first, bodies, runs, options)


def _silent(stage: str, share: float) -> None:
    """Progress that nobody is told."""
    del stage, share


def make_unknowns(
    model: ServoModel, first: EquationErrorFit, bodies: Array, runs: Sequence[ServoRun], options: ServoOptions
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
    friction = np.empty(len(model.laws))
    for k, law in enumerate(model.laws):
        j = law.joint
        viscous = max(first.viscous[j] - damping[j] / stiffness[j], SMALLEST["viscous"])
        value = viscous if law.symbol == "FV" else max(first.dry[j], SMALLEST["dry"])
        friction[k] = stiffness[j] * (value if law.symbol in ("FV", "FS") else SMALLEST["dry"])
    limit = np.array([joint.effort_limit for joint in model.robot.joints]) if options.limit is None else options.limit
    mean = ServoParameters(
        bodies,
        stiffness * np.maximum(first.inertia, SMALLEST["inertia"]),
        friction,
        stiffness,
        damping,
        np.asarray(limit, dtype=np.float64),
        np.clip(first.offset, -OFFSET, OFFSET),
        np.full(n, options.delay),
    )
    deviations = PriorDeviations(
        np.full(len(model.laws), FRICTION),
        np.full(n, FRICTION),
        deviation,
        np.zeros(n),
        np.full(n, OFFSET),
        np.full(n, DELAY),
        options.bodies,
    )
    return Unknowns(model, mean, deviations)


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
