"""Goal of a design from the options of `armid excite`: criterion, noise, earlier data, motions to predict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.cli.motion.motion_of_file import motion_of_file, series_of_file
from armid.cli.motion.number_options import numbers
from armid.cli.options import BASE_TERMS, model_choice
from armid.dataclass_files import load
from armid.errors import ArmidError
from armid.excitation.design.objective import CriterionGoal, information_along, known_sizes
from armid.excitation.limits.torque_limits import EstimatedTorque
from armid.information.information import Information
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.robot.robot import Robot
from armid.runs.design_torque_model import estimated_torque, model_with_terms_of
from armid.runs.run import MARKER, Run, load_run
from armid.study.config import build_model

NO_EFFECT = 1e-9
"""Largest singular value, for columns of unit length, of a direction of parameters that counts as without effect."""


def design_model(robot: Robot, options: Mapping[str, Any]) -> DynamicsModel:
    """Model with the terms of --terms, or else of the last run of this arm in --after, or else the default terms."""
    if options["terms"] is None:
        for _, model in _runs_of(robot, options):
            return model
    return build_model(robot, model_choice(options["terms"], default=BASE_TERMS))


def _last_runs(paths: Sequence[str]) -> Iterator[Run]:
    """Runs among the given paths, the last run first."""
    return (load_run(path) for path in reversed(paths) if (Path(path) / MARKER).is_file())


def _runs_of(robot: Robot, options: Mapping[str, Any]) -> Iterator[tuple[Run, DynamicsModel]]:
    """Runs of this arm among those of --after, the last run first, each with its model for a design."""
    for run in _last_runs(options["after"] or ()):
        if (model := model_with_terms_of(run, robot)) is not None:
            yield run, model


def _noise(options: Mapping[str, Any], robot: Robot) -> Array:
    """Standard deviation of the torque noise, shape (n,) [N·m or N].

    It is the value of --noise, or else that of the last run of this arm in --after, or else 1.
    """
    text, n = options["noise"], robot.n
    if text is None:
        run, _ = next(_runs_of(robot, options), (None, None))
        noise = np.zeros(n) if run is None else run.estimate.fit.noise
        return noise if (noise > 0.0).all() else np.ones(n)
    single = len(text.replace(",", " ").split()) == 1
    noise = numbers(text, "--noise", 1 if single else n)
    assert noise is not None
    return np.resize(noise, n)


def goal_of(model: DynamicsModel, options: Mapping[str, Any]) -> CriterionGoal:
    """Goal of the design: criterion, noise, information from earlier data, motion to predict.

    If --after gives a run, the default criterion is the largest relative standard deviation, which a further
    recording should reduce.
    """
    base = find_base_parameters(model)
    noise = _noise(options, model.robot)
    plain = CriterionGoal(model, base, "d-optimal", noise, options["rate"], options["repetitions"])
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
    """Base parameters (b,) and standard deviations (b,) of a run; 0 and infinity for parameters not in the run."""
    fit = load_run(path).estimate.fit
    index = {name: k for k, name in enumerate(fit.names)}
    known = np.array([name in index for name in base.names])
    at = [index[name] for name in base.names if name in index]
    values, deviations = np.zeros(base.count), np.full(base.count, np.inf)
    values[known], deviations[known] = fit.values[at], fit.deviation[at]
    return values, deviations


def torque_of_runs(paths: Sequence[str], robot: Robot) -> EstimatedTorque | None:
    """Torque model for checks of torque limits, from the last run that has one for this arm; `None` without one."""
    return next(filter(None, (estimated_torque(run, robot) for run in _last_runs(paths))), None)


def _of_motion(path: str, goal: CriterionGoal) -> Array:
    """Information matrix (b, b) of a plan or recording that is executed once."""
    series = series_of_file(path)
    motion = motion_of_file(path, goal.model.robot) if series is None else series.sample(goal.rate)
    if motion.n != goal.model.n:
        raise ArmidError(
            f"{path} moves {motion.n} joints, but {goal.model.robot.name} has {goal.model.n}.",
            remedy="give a plan or recording of this arm.",
        )
    return information_along(goal, motion)


def prior_of_run(folder: str, goal: CriterionGoal) -> Array:
    """Information matrix (b, b) of a run's data for the goal's base parameters, matched by name.

    The stored rows of the run are weighted with the noise of the goal. Parameters that only the run has count
    as unknown. The result is the information that remains about the common parameters when the unknown parameters are
    estimated, too.

    Raises:
        ArmidError: The run has none of the base parameters of the goal.
    """
    terms = ",".join(term.name for term in load_run(folder).model.terms)
    information = load(Information, Path(folder) / "information.npz")
    index = {name: k for k, name in enumerate(goal.base.names)}
    position = np.array([index.get(name, -1) for name in information.names])
    if information.n != goal.model.n or (position < 0).all():
        raise ArmidError(
            f"The run {folder} has none of the base parameters of {goal.model.robot.name} with the given terms.",
            possible=", ".join(information.names[:8]) + ", …",
            remedy=f"if it is the same arm, give the terms of the run: --terms {terms}.",
        )
    rows = np.vstack([_rows(information, j) / noise for j, noise in enumerate(goal.noise)])
    known = _without(rows[:, position < 0], rows[:, position >= 0])
    at = position[position >= 0]
    result = np.zeros((goal.base.count, goal.base.count))
    result[np.ix_(at, at)] = known.T @ known
    return result


def _rows(information: Information, j: int) -> Array:
    """Rows of the triangular factors of joint `j` without the column of the torque, shape (N, b) for b parameters."""
    joint = information.joints[j]
    factors = joint.R[:, :, :-1].reshape(-1, len(joint.parameters))
    rows = np.zeros((len(factors), information.count))
    rows[:, joint.parameters] = factors
    return rows


def _without(unknown: Array, columns: Array) -> Array:
    """Rows with the information that remains about some parameters when unknown parameters are estimated with them.

    Args:
        unknown: Columns of the unknown parameters, shape (N, a).
        columns: Columns of the parameters whose information is computed, shape (N, k).

    Returns:
        Rows, shape (M, k). Directions in which the unknown parameters have no effect do not reduce the information.
    """
    a = unknown.shape[1]
    triangle: Array = np.asarray(np.linalg.qr(np.hstack([unknown, columns]), mode="r"))
    size = np.linalg.norm(triangle[:, :a], axis=0)
    left, values, _ = np.linalg.svd(triangle[:a, :a] / np.where(size > 0.0, size, 1.0))
    idle = left[:, ~(values > NO_EFFECT)]
    return np.vstack([idle.T @ triangle[:a, a:], triangle[a:, a:]])
