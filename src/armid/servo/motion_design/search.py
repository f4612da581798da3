"""Search for the motion of commands whose intervals of gains, rotor inertia, friction and delay are the narrowest."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.errors import EstimationError
from armid.excitation.command_motion import CommandMotion, command_ranges
from armid.model.terms import Coulomb, Viscous
from armid.servo.closed_loop import position_derivatives, simulate
from armid.servo.held_command import held_means
from armid.servo.identify_servo import described_bodies
from armid.servo.motion_design.shape import GENES, commands_of_shape, mutated
from armid.servo.options import ServoOptions
from armid.servo.output_error import FINEST, TRANSIENT
from armid.servo.parameters import ServoModel, ServoParameters
from armid.servo.servo_prior import DELAY, FRICTION, OFFSET, STIFFNESS, UNKNOWN_STIFFNESS, USUAL_ERROR
from armid.servo.servo_run import ServoRun
from armid.servo.unknowns import PriorDeviations, Unknowns

WANTED = ("stiffness", "rotor_inertia", "friction", "delay")
"""Unknowns whose intervals count."""

RESIDUAL, CORRELATION = 1.5e-3, 0.2
"""Expected deviation [rad or m] and correlation time [s] of the residuals: coarse encoders, and some model error."""

INERTIA, VISCOUS, DRY = 8e-4, 0.03, 4e-3
"""Rotor inertia [s²], viscous friction [s] and dry friction [rad or m] over the stiffness where the description has
none."""

PENALTY = 10.0
"""Increase of the criterion for each unit by which a limit is exceeded, relative to the limit."""

RANDOM = 0.3
"""Share of the time in which motions are drawn at random, before the best one is changed."""

POSES = 100
"""Number of random poses in which gravity torques are computed."""


@dataclass(frozen=True, eq=False, slots=True)
class CommandDesign:
    """Designed motion and what is expected of it.

    Attributes:
        commands: The motion.
        value: Criterion: mean logarithm of the expected deviations of the unknowns over those of the prior.
        deviations: Expected deviation of each unknown that counts, by field and index: relative, or in s for delays.
        torque_share: Largest torque of each servo over its limit, predicted, shape (n,); 0 without a limit.
        positions: Lowest and highest predicted position of each joint, shape (2, n) [rad or m].
        trials: Number of motions that were compared.
    """

    commands: CommandMotion
    value: float
    deviations: dict[tuple[str, int], float]
    torque_share: Array
    positions: Array
    trials: int


def expected_unknowns(model: ServoModel, options: ServoOptions) -> Unknowns:
    """Unknowns at the values of description and options, with the prior of an identification.

    Raises:
        EstimationError: The description has no masses, or nothing says how stiff a servo is.
    """
    n, robot, bodies = model.n, model.robot, described_bodies(model.robot)
    servos = [joint.drive.servo for joint in robot.joints]
    described = np.array([np.nan if servo is None else servo.stiffness for servo in servos])
    low, high, _ = command_ranges(robot)
    poses = np.random.default_rng(0).uniform(low, high, (POSES, n))
    need = np.abs(kernel.gravity_torque(robot.tree, bodies, poses)).max(axis=0)
    guessed = np.maximum(need, 0.1 * need.max(initial=0.0)) / USUAL_ERROR
    stiffness = (
        np.where(np.isfinite(described), described, guessed) if options.stiffness is None else options.stiffness
    )
    if not (np.asarray(stiffness) > 0.0).all():
        raise EstimationError(
            f"Nothing says how stiff the servos of {robot.name} are: the description has no position servos, and "
            "gravity loads no joint.",
            remedy="state the stiffness: --stiffness.",
        )
    known = np.isfinite(described) & (options.stiffness is None)
    deviation = np.where(known, STIFFNESS, UNKNOWN_STIFFNESS)
    if options.stiffness is not None:
        deviation = np.full(n, options.stiffness_deviation)
    own = {Viscous.name: VISCOUS * stiffness, Coulomb.name: DRY * stiffness}
    friction = np.array(
        [
            getattr(robot.joints[law.joint].drive, name, 0.0) or own.get(name, DRY * stiffness)[law.joint]
            for name, law in zip(model.terms, model.laws, strict=True)
        ]
    )
    rotors = np.array([joint.drive.rotor_inertia for joint in robot.joints])
    limits = np.array([joint.effort_limit for joint in robot.joints]) if options.limit is None else options.limit
    damping = [0.0 if servo is None else servo.damping for servo in servos]
    mean = ServoParameters(
        bodies,
        np.where(rotors > 0.0, rotors, INERTIA * stiffness),
        friction,
        np.asarray(stiffness, dtype=np.float64),
        np.array(damping) if options.damping is None else options.damping,
        np.asarray(limits, dtype=np.float64),
        np.zeros(n),
        np.full(n, options.delay),
    )
    prior = PriorDeviations(
        np.full(len(model.laws), FRICTION),
        np.full(n, FRICTION),
        deviation,
        np.zeros(n),
        np.zeros(n),
        np.full(n, OFFSET),
        np.full(n, DELAY),
        options.bodies,
    )
    return Unknowns(model, mean, prior)


def judge_commands(unknowns: Unknowns, commands: CommandMotion) -> CommandDesign:
    """Expected intervals and predicted torques of a motion; the value is infinite if the motion diverges."""
    model, mean = unknowns.model, unknowns.mean
    start = np.repeat(commands.command[:1], len(commands.command), axis=0)
    run = ServoRun(1.0 / commands.rate, 0.0, start, np.zeros(model.n), commands.time, commands.command)
    (found,) = simulate(model, mean, [run])
    derivatives = position_derivatives(model, mean, found)
    if derivatives is None:
        empty = np.full(model.n, np.inf)
        return CommandDesign(commands, np.inf, {}, empty, np.stack([-empty, empty]), 1)
    every = max(1, round(FINEST / run.step))
    jacobian = derivatives[round(TRANSIENT / run.step) :: every]
    weight = 1.0 / (RESIDUAL**2 * max(CORRELATION / (every * run.step), 1.0))
    columns = (jacobian @ unknowns.chain(np.zeros(unknowns.count))).reshape(-1, unknowns.count)
    information = np.diag(unknowns.deviation**-2) + weight * columns.T @ columns
    deviation = np.sqrt(np.diag(np.linalg.inv(information)))
    named = [(k, name) for k, name in enumerate(unknowns.names()) if name[0] in WANTED]
    value = float(np.mean([np.log(deviation[k] / unknowns.deviation[k]) for k, _ in named])) if named else 0.0
    deviations = {name: float(deviation[k]) for k, name in named}
    positions = np.stack([found.q.min(axis=0), found.q.max(axis=0)])
    return CommandDesign(commands, value, deviations, _torque_shares(mean, run, found.q), positions, 1)


def _torque_shares(mean: ServoParameters, run: ServoRun, q: Array) -> Array:
    """Largest torque of each servo over its limit, before it is limited, shape (n,)."""
    held, _ = held_means(run.command_time, run.command, mean.delay, run.start, run.step, run.samples - 1)
    torque = (
        mean.stiffness * (held - mean.offset - 0.5 * (q[1:] + q[:-1])) - mean.damping * np.diff(q, axis=0) / run.step
    )
    return np.abs(torque).max(axis=0) / mean.limit


def design_commands(
    model: ServoModel,
    options: ServoOptions,
    *,
    seconds: float = 30.0,
    rate: float = 50.0,
    torque_share: float = 0.7,
    budget: float = 30.0,
    seed: int = 1,
    progress: Callable[[float, float], None] | None = None,
) -> CommandDesign:
    """Searches the motion with the narrowest expected intervals, within the limits of the description.

    Args:
        model: Arm, with masses, and friction laws; its joints have the limits of the motion.
        options: What is known of the servos.
        seconds: Duration [s].
        rate: Commands per second [Hz].
        torque_share: Largest torque of a servo over its limit, predicted by the closed loop with the expected gains.
        budget: Time of the search [s]; at least a few motions are compared.
        seed: Seed of the search.
        progress: Function that is called with the best value and the share of the time that has passed.

    Raises:
        EstimationError: No motion within the limits was found.
    """
    unknowns, limits = expected_unknowns(model, options), command_ranges(model.robot)
    rng, began, trials = np.random.default_rng(seed), time.perf_counter(), 0
    best: tuple[float, Array, CommandDesign] | None = None
    shrink = 1.0
    while (passed := time.perf_counter() - began) < budget or trials < FEWEST:
        drawn = best is None or passed < RANDOM * budget or not np.isfinite(best[0])
        genes = rng.uniform(size=(model.n, GENES)) if drawn else mutated(best[1], rng)  # pyright: ignore[reportOptionalSubscript]
        narrow = _narrowed(limits, shrink)
        found = judge_commands(unknowns, commands_of_shape(genes, narrow, seconds, rate))
        trials += 1
        excess = _excess(found, model, torque_share)
        cost = found.value + PENALTY * excess
        if best is None or cost < best[0]:
            best = cost, genes, found
        if drawn and excess > 0.0:
            shrink = max(SMALLEST, 0.9 * shrink)  # soft servos hang far below their commands
        if progress is not None:
            progress(best[2].value, min(passed / budget, 1.0))
    assert best is not None
    if _excess(best[2], model, torque_share) > 0.0:
        raise EstimationError(
            f"No motion of {model.robot.name} was found that needs less than {torque_share:.0%} of the largest "
            "torques of its servos and keeps its limits.",
            remedy="check the stiffness and the largest torques, allow a larger share, or a longer --budget.",
        )
    return replace(best[2], trials=trials)


FEWEST = 5
"""Smallest number of motions that are compared."""

SMALLEST = 0.2
"""Smallest share of the range of the joints to which a design shrinks."""


def _narrowed(limits: tuple[Array, Array, Array], share: float) -> tuple[Array, Array, Array]:
    """Limits with a share of the range about the middle."""
    low, high, speed = limits
    middle, half = 0.5 * (low + high), 0.5 * share * (high - low)
    return middle - half, middle + half, speed


def _excess(found: CommandDesign, model: ServoModel, torque_share: float) -> float:
    """Sum of the shares by which torques and positions exceed their limits."""
    limits = np.array([joint.position_limits for joint in model.robot.joints])
    span = np.where(np.isfinite(limits[:, 1] - limits[:, 0]), limits[:, 1] - limits[:, 0], 1.0)
    outside = np.maximum(limits[:, 0] - found.positions[0], found.positions[1] - limits[:, 1])
    over = np.maximum(found.torque_share - torque_share, 0.0)
    return float(np.sum(np.maximum(outside, 0.0) / span) + np.sum(over))
