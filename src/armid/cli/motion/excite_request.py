"""Options of `armid excite`, converted to the goal, constraints and search budget of a design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.errors import ArmidError
from armid.excitation.collision.ignored_pairs import ignored_of_srdf, parse_ignored
from armid.excitation.design.multistart import Progress
from armid.excitation.design.objective import CriterionGoal, information_along, known_sizes
from armid.excitation.fourier import Excitation
from armid.excitation.limits.workspace import Workspace, box_workspace
from armid.information.information import Information
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import process_recordings
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.model.motion import Motion
from armid.robot.robot import Robot
from armid.robot.shapes import Shape
from armid.runs.run import MARKER, load_run
from armid.study.config import RecordingChoice
from armid.study.plans.design import DesignConstraints, Designed, DesignGoal, SearchBudget, Stage, design_plan
from armid.study.plans.plan_files import is_plan, motion_of_plan, series_of
from armid.study.plans.poses_and_sweeps import DesignedMoves, MovesGoal, design_moves
from armid.study.plans.surroundings import assumed_floor, meshes_are_missing, surroundings_of
from armid.study.read_recordings import read_choice
from armid.values import Array, load

Limit = float | tuple[float, float]

TORQUE_MARGIN = 0.1
"""Default share of the torque limits that stays unused, because the masses of a description are inaccurate."""


def run_request(
    model: DynamicsModel,
    options: Mapping[str, Any],
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
    stage: Stage = lambda name: None,
) -> Designed:
    """Design the motion that the options of `armid excite` ask for.

    Args:
        model: Arm and torque terms.
        options: Values of the command line's options, by name.
        executor: Runs the search; without one the search runs in this process.
        progress: Called after every descent.
        stage: Called with the name of each stage before and after the search.
    """
    goal = _goal(model, options)
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
    constraints = replace(
        design_constraints(options, model.robot), parameters=_identified(options["after"] or (), goal)
    )
    return design_plan(design_goal, constraints, budget, progress=progress, executor=executor, stage=stage)


def design_constraints(options: Mapping[str, Any], robot: Robot) -> DesignConstraints:
    """Constraints of a design: joint limits, torque margin, collisions, workspace, envelope."""
    surroundings = surroundings_of(options, robot)
    margin = options["torque_margin"]
    return DesignConstraints(
        options["limits"],
        parse_limits(options["limit"] or ()),
        options["acceleration"],
        options["jerk"],
        TORQUE_MARGIN if margin is None and options["limits"] == "true" else margin,
        None,
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
            remedy="give one or the other.",
        )
    return options["clearance"] if requested is not False and (requested or surroundings or has_bodies) else None


def run_experiment(model: DynamicsModel, options: Mapping[str, Any]) -> DesignedMoves:
    """Design static poses or constant velocities, by the options of `armid excite`.

    Raises:
        ArmidError: The experiment is unknown, or bodies come too close to each other during it.
    """
    kind, start = options["experiment"], _pose(options, "start", model.robot)
    goal = MovesGoal(kind, options["poses"], options["rest"], start, options["seed"])
    parameters = _identified(options["after"], _goal(model, options)) if options["after"] else None
    return design_moves(model, goal, replace(design_constraints(options, model.robot), parameters=parameters))


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


def numbers(text: str | None, name: str, count: int) -> Array | None:
    """Numbers separated by commas or blanks, shape (count,); `None` if no text is given.

    Raises:
        ArmidError: The text is not a list of numbers, or it has a wrong count of numbers.
    """
    if text is None:
        return None
    try:
        values = np.array([float(x) for x in text.replace(",", " ").split()])
    except ValueError:
        raise ArmidError(f"{name} {text}: not a list of numbers.", remedy="write for instance 0,0.5,-1.") from None
    if len(values) != count or not np.isfinite(values).all():
        raise ArmidError(f"{name} needs {count} finite numbers; found {len(values)}: {text}.")
    return values


def _goal(model: DynamicsModel, options: Mapping[str, Any]) -> CriterionGoal:
    """Goal of the design: criterion, noise, information from earlier data, motion to predict.

    After a run the default criterion is the largest relative deviation, which a further recording should reduce.
    """
    base, n = find_base_parameters(model), model.n
    text = options["noise"]
    single = text is not None and len(text.replace(",", " ").split()) == 1
    noise = np.ones(n) if text is None else numbers(text, "--noise", 1 if single else n)
    assert noise is not None
    plain = CriterionGoal(model, base, "d-optimal", np.resize(noise, n), options["rate"], options["repetitions"])
    prior: Array | None = None
    scale: Array | None = None
    for path in options["after"] or ():
        known = prior_of_run(path, plain) if (Path(path) / MARKER).is_file() else _of_motion(path, plain)
        prior = known if prior is None else prior + known
        if (Path(path) / MARKER).is_file():
            values, deviations = _estimates(path, base)
            scale = known_sizes(values, deviations)
    prediction: Array | None = None
    for path in options["predict"] or ():
        along_path = _of_motion(path, plain)
        prediction = along_path if prediction is None else prediction + along_path
    default_criterion = "d-optimal" if scale is None else "worst"
    return replace(
        plain, criterion=options["criterion"] or default_criterion, prior=prior, prediction=prediction, scale=scale
    )


def _estimates(path: str, base: BaseParameters) -> tuple[Array, Array]:
    """Base parameters (b,) and deviations (b,) of a run; zero and infinite for parameters not in the run."""
    fit = load_run(path).estimate.fit
    index = {name: k for k, name in enumerate(fit.names)}
    known = np.array([name in index for name in base.names])
    at = [index[name] for name in base.names if name in index]
    values, deviations = np.zeros(base.count), np.full(base.count, np.inf)
    values[known], deviations[known] = fit.values[at], fit.deviation[at]
    return values, deviations


def _identified(paths: Sequence[str], goal: CriterionGoal) -> Array | None:
    """Base parameters (b,) for the torque limits, from the last run that identified all of them."""
    for path in reversed(paths):
        if (Path(path) / MARKER).is_file():
            values, deviations = _estimates(path, goal.base)
            if np.isfinite(deviations).all():
                return values
    return None


def _of_motion(path: str, goal: CriterionGoal) -> Array:
    """Information matrix (b, b) of one pass through a plan or recording."""
    series = _series(path)
    motion = motion_of_file(path, goal.model.robot) if series is None else series.sample(goal.rate)
    if motion.n != goal.model.n:
        raise ArmidError(
            f"{path} moves {motion.n} joints, but {goal.model.robot.name} has {goal.model.n}.",
            remedy="give a plan or recording of this arm.",
        )
    return information_along(goal, motion)


def prior_of_run(folder: str, goal: CriterionGoal) -> Array:
    """Information matrix (b, b) of a run's data for the goal's base parameters, matched by name.

    The stored rows of the run are weighted with the noise of the goal.

    Raises:
        ArmidError: The run has none of these parameters.
    """
    terms = ",".join(term.name for term in load_run(folder).model.terms)
    information = load(Information, Path(folder) / "information.npz")
    index = {name: k for k, name in enumerate(goal.base.names)}
    position = np.array([index.get(name, -1) for name in information.names])
    if information.n != goal.model.n or (position < 0).all():
        raise ArmidError(
            f"The run {folder} has none of the parameters of {goal.model.robot.name} with these terms.",
            possible=", ".join(information.names[:8]) + ", …",
            remedy=f"if it is the same arm, give the terms of the run: --terms {terms}.",
        )
    result = np.zeros((goal.base.count, goal.base.count))
    for joint, noise in zip(information.joints, goal.noise, strict=True):
        rows = joint.R[:, :, :-1].reshape(-1, len(joint.parameters))
        at = position[joint.parameters]
        result[np.ix_(at, at)] += rows.T @ rows / noise**2
    return result


def _series(path: str) -> Excitation | None:
    """Series of a plan, stretched to the period that may follow as `@SECONDS`; `None` for a recording."""
    name, at, seconds = path.partition("@")
    if not is_plan(name):
        return None
    series = series_of(name)
    if not at:
        return series
    try:
        period = float(seconds)
    except ValueError:
        period = 0.0
    if not period > 0.0:
        raise ArmidError(
            f"{path}: {seconds!r} is not a duration in seconds.", remedy="write for instance thesis-a1@27."
        )
    return series.stretched(period)


def motion_of_file(path: str, robot: Robot) -> Motion:
    """Motion of a plan, or of a recording that is processed with the default options.

    Raises:
        ArmidError: The file cannot be read, or its number of joints differs from the robot's.
    """
    series = _series(path)
    if series is not None:
        motion = series.sample(1000.0)
    else:
        motion = motion_of_plan(path, robot, 1000.0)
    if motion is None:
        recording, _ = read_choice(RecordingChoice(path, reading=LogFormat()), ".", robot)
        observations, _ = process_recordings([recording], ProcessingOptions(standstill="keep"))
        runs = [run.motion for run in observations.runs]
        motion = Motion(*(np.concatenate([getattr(run, key) for run in runs]) for key in ("time", "q", "dq", "ddq")))
    if motion.n != robot.n:
        raise ArmidError(
            f"{path} moves {motion.n} joints, but {robot.name} has {robot.n}.",
            remedy="give a plan or recording of this arm.",
        )
    return motion


def parse_limits(given: Sequence[str]) -> dict[tuple[str, str], Limit]:
    """Limits by joint and kind, from `JOINT.KIND=VALUE` or `JOINT.position=LOW:HIGH`, separated by commas.

    Raises:
        ArmidError: A text has another form.
    """
    result: dict[tuple[str, str], Limit] = {}
    for text in (part.strip() for each in given for part in each.split(",")):
        name, equals, value = text.partition("=")
        joint, dot, kind = name.rpartition(".")
        low, colon, high = value.partition(":")
        try:
            if not equals or not dot:
                raise ValueError
            result[joint, kind] = (float(low), float(high)) if colon else float(value)
        except ValueError:
            raise ArmidError(
                f"--limit {text}: not a limit.",
                remedy="write JOINT.velocity=1.2 or JOINT.position=-1:1; kinds are position, velocity, acceleration, "
                "jerk, effort.",
            ) from None
    return result


def _workspace(text: str | None) -> Workspace | None:
    """Box in which the tip must stay, from the option --tip-box."""
    corners = numbers(text, "--tip-box", 6)
    if corners is None:
        return None
    low, high = corners[:3], corners[3:]
    if not (low < high).all():
        raise ArmidError(
            f"--tip-box {text}: the box is empty.", remedy="give the low corner and then the high corner, in metres."
        )
    return box_workspace(low.tolist(), high.tolist())
