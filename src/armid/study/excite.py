"""A motion designed from a robot, wishes and limits: start pose, problem, search, certificate, report."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armid.errors import ArmidError, Finding, did_you_mean
from armid.excitation.channels import Channel
from armid.excitation.collision import Collision, cell_of, kept_apart
from armid.excitation.design import Progress, Search, search, single_threaded_pool
from armid.excitation.finish import certified, fine_grid
from armid.excitation.limits import Limits, limits_of, motion_channels, thesis_channels, torque_channel
from armid.excitation.loads import Torque
from armid.excitation.objective import Goal
from armid.excitation.places import Workspace
from armid.excitation.plan import Plan, seconds_for
from armid.excitation.preflight import Preflight, preflight, worst
from armid.excitation.sensitivity import Columns
from armid.excitation.series import SeriesBasis
from armid.excitation.solver import Problem
from armid.excitation.start import Holds, anywhere, choose_start, usual_pose
from armid.model.motion import Motion
from armid.robot.kinematics import forward_kinematics
from armid.robot.robot import Robot
from armid.robot.shapes import Shape
from armid.shown import Shown, Summary
from armid.values import Array

__all__ = ["LIMIT_KINDS", "Designed", "Effort", "Rules", "Wish", "design_plan", "place"]

LIMIT_KINDS = ("true", "thesis", "thesis-literal")
"""What position and velocity limits apply to: the motion itself, or sums of amplitudes as in (3.55d-f)."""

LEAD_SHARE = 0.5
"""Share of the limits of velocity that ways to and from the start use."""

LEAD_CHECKS = 200.0
"""Poses a second of these ways in which bodies are looked at [Hz]."""

HELD = 0.9
"""Share of the torque limits that holding a start pose may take where the pose is chosen here."""

LEAD_ACCELERATION = 2.0
"""Acceleration of these ways where no limit is given [rad/s² or m/s²]."""


@dataclass(frozen=True, eq=False, slots=True)
class Wish:
    """What the motion should be.

    Attributes:
        goal: What it is for.
        duration: Length of a period [s].
        harmonics: Number of harmonics.
        start: Start pose, shape (n,) [rad or m]; found where not given.
        free_start: Whether the start pose is among the unknowns.
        free_centre: Whether joints may swing about another pose than the start, which (3.55c) has them not do.
        begin: Pose that the arm comes from, shape (n,); the start where not given.
        end: Pose that it goes to afterwards, shape (n,); the start where not given.
    """

    goal: Goal
    duration: float = 20.0
    harmonics: int = 10
    start: Array | None = None
    free_start: bool = False
    free_centre: bool = False
    begin: Array | None = None
    end: Array | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Rules:
    """What it must keep to.

    Attributes:
        limits: One of `LIMIT_KINDS`.
        given: Limits by joint and kind in the place of the description's.
        acceleration: Of every joint [rad/s² or m/s²]; none where not given.
        jerk: Of every joint [rad/s³ or m/s³]; none where not given.
        torque_margin: Share of the torque limits that is kept free; `None` leaves torque out.
        parameters: Base parameters for torque, of an identification, shape (b,); the description's where not given.
        clearance: Distance that bodies keep [m]; `None` leaves collisions out.
        surroundings: Bodies that do not move.
        workspace: Where the tip may be.
        envelope: A motion whose velocity and acceleration are not exceeded.
        envelope_by_joint: Whether each joint keeps to its own, or all to the highest of any joint.
    """

    limits: str = "true"
    given: Mapping[tuple[str, str], float | tuple[float, float]] = field(default_factory=dict)  # pyright: ignore
    acceleration: float | None = None
    jerk: float | None = None
    torque_margin: float | None = 0.1
    parameters: Array | None = None
    clearance: float | None = None
    surroundings: tuple[Shape, ...] = ()
    workspace: Workspace | None = None
    envelope: Motion | None = None
    envelope_by_joint: bool = True


@dataclass(frozen=True, slots=True)
class Effort:
    """How long is looked.

    Attributes:
        budget: Wall time of the search [s]; `None` for no end other than `rounds`.
        seed: Of the starts.
        workers: Processes; 0 searches in this one.
        rounds: Whole rounds at most.
    """

    budget: float | None = 30.0
    seed: int = 1
    workers: int = 2
    rounds: int | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Designed(Shown):
    """What has come of it.

    Attributes:
        plan: The motion.
        problem: What was asked, every pair of bodies among its limits.
        x: The unknowns.
        limits: Of the joints.
        search: How it was found.
        preflight: What is known of it.
        findings: What the reader should know.
        collision: Bodies that are kept apart, where that was asked.
    """

    plan: Plan
    problem: Problem
    x: Array
    limits: Limits
    search: Search
    preflight: Preflight
    findings: tuple[Finding, ...]
    collision: Collision | None = None

    def summary(self) -> Summary:
        """The nearest that the plan comes to each kind of limit."""
        rows = tuple(
            (each.limit, each.label, f"{each.value:.4g} of {each.bound:.4g} {each.unit}", f"{each.certified:.1%}")
            for each in worst(self.preflight.margins)
        )
        note = f"expected condition number {self.preflight.expected.condition:.4g}; {len(self.findings)} findings"
        return Summary(self.plan.summary().title, ("limit", "of", "nearest", "certified"), rows, note)


def design_plan(
    wish: Wish, rules: Rules, effort: Effort, *, progress: Progress | None = None, executor: Executor | None = None
) -> Designed:
    """Design a motion.

    Args:
        wish: What it should be.
        rules: What it must keep to.
        effort: How long is looked.
        progress: Told of every descent.
        executor: Runs the search in the place of processes of its own.

    Raises:
        ArmidError: Limits that are missing, contradict each other or the start pose, or cannot be kept.
    """
    if effort.budget is not None and not effort.budget > 0.0:
        raise ArmidError(f"The budget is {effort.budget} s.", remedy="give some seconds; ten are enough for one arm.")
    goal = wish.goal
    robot = goal.model.robot
    if not wish.duration > 0.0:
        raise ArmidError(f"The duration must be positive; found {wish.duration} s.")
    limits = limits_of(robot, rules.given, acceleration=rules.acceleration, jerk=rules.jerk)
    if rules.envelope is not None:
        limits = limits.narrowed(rules.envelope, by_joint=rules.envelope_by_joint)
    torque, said = _torque(goal, limits, rules)
    start, collision, findings = place(robot, limits, rules, wish.start, _holds(goal, torque))
    basis = SeriesBasis(
        2.0 * math.pi / wish.duration, wish.harmonics, start, free=wish.free_start, literal=not wish.free_centre
    )
    channels = (*_motion(limits, basis, rules), *([] if torque is None else [torque]))
    channels = channels if rules.workspace is None else (*channels, rules.workspace)
    near = () if collision is None or collision.searched is None else (collision.searched,)
    every = () if collision is None or not len(collision.pairs) else (collision.every,)
    scale = float(np.median(limits.velocity)) / 1.75  # widths were chosen on an arm of that speed
    problem = Problem(goal, basis, (*channels, *near), scale)
    pool = nullcontext(executor) if executor or not effort.workers else single_threaded_pool(effort.workers)
    with pool as workers:
        found = search(
            problem,
            seed=effort.seed,
            budget=effort.budget,
            rounds=effort.rounds,
            executor=workers,
            progress=progress,
        )
    whole = replace(problem, channels=(*channels, *every))
    x, margins = certified(whole, fine_grid(whole), found.best.x)
    plan = _with_leads(basis, x, wish, limits, robot.name)
    _check_leads(plan, robot, collision)
    report = preflight(whole, x, collision, margins)
    return Designed(plan, whole, x, limits, found, report, (*findings, *said), collision)


def place(
    robot: Robot, limits: Limits, rules: Rules, given: Array | None, holds: Holds = anywhere
) -> tuple[Array, Collision | None, tuple[Finding, ...]]:
    """The start pose that is given, or one with room around it, and what keeps apart from there.

    Without collisions it is zero where joints can be there, else the middle of their range; where bodies must keep
    apart, see `armid.excitation.start`.

    Args:
        robot: The arm.
        limits: Of its joints.
        rules: What keeps apart.
        given: The pose, shape (n,) [rad or m], where one is given.
        holds: Which poses the joints can hold.

    Raises:
        ArmidError: The pose breaks a limit, or bodies are too close in it.
    """
    cell = None
    if rules.clearance is not None:
        cell = cell_of(robot, limits, rules.surroundings, margin=rules.clearance)
    findings: tuple[Finding, ...] = ()
    if given is not None:
        start = _checked_start(robot, limits, given)
    elif cell is None:
        start = usual_pose(limits)
    else:
        chosen = choose_start(cell, limits, holds)
        start = chosen.pose
        if not chosen.usual:
            said = (
                f"the usual start pose leaves less room; the series starts at {' '.join(f'{q:g}' for q in start)}, "
                f"about which {100 * chosen.room:.0f} % of the swings that were tried are free"
            )
            findings = (Finding("start-chosen", "info", "", said, "choose another with --start."),)
    if cell is None:
        return start, None, (*findings, UNSEEN)
    collision = kept_apart(cell, start)
    return start, collision, (*findings, *_left_out(collision))


UNSEEN = Finding(
    "collision-unseen",
    "warning",
    "",
    "what space links and surroundings take was not looked at: the arm may meet itself, the floor or what stands by",
    "look at the preview and run the rehearsal first; --collision --floor HEIGHT keeps them apart.",
)
"""What is to be known of a plan that keeps the limits of joints alone."""


def _left_out(collision: Collision) -> tuple[Finding, ...]:
    """Pairs of bodies that nobody looks at: for some of them that is the description's doing, for others a guess."""
    always = [each.pair for each in collision.skipped if each.always]
    often = [f"{each.pair} ({100 * each.share:.0f} %)" for each in collision.skipped if not each.always]
    result: list[Finding] = []
    if always:
        said = f"{len(always)} pairs of bodies touch in every pose and are not looked at: {'; '.join(always)}"
        result.append(Finding("pairs-touching-always", "info", "", said))
    if often:
        said = (
            "hulls around these bodies are too close in most poses and in the start pose, so nobody looks at them; "
            f"the bodies themselves are so in this share of poses: {'; '.join(often)}"
        )
        remedy = "look at these in the preview, or choose a start pose in which they are apart with --start."
        result.append(Finding("pairs-touching-often", "warning", "", said, remedy))
    return tuple(result)


