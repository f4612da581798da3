"""Identification of an arm from commands and measured positions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.robot.robot import Robot
from armid.servo.closed_loop import steps_of_sample
from armid.servo.equation_error import EquationErrorFit, fit_equation_error
from armid.servo.options import ServoOptions
from armid.servo.other_limits import FEW_STEPS, search_from_windows, with_other_limits
from armid.servo.output_error import MOST_STEPS, TRANSIENT, OutputErrorFit, minimise_output_error
from armid.servo.parameters import ServoModel, ServoParameters
from armid.servo.score import ClosedLoopError, closed_loop_error
from armid.servo.servo_prior import make_unknowns
from armid.servo.servo_run import ServoRun
from armid.servo.unknowns import Unknowns
from armid.threads import one_blas_thread

SHORTEST_STEP = 2.5e-4
"""Shortest of the longest steps of the integration that are tried [s]."""

SMALL_SHIFT = 0.3
"""Shift of an unknown by the steps of the integration, in standard deviations, that is accepted: a bias of 0.3
deviations lowers the coverage of a 95 % interval to 94 %."""

SHORTENED = 2
"""Largest number of times that the steps are shortened: the first new minimum has smaller deviations."""

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
    saturated, start, partial = _without_the_end(
        model, bodies, shorter, options, lambda share: tell("left-out parts", share)
    )
    left_out = (
        closed_loop_error(model, partial.parameters, later, after=TRANSIENT),
        closed_loop_error(model, start.mean, later, after=TRANSIENT),
    )
    refined = not left_out[1].total < left_out[0].total and bool(np.isfinite(left_out[0].total))
    tell("output error", 0.0)
    first, unknowns = _first_estimate(model, bodies, runs, options, saturated=saturated)
    fit = minimise_output_error(
        unknowns,
        runs,
        start=unknowns.near(partial.parameters, start.links(partial.x)) if refined else None,
        most_steps=MOST_STEPS if refined else 0,
        progress=lambda share: tell("output error", share),
    )
    if refined:
        unknowns, fit = with_other_limits(unknowns, runs, fit, lambda share: tell("largest torques", share))
        unknowns, fit = _with_shorter_steps(unknowns, runs, fit, lambda share: tell("shorter steps", share))
        model = unknowns.model
    training = closed_loop_error(model, fit.parameters, runs, after=TRANSIENT)
    if refined and not training.total <= closed_loop_error(model, partial.parameters, runs, after=TRANSIENT).total:
        # A search over long motion with saturated servos may end at a worse point than that of a part of the motion,
        # which was judged by motion that it did not know.
        unknowns, fit = start, minimise_output_error(start, runs, start=partial.x, most_steps=0)
        model, training = start.model, closed_loop_error(start.model, fit.parameters, runs, after=TRANSIENT)
    kept = partial.parameters if refined else start.mean
    return ServoEstimate(model, unknowns, first, fit, fit.parameters, refined, left_out, training, kept)


def described_bodies(robot: Robot) -> Array:
    """Inertial parameters of the links of a description, shape (n, 10).

    Raises:
        EstimationError: A link has no mass, or no real body has its inertial parameters.
    """
    bodies = robot.inertial_vector
    massless = [link.name for link in robot.links if link.inertial is None or link.inertial.vector[0] <= 0.0]
    if bodies is None or massless:
        raise EstimationError(
            f"The description of {robot.name} gives no mass for {', '.join(massless)}. Without torque in the log, "
            "the links are the only known load.",
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
    model: ServoModel, bodies: Array, runs: Sequence[ServoRun], options: ServoOptions, *, saturated: bool
) -> tuple[EquationErrorFit, Unknowns]:
    """First estimate from the position error, and the unknowns whose prior mean it is."""
    exact = options.stiffness if options.stiffness_deviation == 0.0 else None
    first = fit_equation_error(model.robot.tree, bodies, runs, exact, options.delay, saturated=saturated)
    return first, make_unknowns(model, first, bodies, runs, options, saturated=saturated)


def _without_the_end(
    model: ServoModel,
    bodies: Array,
    runs: Sequence[ServoRun],
    options: ServoOptions,
    progress: Callable[[float], None],
) -> tuple[bool, Unknowns, OutputErrorFit]:
    """Estimate from shortened runs: true if servos are saturated in it, its unknowns, and the minimum of a few steps.

    Stiction may look like saturation in the first estimate. So both are tried, and the smaller output error decides.
    """
    _, unknowns = _first_estimate(model, bodies, runs, options, saturated=False)
    fit = minimise_output_error(unknowns, runs, most_steps=FEW_STEPS, progress=progress)
    _, other = _first_estimate(model, bodies, runs, options, saturated=True)
    if np.array_equal(other.mean.limit, unknowns.mean.limit):
        return False, unknowns, fit
    other_fit = search_from_windows(other, runs, None, FEW_STEPS, progress)
    if other_fit is None:
        return False, unknowns, fit
    if np.sum(np.log(other_fit.rms)) < np.sum(np.log(fit.rms)):
        return True, other, other_fit
    return False, unknowns, fit


def _with_shorter_steps(
    unknowns: Unknowns, runs: Sequence[ServoRun], fit: OutputErrorFit, progress: Callable[[float], None]
) -> tuple[Unknowns, OutputErrorFit]:
    """Minimum with steps of the integration that shift no unknown by much; the shift is in proportion to the step."""
    for _ in range(SHORTENED):
        if not SMALL_SHIFT < fit.integration < np.inf:
            break
        step = min(run.step / steps_of_sample(unknowns.model, run) for run in runs)
        shorter = max(SHORTEST_STEP, step * SMALL_SHIFT / fit.integration)
        if shorter >= step:
            break
        unknowns = Unknowns(replace(unknowns.model, longest_step=shorter), unknowns.mean, unknowns.deviations)
        fit = minimise_output_error(unknowns, runs, start=fit.x, progress=progress)
    return unknowns, fit


def _silent(stage: str, share: float) -> None:
    """Progress that nobody is told."""
    del stage, share
