"""Identification: from a study to an estimated and validated model."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armid.errors import EstimationError, Finding, StudyError
from armid.estimation.estimate import Estimate, InputDigest, TermUse
from armid.estimation.estimating import estimate
from armid.estimation.friction.load_torque import with_load
from armid.estimation.friction.selection import FrictionSelection, choose_friction
from armid.estimation.per_recording import offset_names, separate_by_recording
from armid.estimation.problem import EstimationProblem, build_problem
from armid.information.hysteresis_states import memory_findings
from armid.information.information import Information
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.pipeline import resolve_options
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording
from armid.measurement.robot_convention import to_robot_convention, understood
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.model.expression import symbols
from armid.notebook import Displayed, Summary
from armid.robot import Robot
from armid.study import plausibility
from armid.study.config import (
    PER_RECORDING,
    RecordingChoice,
    Study,
    build_estimator,
    build_model,
    load_choice,
    resolve_model,
)
from armid.study.default_terms import add_shown_rotor_inertia
from armid.study.diagnosis import diagnosed_error, findings_of_each, merged
from armid.study.estimation_defaults import as_chosen, with_origin_of_weight
from armid.study.extrapolation import highest_speeds, speed_finding
from armid.study.processed import ProcessedRecording, joined_observations, of_role, process_each
from armid.study.recording_labels import labels
from armid.study.recording_parts import cut_recording, refuse_shared
from armid.threads import one_blas_thread
from armid.validation.prediction import (
    PredictedRecording,
    Score,
    Validation,
    predict_recording,
    score,
    validate,
    with_doubted_unit,
)
from armid.values import Array, digest

Progress = Callable[[str, float], None]
"""Callback with the name of the stage and its finished share."""


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Result(Displayed):
    """Result of an identification.

    Attributes:
        study: The study with its automatic choices resolved.
        robot: The arm.
        model: Arm and torque terms.
        information: Information of the training recordings.
        estimate: The estimate.
        validation: Torque error on the validation recordings.
        training: Torque error on the training recordings.
        friction_selection: Friction selection, if there was one.
        given_format: Log format of the first training recording as given, before its columns were guessed.
        predictions: Torque of the estimate along each recording, in the order of the study; may be empty.
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
        """Torque error on held-out motion; values are in `estimate`."""
        return self.validation.summary()


@dataclass(frozen=True, eq=False, slots=True)
class Prepared:
    """Data, model and problem of a study, before the estimate.

    Attributes:
        study: The study with its automatic choices resolved.
        model: Arm and torque terms.
        base: Base parameters of the model.
        recordings: All recordings with their roles, processed.
        problem: Estimation problem of the training recordings.
        findings: Findings up to here.
        began: Begin of the work, by `time.perf_counter` [s].
        friction_selection: Friction selection, if there was one.
    """

    study: Study
    model: DynamicsModel
    base: BaseParameters
    recordings: tuple[ProcessedRecording, ...]
    problem: EstimationProblem
    findings: tuple[Finding, ...]
    began: float
    friction_selection: FrictionSelection | None = None


def read_choice(
    choice: RecordingChoice,
    folder: Path | str,
    robot: Robot,
    given: Mapping[str, Recording] | None = None,
) -> tuple[Recording, tuple[Finding, ...]]:
    """Reads one recording of a study and converts it to the robot's convention.

    Args:
        choice: File, log format and part.
        folder: Folder that its path is relative to.
        robot: The arm.
        given: Recordings that are in memory already, by path.

    Raises:
        RecordingError: It cannot be read or does not fit the robot.
    """
    raw = (given or {}).get(choice.path)
    if raw is None:
        raw = load_recording(Path(folder) / choice.path, choice.reading, robot)
    read = to_robot_convention(raw, choice.reading, robot)
    return cut_recording(read.recording, choice.part), read.findings