def _checked_start(robot: Robot, limits: Limits, given: Array) -> Array:
    """A start pose inside its limits."""
    start = np.asarray(given, dtype=np.float64)
    if start.shape != (robot.n,):
        raise ArmidError(
            f"The start pose has {start.size} numbers; {robot.name} has {robot.n} joints.",
            remedy="give one number a joint.",
        )
    for name, q, low, high in zip(robot.joint_names, start, limits.lower, limits.upper, strict=True):
        if not low < q < high:
            raise ArmidError(
                f"The start pose puts {name} at {q:g}, outside {low:g} to {high:g}.",
                remedy="choose a pose inside the limits with --start.",
            )
    return start


def _motion(limits: Limits, basis: SeriesBasis, rules: Rules) -> tuple[Channel, ...]:
    """Limits of the motion itself, or of sums of its amplitudes.

    Raises:
        ArmidError: There are no limits of that kind.
    """
    if rules.limits not in LIMIT_KINDS:
        raise ArmidError(
            f"There are no limits of kind {rules.limits!r}.",
            possible=", ".join(LIMIT_KINDS),
            remedy=did_you_mean(rules.limits, LIMIT_KINDS),
        )
    motion = motion_channels(limits)
    if rules.limits == "true":
        return motion
    form: Literal["thesis", "thesis-literal"] = "thesis" if rules.limits == "thesis" else "thesis-literal"
    kept = [channel for channel in motion if channel.name not in ("position", "velocity")]
    return (*thesis_channels(limits, basis, form=form), *kept)


