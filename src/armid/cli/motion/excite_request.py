"""Options of `armid excite`, converted to the goal, constraints and search budget of a design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from typing import Any

from armid.checked_array import Array
from armid.cli.motion.excite_goal import goal_of, torque_of_runs
from armid.cli.motion.motion_of_file import motion_of_file
from armid.cli.motion.number_options import numbers, parse_limits
from armid.errors import ArmidError
from armid.excitation.collision.ignored_pairs import ignored_of_srdf, parse_ignored
from armid.excitation.design.multistart import Progress
from armid.excitation.limits.workspace import Workspace, box_workspace
from armid.model.dynamics_model import DynamicsModel
from armid.robot.robot import Robot
from armid.robot.shapes import Shape
from armid.study.plans.certified_plan import Stage
from armid.study.plans.design import DesignConstraints, DesignGoal, SearchBudget, design_plan
from armid.study.plans.design_result import Designed
from armid.study.plans.poses_and_sweeps import DesignedMoves, MovesGoal, design_moves
from armid.study.plans.surroundings import assumed_floor, meshes_are_missing, surroundings_of

TORQUE_MARGIN = 0.1
"""Default unused share of the torque limits; it is not zero, because the masses of a description are inaccurate."""


def run_request(
    model: DynamicsModel,
    options: Mapping[str, Any],
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
    stage: Stage = lambda name: None,
) -> Designed:
    """Design the motion that the options of `armid excite` request.

    Args:
        model: Arm and torque terms.
        options: Values of the command line's options, by name.
        executor: Executor of the search; if `None`, the search runs in this process.
        progress: Callback that is called after every descent.
        stage: Callback that is called with the name of each stage before and after the search.
    """
    goal = goal_of(model, options)
    design_goal = DesignGoal(
        goal,
        options["duration"],
        options["harmonics"],
        _pose(options, "start", model.robot),
        options["free_start"],
        options["free_centre"],
        _pose(options, "begin", model.robot),
        _pose(options, "end", model.robot),
    )
    budget = SearchBudget(options["budget"], options["seed"], 0)
    constraints = design_constraints(options, model.robot)
    return design_plan(design_goal, constraints, budget, progress=progress, executor=executor, stage=stage)


def design_constraints(options: Mapping[str, Any], robot: Robot) -> DesignConstraints:
    """Constraints of a design from its options: joint limits, torque margin, collisions, workspace, envelope."""
    surroundings = surroundings_of(options, robot)
    margin = options["torque_margin"]
    return DesignConstraints(
        options["limits"],
        parse_limits(options["limit"] or ()),
        options["acceleration"],
        options["jerk"],
        TORQUE_MARGIN if margin is None and options["limits"] == "true" else margin,
        torque_of_runs(options["after"] or (), robot),
        _clearance(options, robot, surroundings),
        surroundings,
        assumed_floor(robot, options),
        _workspace(options["tip_box"]),
        None if options["envelope"] is None else motion_of_file(options["envelope"], robot),
        not options["envelope_of_arm"],
        (
            *map(parse_ignored, options["ignore_pair"] or ()),
            *(() if options["srdf"] is None else ignored_of_srdf(options["srdf"])),
        ),
    )


def _clearance(options: Mapping[str, Any], robot: Robot, surroundings: Sequence[Shape]) -> float | None:
    """Required distance of bodies [m]; `None` without collision checks or without bodies.

    Raises:
        ArmidError: The options both exclude and require collision checks.
    """
    requested, has_bodies = options["collision"], bool(robot.shapes) or meshes_are_missing(robot)
    if requested is False and surroundings:
        raise ArmidError(
            "--no-collision contradicts --floor or --environment, which need collision checks.",
            remedy="leave out --no-collision, or leave out --floor and --environment.",
        )
    return options["clearance"] if requested is not False and (requested or surroundings or has_bodies) else None


def run_experiment(model: DynamicsModel, options: Mapping[str, Any]) -> DesignedMoves:
    """Design static poses or constant velocities from the options of `armid excite`.

    Raises:
        ArmidError: The experiment is unknown, no run given with --after is about this arm, or bodies come too close
            to each other during it.
    """
    kind, start = options["experiment"], _pose(options, "start", model.robot)
    goal = MovesGoal(kind, options["poses"], options["rest"], start, options["seed"])
    constraints = design_constraints(options, model.robot)
    if options["after"] and constraints.estimate is None:
        raise ArmidError(
            f"--after {' '.join(options['after'])}: poses and sweeps use the torque of an earlier run, but none of "
            f"these runs has identified {model.robot.name} with the same direction of gravity.",
            remedy="give a run of this arm with the same gravity, or leave out --after: the torque is then computed "
            "from the description.",
        )
    return design_moves(model, goal, constraints)


def _pose(options: Mapping[str, Any], name: str, robot: Robot) -> Array | None:
    """Pose given by an option, shape (n,) [rad or m].

    Raises:
        ArmidError: The number of values is not the number of joints.
    """
    try:
        return numbers(options[name], f"--{name}", robot.n)
    except ArmidError as error:
        order = f"one number for each joint, in this order: {', '.join(robot.joint_names)}"
        raise ArmidError(error.problem, possible=order, remedy=error.remedy) from error


def _workspace(text: str | None) -> Workspace | None:
    """Box in which the tip must stay, from the option --tip-box."""
    corners = numbers(text, "--tip-box", 6)
    if corners is None:
        return None
    low, high = corners[:3], corners[3:]
    if not (low < high).all():
        raise ArmidError(
            f"--tip-box {text}: the box is empty.",
            remedy="give the lower corner and then the upper corner, in metres.",
        )
    return box_workspace(low.tolist(), high.tolist())
