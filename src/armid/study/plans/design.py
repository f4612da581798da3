"""Design of a motion from a robot, a goal and constraints: start pose, search, certification, preflight report."""

from __future__ import annotations

import math
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import replace
from typing import Literal

import numpy as np

from armid.errors import ArmidError, Finding, did_you_mean
from armid.excitation.binding_constraints import restrained_motion
from armid.excitation.design.configuration_space_obstacles import measured_pairs
from armid.excitation.design.multistart import Progress, Search, search, single_threaded_pool
from armid.excitation.design.sqp import DescentProblem
from armid.excitation.limits.constraint_channels import ConstraintChannel
from armid.excitation.limits.joint_limits import (
    Limits,
    limits_wider_than_described,
    motion_channels,
    soft_limits_used,
    thesis_channels,
)
from armid.excitation.plan import Plan
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.excitation.search_convergence import unsettled
from armid.excitation.weak_motion import weak_motion
from armid.robot.robot import Robot
from armid.study.plans.certified_plan import Stage, certified_plan
from armid.study.plans.design_options import (
    LIMIT_KINDS,
    DesignConstraints,
    DesignGoal,
    SearchBudget,
    constrained_limits,
)
from armid.study.plans.design_result import SPREAD, Designed
from armid.study.plans.leads import add_leads, check_leads
from armid.study.plans.start_pose_and_bodies import place_motion
from armid.study.plans.torque_constraint import judged_torque, pose_holds, torque_lacks


def design_plan(
    goal: DesignGoal,
    constraints: DesignConstraints,
    budget: SearchBudget,
    *,
    progress: Progress | None = None,
    executor: Executor | None = None,
    stage: Stage = lambda name: None,
) -> Designed:
    """Designs the periodic motion that keeps all constraints and has the smallest value of the criterion.

    Args:
        goal: Model, criterion, period and poses of the motion.
        constraints: Limits that the motion must keep.
        budget: Time, workers and seed of the search.
        progress: Function that is called after every descent of the search.
        executor: Pool of processes that runs the search; if not given, processes are started.
        stage: Function that is called with the name of each stage of the design, for instance `search`.

    Raises:
        ArmidError: Limits are missing, contradict each other, exclude the start pose, or cannot be kept.
        KeyboardInterrupt: The user has stopped the search.
    """
    _check_times(goal, budget)
    criterion, robot = goal.goal, goal.goal.model.robot
    limits = constrained_limits(robot, constraints)
    torque, torque_findings = judged_torque(criterion, limits, constraints)
    stage("start pose")
    placed = place_motion(robot, limits, constraints, goal.start, pose_holds(criterion, torque))
    collision, limits = placed.collision, placed.limits
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
    measured = () if collision is None else measured_pairs(collision, robot, limits, placed.start)
    problem = DescentProblem(criterion, basis, (*channels, *near, *measured), scale)
    stage("search")
    found = _searched(problem, budget, executor, progress)
    whole = replace(problem, channels=(*channels, *every))
    x, report = certified_plan(whole, found.best.x, collision, placed.unchecked, stage)
    plan = add_leads(basis, x, goal, limits, robot.name)
    check_leads(plan, robot, collision)
    unfinished = unsettled(found, criterion.criterion, budget.budget)
    weak = weak_motion(whole, x, limits, collision, settled=unfinished is None)
    restrained = restrained_motion(whole, x, report.margins, collision) if weak is None else None
    wider = limits_wider_than_described(robot, limits)
    report = replace(report, weak=weak, wider=wider, torque_lacks=torque_lacks(robot, constraints, torque))
    free = _unlimited(plan, limits, robot)
    remarks = (wider, weak, restrained, *report.remarks, unfinished, soft_limits_used(robot, limits), free)
    findings = (*placed.findings, *torque_findings, *filter(None, remarks))
    return Designed(plan, whole, x, limits, found, report, findings, collision)


def _searched(
    problem: DescentProblem, budget: SearchBudget, executor: Executor | None, progress: Progress | None
) -> Search:
    """Runs the search for the best plan in given processes, or in processes that are started for the search.

    Raises:
        KeyboardInterrupt: The user has stopped the search, so the best plan so far is not certified.
    """
    pool = nullcontext(executor) if executor or not budget.workers else single_threaded_pool(budget.workers)
    with pool as workers:
        found = search(
            problem,
            seed=budget.seed,
            budget=budget.budget,
            rounds=budget.rounds,
            executor=workers,
            progress=progress,
        )
    if found.interrupted:
        raise KeyboardInterrupt
    return found


def _check_times(goal: DesignGoal, budget: SearchBudget) -> None:
    """Raises an error if the duration of the motion or the time budget of the search is not positive."""
    if budget.budget is not None and not budget.budget > 0.0:
        raise ArmidError(
            f"The time budget of the search must be positive; found {budget.budget} s.",
            remedy="give a --budget of some seconds; ten seconds are enough for one arm.",
        )
    if not goal.duration > 0.0:
        raise ArmidError(
            f"The duration of a period must be positive; found {goal.duration} s.", remedy="give a longer --duration."
        )


def _unlimited(plan: Plan, limits: Limits, robot: Robot) -> Finding | None:
    """Finding with the largest accelerations of the joints without acceleration limit; `None` without such joints."""
    free = np.flatnonzero(~np.isfinite(limits.acceleration))
    if not free.size:
        return None
    peaks = np.abs(plan.excitation.sample(SPREAD).ddq).max(axis=0)
    peaks_text = ", ".join(f"{robot.joint_names[j]} {peaks[j]:.3g} {robot.joints[j].unit}/s²" for j in free)
    evidence = f"Acceleration is not limited, because no limit is given; the plan reaches {peaks_text}"
    remedy = "give a limit with --acceleration, or with --limit JOINT.acceleration=VALUE."
    return Finding("acceleration-unlimited", "info", "", evidence, remedy)


def _motion(limits: Limits, basis: SeriesBasis, constraints: DesignConstraints) -> tuple[ConstraintChannel, ...]:
    """Constraint channels of the limits: of the motion itself, or of sums of the amplitudes of the series.

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
