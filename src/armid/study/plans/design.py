"""Design of a motion from a robot, a goal and constraints: start pose, search, certification, preflight report."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from armid.errors import ArmidError, Finding, did_you_mean
from armid.excitation.certification import Margin, certified, fine_grid
from armid.excitation.collision.closest_approach import closest_approaches
from armid.excitation.collision.collision_model import CollisionOptions
from armid.excitation.design.multistart import Progress, Search, search, single_threaded_pool
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.design.regressor_gradients import Columns
from armid.excitation.design.sqp import DescentProblem, about_start
from armid.excitation.limits.constraints import ConstraintChannel
from armid.excitation.limits.joint_limits import (
    Limits,
    limits_of,
    limits_wider_than_described,
    motion_channels,
    soft_limits_used,
    thesis_channels,
    torque_channel,
)
from armid.excitation.limits.torque_limits import Torque
from armid.excitation.plan import Plan, seconds_for
from armid.excitation.preflight import Expectation, Preflight, preflight, worst
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.excitation.search_convergence import unsettled
from armid.excitation.start_pose import Holds, TorqueHolds, any_pose
from armid.excitation.weak_motion import weak_motion
from armid.notebook import Displayed, Summary
from armid.robot.kinematics import forward_kinematics
from armid.robot.missing_inertia import inertial_key, massless_joints
from armid.robot.robot import Robot
from armid.study.plans.goals import LIMIT_KINDS, DesignConstraints, DesignGoal, SearchBudget
from armid.study.plans.start_pose import place_motion
from armid.values import Array

LEAD_SHARE = 0.5
"""Share of the velocity limits that the motions to and from the start pose use."""

LEAD_CHECKS = 200.0
"""Rate at which the motions to and from the start pose are checked for collisions [Hz]."""

SPREAD = 200.0
"""Rate at which extreme positions and accelerations of a motion are sampled [Hz]."""

HELD = 0.9
"""Largest share of the torque limits that is needed to hold the arm in an automatically chosen start pose."""

DRAWN, DRAWN_BY = 0.1, 0.85
"""Smallest factor, and factor of each step, by which a plan is scaled down about its start pose to separate bodies
whose distance has no gradient in the search."""

TRIED = 50.0
"""Rate at which bodies without gradient are tested before a plan is certified [Hz]; the certified plan is tested
at `RATE`."""

LEAD_ACCELERATION = 2.0
"""Acceleration of the motions to and from the start pose if no limit is given [rad/s² or m/s²]."""


Stage = Callable[[str], None]
"""Callback with the name of a stage of a design."""


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Designed(Displayed):
    """Result of a design.

    Attributes:
        plan: The motion.
        problem: The optimisation problem, with constraints for all pairs of bodies.
        x: Values of the unknowns.
        limits: Limits of the joints.
        search: Course of the search.
        preflight: Check of the plan against all limits.
        findings: Findings of the design.
        collision: Bodies that are kept apart; `None` where collisions are not checked.
    """

    plan: Plan
    problem: DescentProblem
    x: Array
    limits: Limits
    search: Search
    preflight: Preflight
    findings: tuple[Finding, ...]
    collision: CollisionOptions | None = None

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.problem.goal.model.robot

    @property
    def start(self) -> Array:
        """Pose at the beginning of the series, shape (n,) [rad or m]."""
        return self.plan.excitation.at([0.0]).q[0]

    @property
    def expected(self) -> Expectation:
        """Predicted uncertainty of the parameters after a recording of the plan."""
        assert self.preflight.expected is not None
        return self.preflight.expected

    @property
    def torque(self) -> Torque | None:
        """Limits of the torque; `None` if torque is not checked."""
        return next((each for each in self.problem.channels if isinstance(each, Torque)), None)

    @property
    def heading(self) -> str:
        """Text with the number of harmonics, the period, the repetitions and the duration."""
        plan, series = self.plan, self.plan.excitation
        times = "once" if plan.repetitions == 1 else f"{plan.repetitions} times"
        leads = (
            f"; {plan.duration:.1f} s with the motions to and from the start pose"
            if plan.lead_in + plan.lead_out
            else ""
        )
        return f"{series.harmonics} harmonics over {series.period:g} s, {times}{leads}"

    def spread(self, margin: Margin) -> tuple[float, float, float, float] | None:
        """Lowest and highest position of a joint and its limits, for a position limit; `None` for other limits."""
        if margin.limit != "position" or margin.label not in self.limits.joints:
            return None
        j, series = self.limits.joints.index(margin.label), self.plan.excitation
        q = series.sample(SPREAD).q[:, j]
        low, high = min(float(q.min()), margin.value), max(float(q.max()), margin.value)
        return low, high, float(self.limits.lower[j]), float(self.limits.upper[j])

    def summary(self) -> Summary:
        """Summary with the smallest margin to each kind of limit."""
        rows = tuple(
            (each.limit, each.label, f"{each.value:.4g} of {each.bound:.4g} {each.unit}", f"{each.certified:.1%}")
            for each in worst(self.preflight.margins)
        )
        note = f"expected condition number {self.expected.condition:.4g}; {len(self.findings)} findings"
        return Summary(self.plan.summary().title, ("limit", "of", "nearest", "certified"), rows, note)


def design_plan(
    goal: DesignGoal,
    constraints: DesignConstraints,
    budget: SearchBudget,
    *,
    progress: Progress | None = None,
    executor: Executor | None = None,
    stage: Stage = lambda name: None,
) -> Designed:
    """Designs a motion.

    Args:
        goal: Model, criterion, length and poses of the motion.
        constraints: Limits that the motion must keep.
        budget: Time, workers and seed of the search.
        progress: Called after every descent of the search.
        executor: Runs the search; by default processes are started for it.
        stage: Called with the name of each stage before and after the search.

    Raises:
        ArmidError: Limits are missing, contradict each other, exclude the start pose, or cannot be kept.
    """
    _check_times(goal, budget)
    criterion, robot = goal.goal, goal.goal.model.robot
    limits = constrained_limits(robot, constraints)
    torque, torque_findings = judged_torque(criterion, limits, constraints)
    stage("start pose")
    placed = place_motion(robot, limits, constraints, goal.start, pose_holds(criterion, torque))
    collision = placed.collision
    basis = SeriesBasis(
        2.0 * math.pi / goal.duration,
        goal.harmonics,
        placed.start,
        free=goal.free_start,
        literal=not goal.free_centre,
    )
    channels = (*_motion(limits, basis, constraints), *([] if torque is None else [torque]))
    channels = channels if constraints.workspace is None else (*channels, constraints.workspace)
    near = () if collision is None or collision.searched is None else (collision.searched,)
    every = () if collision is None or not len(collision.pairs) else (collision.every,)
    scale = float(np.median(limits.velocity)) / 1.75  # widths were chosen on an arm of that speed
    problem = DescentProblem(criterion, basis, (*channels, *near), scale)
    pool = nullcontext(executor) if executor or not budget.workers else single_threaded_pool(budget.workers)
    with pool as workers:
        stage("search")
        seed, seconds, rounds = budget.seed, budget.budget, budget.rounds
        found = search(problem, seed=seed, budget=seconds, rounds=rounds, executor=workers, progress=progress)
    whole = replace(problem, channels=(*channels, *every))
    x, report = _finished(whole, found.best.x, collision, placed.unchecked, stage)
    plan = _with_leads(basis, x, goal, limits, robot.name)
    _check_leads(plan, robot, collision)
    unfinished = unsettled(found, criterion.criterion, budget.budget)
    weak = weak_motion(whole, x, limits, collision, settled=unfinished is None)
    wider = limits_wider_than_described(robot, limits)
    report = replace(report, weak=weak, wider=wider)
    remarks = (wider, weak, unfinished, soft_limits_used(robot, limits), _unlimited(plan, limits, robot))
    findings = (*placed.findings, *torque_findings, *filter(None, remarks))
    return Designed(plan, whole, x, limits, found, report, findings, collision)


def constrained_limits(robot: Robot, constraints: DesignConstraints) -> Limits:
    """Limits of the joints, within the envelope where there is one."""
    limits = limits_of(robot, constraints.given, acceleration=constraints.acceleration, jerk=constraints.jerk)
    if constraints.envelope is None:
        return limits
    return limits.narrowed(constraints.envelope, by_joint=constraints.envelope_by_joint)


def _check_times(goal: DesignGoal, budget: SearchBudget) -> None:
    """Refuses a duration or a budget that is not positive."""
    if budget.budget is not None and not budget.budget > 0.0:
        raise ArmidError(
            f"The time budget of the search must be positive; found {budget.budget} s.",
            remedy="give a budget of some seconds; ten seconds are enough for one arm.",
        )
    if not goal.duration > 0.0:
        raise ArmidError(f"The duration of a period must be positive; found {goal.duration} s.")


def _unlimited(plan: Plan, limits: Limits, robot: Robot) -> Finding | None:
    """Finding with the largest accelerations of joints without a limit; `None` if all joints have one."""
    free = np.flatnonzero(~np.isfinite(limits.acceleration))
    if not free.size:
        return None
    peaks = np.abs(plan.excitation.sample(SPREAD).ddq).max(axis=0)
    peaks_text = ", ".join(f"{robot.joint_names[j]} {peaks[j]:.3g} {robot.joints[j].unit}/s²" for j in free)
    evidence = f"Acceleration is not limited, because no limit is given; the plan reaches {peaks_text}"
    remedy = "give a limit with --acceleration, or with --limit JOINT.acceleration=VALUE."
    return Finding("acceleration-unlimited", "info", "", evidence, remedy)


def _finished(
    problem: DescentProblem, x: Array, collision: CollisionOptions | None, unchecked: str, stage: Stage
) -> tuple[Array, Preflight]:
    """Unknowns and preflight of the plan with certified limits, scaled down while bodies with exact geometry touch.

    If scaling down does not separate the bodies, the report names them.
    """
    grid, basis = fine_grid(problem), problem.basis
    times, robot = basis.times(max(100, round(TRIED * basis.period))), problem.goal.model.robot
    factor, trial = 1.0, x
    while True:
        while factor > DRAWN and collision is not None:
            if collision.clear_as_they_are(robot, basis.excitation(trial).at(times).q):
                break
            factor *= DRAWN_BY
            trial = about_start(basis, x, factor)
        stage("certificate of the limits")
        done, margins = certified(problem, grid, trial)
        stage("closest approaches")
        report = preflight(problem, done, collision, margins, unchecked)
        if factor <= DRAWN or all(each.kept for each in report.approaches):
            return done, report
        factor *= DRAWN_BY
        trial = about_start(basis, x, factor)


def _motion(limits: Limits, basis: SeriesBasis, constraints: DesignConstraints) -> tuple[ConstraintChannel, ...]:
    """Constraints on the motion itself, or on sums of the amplitudes of the series.

    Raises:
        ArmidError: The kind of limits is unknown.
    """
    if constraints.limits not in LIMIT_KINDS:
        raise ArmidError(
            f"Unknown kind of limits {constraints.limits!r}.",
            possible=", ".join(LIMIT_KINDS),
            remedy=did_you_mean(constraints.limits, LIMIT_KINDS),
        )
    motion = motion_channels(limits)
    if constraints.limits == "true":
        return motion
    form: Literal["thesis", "thesis-literal"] = "thesis" if constraints.limits == "thesis" else "thesis-literal"
    other = [channel for channel in motion if channel.name not in ("position", "velocity")]
    return (*thesis_channels(limits, basis, form=form), *other)


def judged_torque(
    goal: CriterionGoal, limits: Limits, constraints: DesignConstraints
) -> tuple[Torque | None, tuple[Finding, ...]]:
    """Constraint on torque, with findings about the masses with which torque is computed."""
    if constraints.torque_margin is None:
        return None, ()
    unlimited = [limits.joints[j] for j in np.flatnonzero(~np.isfinite(limits.effort))]
    values, findings = constraints.parameters, (() if not unlimited else (_unjudged(unlimited, goal.model.robot),))
    if len(unlimited) == len(limits.joints):
        return None, findings
    if values is None:
        nominal = goal.model.nominal_parameters()
        values = None if nominal is None or not nominal.any() else goal.base.values_of(nominal)
        evidence = "torque is computed from the masses and inertias of the description, without friction"
        findings = (*findings, Finding("torque-nominal", "info", "", evidence))
        robot = goal.model.robot
        limited = [name for name, limit in zip(limits.joints, limits.effort, strict=True) if np.isfinite(limit)]
        if values is not None and (empty := [name for name in massless_joints(robot) if name in limited]):
            evidence = (
                f"in the description, the links that {', '.join(empty)} move have no mass, so the torque of these "
                "joints is assumed to be zero"
            )
            remedy = (
                f"add {inertial_key(robot)} to the links that they move, or give the folder of an identification "
                "run with --after."
            )
            findings = (*findings, Finding("torque-unknown", "warning", ", ".join(empty), evidence, remedy))
    if values is None:
        evidence = (
            f"torque is not checked and not limited, because the description of {goal.model.robot.name} has no masses"
        )
        remedy = "give the folder of an identification run with --after."
        return None, (Finding("torque-unknown", "warning", "", evidence, remedy), *findings[: bool(unlimited)])
    return torque_channel(limits, values, constraints.torque_margin), findings


def _unjudged(joints: Sequence[str], robot: Robot) -> Finding:
    """Finding that the torque of joints without an effort limit is not checked."""
    which = "any joint" if len(joints) == robot.n else ", ".join(joints)
    masses = ", and no mass is known" if len(massless_joints(robot)) == robot.n else ""
    evidence = f"the torque of {which} is not checked, because no effort limit is given{masses}"
    return Finding("torque-unjudged", "info", "", evidence, "give the limit with --limit JOINT.effort=VALUE.")


def pose_holds(goal: CriterionGoal, torque: Torque | None) -> Holds:
    """Test whether the joints can hold a pose with a reserve of torque."""
    if torque is None:
        return any_pose

    def shares(q: Array) -> Array:
        columns = Columns(goal.source, len(q))
        columns.fill(q, np.zeros_like(q), np.zeros_like(q))
        return np.abs(columns.torque(torque.base)[:, torque.joints]) / torque.limit

    return TorqueHolds(torque.labels, shares, HELD)


def _with_leads(basis: SeriesBasis, x: Array, goal: DesignGoal, limits: Limits, name: str) -> Plan:
    """Plan with motions from and to other poses, which use at most half of the velocity limits."""
    series = basis.excitation(x, name)
    start = series.at([0.0]).q[0]
    acceleration = np.where(np.isfinite(limits.acceleration), limits.acceleration, LEAD_ACCELERATION)

    def seconds(pose: Array | None) -> float:
        if pose is None:
            return 0.0
        if np.shape(pose) != start.shape:
            raise ArmidError(
                f"A pose before or after the motion has {np.size(pose)} numbers, but the arm has {len(start)} "
                "joints.",
                remedy="give one number for each joint.",
            )
        return max(seconds_for(pose - start, LEAD_SHARE * limits.velocity, acceleration, limits.jerk), 0.1)

    return Plan(series, goal.goal.repetitions, goal.begin, goal.end, seconds(goal.begin), seconds(goal.end))


def _check_leads(plan: Plan, robot: Robot, collision: CollisionOptions | None) -> None:
    """Refuses motions from and to other poses during which bodies come too close to each other.

    Raises:
        ArmidError: Bodies come too close to each other; the message names the pair.
    """
    if collision is None or not plan.lead_in + plan.lead_out:
        return
    series = plan.lead_in + plan.repetitions * plan.excitation.period
    for name, since, seconds in (("begin", 0.0, plan.lead_in), ("end", series, plan.lead_out)):
        if not seconds:
            continue
        q = plan.at(since + np.linspace(0.0, seconds, max(50, round(LEAD_CHECKS * seconds)))).q
        times = since + np.linspace(0.0, seconds, len(q))
        nearest = closest_approaches(collision, times, forward_kinematics(robot, q))
        close = [each for each in nearest if not each.kept]
        if close:
            raise ArmidError(
                f"During the motion from or to the {name} pose, {close[0].pair} come as close as "
                f"{1000 * max(close[0].distance, 0.0):.0f} mm.",
                remedy="choose another pose, or leave the pose out and move the arm there by hand.",
            )