@one_blas_thread
def identify(
    study: Study,
    *,
    given: Mapping[str, Recording] | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> Result:
    """Identifies the model of a study and validates it on the study's validation recordings.

    Args:
        study: The study.
        given: Recordings that are in memory already, by their path in the study.
        threads: Threads of the kernel.
        progress: Called with each stage.

    Raises:
        ArmidError: Bad input; the message says what and where.
    """
    return conclude(prepare(study, given=given, threads=threads, progress=progress), progress=progress)


@one_blas_thread
def prepare(
    study: Study,
    *,
    given: Mapping[str, Recording] | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> Prepared:
    """Prepares everything up to the estimate, so that several methods can share it. Arguments as in `identify`.

    Raises:
        ArmidError: Bad input; the message says what and where.
    """
    began = time.perf_counter()
    tell = progress or no_progress
    tell("robot", 0.0)
    robot = load_choice(study.robot, study.folder)
    model = build_model(robot, study.model, motor_side=_is_motor_side(study))
    findings = list(robot.findings)
    recordings: list[tuple[RecordingChoice, Recording]] = []
    read_findings: list[tuple[Finding, ...]] = []
    for k, choice in enumerate(study.recordings):
        tell("recordings", k / len(study.recordings))
        recording, found = read_choice(choice, study.folder, robot, given)
        read_findings.append(found)
        recordings.append((choice, recording))
    refuse_shared(recordings)
    train = [(choice, recording) for choice, recording in recordings if choice.role == "train"]
    tell("processing", 0.0)
    processing = resolve_options(study.processing, [recording for _, recording in train])
    processed = process_each(recordings, processing, robot)
    training = of_role(processed, "train")
    observations = joined_observations(training)
    findings += [finding for each in training for finding in each.findings]
    selection = None
    if study.model.automatic:
        tell("friction", 0.0)
        selection = choose_friction(model, observations, threads=threads)
        model = selection.model
        bodies = robot.inertial_vector
        described = bodies is not None and bool((bodies[:, 0] > 0.0).all())
        study = replace(study, estimation=as_chosen(study.estimation, selection, described=described))
        findings.append(plausibility.chosen_finding(selection, study.estimation.method))
    model = with_load(model, observations, threads=threads)
    findings += memory_findings(model, observations)
    tell("doctor", 0.0)
    told = findings_of_each(model, recordings, read_findings, findings)
    model, told = add_shown_rotor_inertia(model, study.model, study.recordings, told)
    findings += merged(study.recordings, told)
    understood_as = tuple(replace(c, reading=understood(r, c.reading)) for c, r in recordings)
    study = replace(study, model=resolve_model(model), processing=processing, recordings=understood_as)
    base = find_base_parameters(model)
    problem = build_problem(
        model,
        observations,
        base=base,
        scale_deviation=_scale_deviation(train, robot),
        threads=threads,
        progress=lambda done, all: tell("information", done / all),
    )
    return Prepared(study, model, base, processed, problem, tuple(findings), began, selection)


@one_blas_thread
def conclude(prepared: Prepared, *, progress: Progress | None = None) -> Result:
    """Estimates by the study's method and validates on the study's validation recordings.

    Raises:
        EstimationError: The data do not determine the parameters.
    """
    tell = progress or no_progress
    study, model, recordings = prepared.study, prepared.model, prepared.recordings
    robot = model.robot
    information = prepared.problem.information
    tell("estimation", 0.0)
    try:
        estimate = _estimate(study, model, prepared.base, stated_problem(prepared), recordings)
    except EstimationError as error:
        raise diagnosed_error(error, prepared.findings) from error
    estimate = with_origin_of_weight(estimate, prepared.friction_selection)
    if prepared.problem.observations is not None:
        estimate = replace(estimate, speeds=highest_speeds(prepared.problem.observations))
    chosen = prepared.friction_selection is not None
    remarks = plausibility.plausibility_findings(
        model, information, stated_problem(prepared), estimate.fit, chosen=chosen
    )
    findings = [*prepared.findings, *estimate.findings, *remarks]
    tell("validation", 0.0)
    train = of_role(recordings, "train")
    predictions = {each: predict_recording(model, estimate, each.observations) for each in recordings}
    training, _ = score_recordings(model, estimate, train, predictions)
    scores, found = score_recordings(model, estimate, of_role(recordings, "validate"), predictions)
    validation = with_doubted_unit(validate(robot.joint_names, scores, estimate), prepared.findings)
    tell("validation", 1.0)
    seconds = time.perf_counter() - prepared.began
    estimate = replace(estimate, findings=(*findings, *found), seconds=seconds)
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


def stated_problem(prepared: Prepared) -> EstimationProblem:
    """Estimation problem of a study, with friction or offsets for each recording where the study asks for them.

    Raises:
        StudyError: Parameters for each recording with only one training recording.
    """
    problem, choice = prepared.problem, prepared.study.estimation
    asked = [key for key in PER_RECORDING if getattr(choice, key)]
    if not asked:
        return problem
    if len(np.unique(problem.information.recording)) < 2:
        raise StudyError(f"{asked[0]} needs at least two training recordings.")
    offsets = np.isin(problem.information.names, offset_names(prepared.model))
    own = changing_parameters(prepared.model)[prepared.base.kept] if choice.friction_per_recording else offsets
    return replace(problem, information=separate_by_recording(problem.information, own))


def no_progress(stage: str, share: float) -> None:
    """Callback that ignores progress."""
    del stage, share


def score_recordings(
    model: DynamicsModel,
    estimate: Estimate,
    recordings: Sequence[ProcessedRecording],
    predictions: Mapping[ProcessedRecording, PredictedRecording] | None = None,
) -> tuple[tuple[Score, ...], tuple[Finding, ...]]:
    """Computes the torque error on each recording, with findings; predictions are computed where not given."""
    scores: list[Score] = []
    findings: list[Finding] = []
    names = labels([each.choice for each in recordings])
    for each, label in zip(recordings, names, strict=True):
        path, asked = each.choice.path, highest_speeds(each.observations)
        beyond = speed_finding(model.robot, estimate.speeds, asked, label or Path(path).name)
        findings += each.findings if beyond is None else (*each.findings, beyond)
        prediction = (predictions or {}).get(each)
        sha256 = each.recording.sha256
        scores.append(score(model, estimate, each.observations, path=path, sha256=sha256, prediction=prediction))
    return tuple(scores), tuple(findings)


def _is_motor_side(study: Study) -> bool:
    """True if the effort of every recording is that of the motors."""
    return all(
        choice.reading.transmission is not None or choice.reading.drive_gain is not None
        for choice in study.recordings
    )


def _estimate(
    study: Study,
    model: DynamicsModel,
    base: BaseParameters,
    problem: EstimationProblem,
    recordings: Sequence[ProcessedRecording],
) -> Estimate:
    """Estimates, with covariance and digests of all inputs."""
    fit = estimate(problem, build_estimator(study.estimation))
    options = digest(repr((study.model, study.processing, study.estimation)))
    made_from = (
        InputDigest("robot", model.robot.sha256),
        *(InputDigest(each.choice.role, each.recording.sha256) for each in recordings),
        InputDigest("options", options),
    )
    return Estimate(
        model.robot.name,
        study.estimation.method,
        _uses(model),
        base,
        fit,
        fit.findings,
        made_from=made_from,
        made_by=problem.information.made_by,
    )


def _scale_deviation(train: Sequence[tuple[RecordingChoice, Recording]], robot: Robot) -> Array:
    """Relative standard deviation of each joint's torque scale: the largest of the training recordings."""
    given = [choice.reading.drive_gain_deviation for choice, _ in train]
    deviations = [np.broadcast_to(np.asarray(each, dtype=np.float64), robot.n) for each in given if each is not None]
    return np.max([np.zeros(robot.n), *deviations], axis=0)


def changing_parameters(model: DynamicsModel) -> NDArray[np.bool_]:
    """Flags of standard parameters that may differ between recordings: friction and offsets, no inertia."""
    changing = np.zeros(len(model.parameters), dtype=np.bool_)
    for column, (_, law) in zip(model.law_columns, model.laws, strict=True):
        changing[column] = "ddq" not in symbols(law.expression)
    return changing


def _uses(model: DynamicsModel) -> tuple[TermUse, ...]:
    """Terms of a model with their joints and shapes."""
    names = model.robot.joint_names
    uses: list[TermUse] = []
    for term in model.terms:
        touched = sorted({j for law in term.laws(model.robot) for j, _ in law.coordinate}) or range(model.n)
        options = dataclasses.asdict(term)  # pyright: ignore[reportArgumentType]
        shapes = {key: value for key, value in options.items() if key != "joints" and value is not None}
        uses.append(TermUse(term.name, tuple(names[j] for j in touched), shapes))
    return tuple(uses)