def _torque(goal: Goal, limits: Limits, rules: Rules) -> tuple[Torque | None, tuple[Finding, ...]]:
    """Limits of torque, and which masses they are told with."""
    if rules.torque_margin is None or not np.isfinite(limits.effort).any():
        return None, ()
    values, findings = rules.parameters, ()
    if values is None:
        nominal = goal.model.nominal_parameters()
        values = None if nominal is None or not nominal.any() else goal.base.values_of(nominal)
        said = "torque is that of the description's links; friction is not known to it"
        findings = (Finding("torque-nominal", "info", "", said),)
    if values is None:
        said = f"{goal.model.robot.name} gives no masses, so torque is not limited"
        remedy = "give a run of an identification with --after."
        return None, (Finding("torque-unknown", "warning", "", said, remedy),)
    return torque_channel(limits, values, rules.torque_margin), findings


def _holds(goal: Goal, torque: Torque | None) -> Holds:
    """Which poses the joints can hold, with something left to move."""
    if torque is None:
        return anywhere

    def holds(q: Array) -> NDArray[np.bool_]:
        columns = Columns(goal.source, len(q))
        columns.fill(q, np.zeros_like(q), np.zeros_like(q))
        share = np.abs(columns.torque(torque.base)[:, torque.joints]) / torque.limit
        return np.asarray((share <= HELD).all(axis=1), dtype=np.bool_)

    return holds


