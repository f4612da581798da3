"""Identification of the model of a study: preparation of the data, estimate, and validation."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

from armid.estimation.estimate_record import Estimate
from armid.estimation.friction.selection import FrictionSelection
from armid.information.information import Information
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.notebook_display import Displayed, Summary
from armid.robot import Robot
from armid.study.config import Study, build_estimator
from armid.study.estimate_study import StudyEstimator, estimate_prepared
from armid.study.plausibility.estimate_findings import plausibility_findings
from armid.study.plausibility.one_sided_filter import one_sided_filter_finding
from armid.study.plausibility.recording_errors import contradicted
from armid.study.prepare import Prepared, prepare, separated_problem, stated_problem
from armid.study.progress import Progress, no_progress
from armid.study.recordings.left_out import with_left_out
from armid.study.recordings.processed import of_role
from armid.study.score_recordings import score_recordings, score_validation
from armid.threads import one_blas_thread
from armid.validation.torque_validation import (
    PredictedRecording,
    Score,
    Validation,
    predict_recording,
    validate,
)


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Result(Displayed):
    """Result of an identification: the inputs, the estimate and the torque errors of the estimate.

    Attributes:
        study: Study, in which automatic choices are replaced by their results.
        robot: The arm.
        model: Arm and torque terms.
        information: Information of the training recordings.
        estimate: The estimate.
        validation: Torque error on the validation recordings.
        training: Torque error on the training recordings.
        friction_selection: Result of the selection of friction; `None` if friction was not selected.
        given_format: Log format of the first training recording as given in the study, before armid guessed its
            columns.
        predictions: Torque that the estimate predicts for each recording, in the order of the study; may be empty.
    """

    study: Study
    robot: Robot
    model: DynamicsModel
    information: Information
    estimate: Estimate
    validation: Validation
    training: tuple[Score, ...]
    friction_selection: FrictionSelection | None = None
    given_format: LogFormat | None = None
    predictions: tuple[PredictedRecording, ...] = ()

    def summary(self) -> Summary:
        """Summary of the torque error on held-out motion; the parameters are in `estimate`."""
        return self.validation.summary()


@one_blas_thread
def identify(
    study: Study,
    *,
    given: Mapping[str, Recording] | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> Result:
    """Identifies the model of a study and validates it on the validation recordings of the study.

    Args:
        study: The study.
        given: Recordings that are in memory already, by their path in the study.
        threads: Number of threads of the compiled kernel.
        progress: Function that is called with the name of each stage and the share of the stage that is done.

    Raises:
        ArmidError: An input is wrong; the message names the input and the fault.
    """
    return conclude(prepare(study, given=given, threads=threads, progress=progress), progress=progress)


@one_blas_thread
def conclude(prepared: Prepared, *, progress: Progress | None = None, method: StudyEstimator | None = None) -> Result:
    """Estimates the parameters of a prepared study, and validates them on the study's validation recordings.

    Args:
        prepared: The prepared study.
        progress: Function that is called with the name of each stage and the share of the stage that is done.
        method: Estimator; if not given, that of the study.

    Raises:
        EstimationError: The data do not determine the parameters.
    """
    tell = progress or no_progress
    study, model, recordings = prepared.study, prepared.model, prepared.recordings
    robot = model.robot
    information = prepared.problem.information
    tell("estimation", 0.0)
    estimate = estimate_prepared(prepared, method)
    chosen = prepared.friction_selection is not None
    remarks = plausibility_findings(model, information, stated_problem(prepared), estimate.fit, chosen=chosen)
    one_sided = one_sided_filter_finding(information, prepared.problem, estimate.fit)
    on_recordings = prepared.findings if one_sided is None else (*prepared.findings, one_sided)
    findings = [*on_recordings, *estimate.findings, *remarks]
    tell("validation", 0.0)
    estimate, left_out = with_left_out(
        estimate, prepared.problem, partial(separated_problem, prepared), method or build_estimator(study.estimation)
    )
    train = of_role(recordings, "train")
    predictions = {each: predict_recording(model, estimate, each.observations) for each in recordings}
    training, _ = score_recordings(model, estimate, train, predictions)
    scores, found, disagreements = score_validation(prepared, estimate, training, predictions)
    on_recordings = (*on_recordings, *disagreements)
    validation = contradicted(validate(robot.joint_names, scores, estimate, left_out, training), on_recordings)
    tell("validation", 1.0)
    seconds = time.perf_counter() - prepared.began
    estimate = replace(estimate, findings=(*findings, *disagreements, *found), seconds=seconds)
    return Result(
        study,
        robot,
        model,
        information,
        estimate,
        validation,
        training,
        prepared.friction_selection,
        train[0].choice.reading,
        tuple(predictions.values()),
    )
