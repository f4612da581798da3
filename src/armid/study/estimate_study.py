"""Estimate of the parameters of a study; the estimate contains the digests (sha256) of all inputs."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from armid.errors import EstimationError
from armid.estimation.catalogue import Estimator
from armid.estimation.estimate_record import Estimate, InputDigest, TermUse
from armid.estimation.problem import EstimationProblem
from armid.estimation.run_estimator import estimate
from armid.hashes import digest
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.study.config import (
    Study,
    build_estimator,
)
from armid.study.diagnosis import diagnosed_error
from armid.study.extrapolation import highest_speeds
from armid.study.prepare import Prepared, stated_problem
from armid.study.recordings.processed import ProcessedRecording
from armid.study.selection_prior_options import with_origin_of_weight

StudyEstimator = Estimator
"""Estimator that replaces the estimator of a study."""


def estimate_prepared(prepared: Prepared, method: StudyEstimator | None = None) -> Estimate:
    """Estimates the parameters of a prepared study with an estimator; if not given, with that of the study.

    Raises:
        EstimationError: The data do not determine the parameters; the message contains the errors of the doctor.
    """
    problem = stated_problem(prepared)
    try:
        found = estimate_study(prepared.study, prepared.model, prepared.base, problem, prepared.recordings, method)
    except EstimationError as error:
        raise diagnosed_error(error, prepared.findings) from error
    return with_origin_of_weight(found, prepared.friction_selection)


def estimate_study(
    study: Study,
    model: DynamicsModel,
    base: BaseParameters,
    problem: EstimationProblem,
    recordings: Sequence[ProcessedRecording],
    method: StudyEstimator | None = None,
) -> Estimate:
    """Estimates the parameters with the method of a study; the estimate also contains digests of all its inputs.

    Args:
        study: The study.
        model: Arm and torque terms.
        base: Base parameters of the model.
        problem: Estimation problem: information of the training recordings, and the options of the estimate.
        recordings: All recordings with their roles, processed.
        method: Estimator; if not given, that of the study.

    Raises:
        EstimationError: The data do not determine the parameters.
    """
    fit = estimate(problem, method or build_estimator(study.estimation))
    options = digest(repr((study.model, study.processing, study.estimation)))
    made_from = (
        InputDigest("robot", model.robot.sha256),
        *(InputDigest(each.choice.role, each.recording.sha256) for each in recordings),
        InputDigest("options", options),
    )
    observations = problem.observations
    return Estimate(
        model.robot.name,
        study.estimation.method if method is None else method.name,
        _uses(model),
        base,
        fit,
        fit.findings,
        made_from=made_from,
        made_by=problem.information.made_by,
        speeds=None if observations is None else highest_speeds(observations),
    )


def _uses(model: DynamicsModel) -> tuple[TermUse, ...]:
    """Torque terms of a model, with the joints on which each term acts and its shapes."""
    names = model.robot.joint_names
    uses: list[TermUse] = []
    for term in model.terms:
        touched = sorted({j for law in term.laws(model.robot) for j, _ in law.coordinate}) or range(model.n)
        options = dataclasses.asdict(term)  # pyright: ignore[reportArgumentType]
        shapes = {key: value for key, value in options.items() if key != "joints" and value is not None}
        uses.append(TermUse(term.name, tuple(names[j] for j in touched), shapes))
    return tuple(uses)