def _with_leads(basis: SeriesBasis, x: Array, wish: Wish, limits: Limits, name: str) -> Plan:
    """The plan with ways from and to other poses, no faster than half the limits."""
    series = basis.excitation(x, name)
    start = series.at([0.0]).q[0]
    acceleration = np.where(np.isfinite(limits.acceleration), limits.acceleration, LEAD_ACCELERATION)

    def seconds(pose: Array | None) -> float:
        if pose is None:
            return 0.0
        if np.shape(pose) != start.shape:
            raise ArmidError(
                f"A pose has {np.size(pose)} numbers; the arm has {len(start)} joints.",
                remedy="give one number a joint.",
            )
        return max(seconds_for(pose - start, LEAD_SHARE * limits.velocity, acceleration, limits.jerk), 0.1)

    return Plan(series, wish.goal.repetitions, wish.begin, wish.end, seconds(wish.begin), seconds(wish.end))


def _check_leads(plan: Plan, robot: Robot, collision: Collision | None) -> None:
    """Refuse ways from and to other poses on which bodies come too close.

    Raises:
        ArmidError: They do; the message names the pair.
    """
    if collision is None or not plan.lead_in + plan.lead_out:
        return
    series = plan.lead_in + plan.repetitions * plan.excitation.period
    for name, since, seconds in (("begin", 0.0, plan.lead_in), ("end", series, plan.lead_out)):
        if not seconds:
            continue
        q = plan.at(since + np.linspace(0.0, seconds, max(50, round(LEAD_CHECKS * seconds)))).q
        distance = collision.every.bodies.distances(forward_kinematics(robot, q))
        k = int(distance.min(axis=0).argmin())
        if distance[:, k].min() < collision.every.margin:
            raise ArmidError(
                f"On the way from or to the {name} pose, {collision.every.labels[k]} come within "
                f"{1000 * max(distance[:, k].min(), 0.0):.0f} mm.",
                remedy="choose another pose, or go there by hand and leave it out.",
            )
