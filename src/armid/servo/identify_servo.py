"""Identification of an arm from commands and measured positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.errors import EstimationError
from armid.servo.equation_error import EquationErrorFit, fit_equation_error
from armid.servo.options import ServoOptions
from armid.servo.output_error import OutputErrorFit, minimise_output_error
from armid.servo.parameters import ServoModel, ServoParameters, described_parameters
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
        fit: Estimate by the output error.
        parameters: Estimated parameters: those of `fit`, or of the first estimate where it predicts better.
        refined: True if `parameters` are those of `fit`.
        left_out: Closed-loop error of the refined and of the first estimate on parts that were left out of training.
        training: Closed-loop error on the training runs.
    """

    model: ServoModel
    unknowns: Unknowns
    first: EquationErrorFit
    fit: OutputErrorFit
    parameters: ServoParameters
    refined: bool
    left_out: tuple[ClosedLoopError, ClosedLoopError]
    training: ClosedLoopError


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
        EstimationError: The description has no links, or a joint does not move.
    """
    options = options or ServoOptions()
    bodies = model.robot.inertial_vector
    if bodies is None or (bodies[:, 0] <= 0.0).any():
        raise EstimationError(
            f"The description of {model.robot.name} gives no mass for some links. Without torque in the log, the "
            "links are the only known load.",
            remedy="use a description with masses; estimates from CAD are good enough.",
        )
    tell = progress or _silent
    tell("first estimate", 0.0)
    known = _known_stiffness(model, options)
    first = fit_equation_error(model.robot.tree, bodies, runs, known)
    unknowns = make_unknowns(model, first, bodies, runs, options)
    shorter = [run.part(0, round((1.0 - LEFT_OUT) * run.samples)) for run in runs]
    later = [run.part(round((1.0 - LEFT_OUT) * run.samples), run.samples) for run in runs]
    tell("left-out parts", 0.0)
    partial = minimise_output_error(
        unknowns, shorter, most_steps=FEW_STEPS, progress=lambda share: tell("left-out parts", share)
    )
    left_out = (
        closed_loop_error(model, partial.parameters, later),
        closed_loop_error(model, unknowns.mean, later),
    )
    refined = left_out[0].total <= left_out[1].total
    tell("output error", 0.0)
    fit = minimise_output_error(unknowns, runs, start=partial.x, progress=lambda share: tell("output error", share))
    parameters = fit.parameters if refined else unknowns.mean
    training = closed_loop_error(model, parameters, runs)
    return ServoEstimate(model, unknowns, first, fit, parameters, refined, left_out, training)


def _silent(stage: str, share: float) -> None:
    """Progress that nobody is told."""
    del stage, share


def _known_stiffness(model: ServoModel, options: ServoOptions) -> Array | None:
    """Stiffness that is stated, NaN where none is, shape (n,); `None` if none is stated."""
    if options.stiffness is not None:
        return np.asarray(options.stiffness, dtype=np.float64)
    described = described_parameters(model)
    return None if described is None else described.stiffness


def make_unknowns(
    model: ServoModel, first: EquationErrorFit, bodies: Array, runs: Sequence[ServoRun], options: ServoOptions
) -> Unknowns:
    """Unknowns whose prior mean is the first estimate, with the stiffness that is stated or that loads show.

    Where neither is the case, the stiffness is that of the other joints, relative to the largest torque that the
    links need, or one with which this torque makes an error of `USUAL_ERROR`.
    """
    n = model.n
    stated = _known_stiffness(model, options)
    stiffness = np.full(n, np.nan) if stated is None else stated.copy()
    is_stated = np.isfinite(stiffness)
    stiffness = np.where(~is_stated & first.loaded, 1.0 / np.maximum(first.compliance, 1e-9), stiffness)
    need = _needed_torque(model, bodies, runs)
    usual = need.max() / USUAL_ERROR
    if np.isfinite(stiffness).any():
        usual = float(np.median(stiffness[np.isfinite(stiffness)]))
    stiffness = np.where(np.isfinite(stiffness), stiffness, usual)
    exact = options.stiffness is not None and options.stiffness_deviation == 0.0
    stated_deviation = 0.0 if exact else (options.stiffness_deviation or STIFFNESS)
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
        np.where(is_stated, stated_deviation, UNKNOWN_STIFFNESS),
        np.zeros(n),
        np.full(n, OFFSET),
        np.full(n, DELAY),
        options.bodies,
    )
    return Unknowns(model, mean, deviations)


def _needed_torque(model: ServoModel, bodies: Array, runs: Sequence[ServoRun]) -> Array:
    """Largest gravity torque of the described links in the runs, shape (n,) [N·m or N]."""
    each = [np.abs(kernel.gravity_torque(model.robot.tree, bodies, run.q)).max(axis=0) for run in runs]
    return np.max(each, axis=0)
