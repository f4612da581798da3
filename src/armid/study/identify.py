"""The main job: from a study to an identified and validated model."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armid.errors import Finding, StudyError
from armid.estimation.estimate import Estimate, TermUse
from armid.estimation.per_recording import separate_by_recording
from armid.estimation.problem import Problem, standard_of
from armid.estimation.uncertainty import FEWEST_BLOCKS, cover
from armid.information.information import Information
from armid.information.observations import Observations
from armid.information.stream import inform
from armid.measurement.interpret import interpret
from armid.measurement.process import observe, resolve
from armid.measurement.processing import Processing
from armid.measurement.readers import load_recording
from armid.measurement.reading import Reading
from armid.measurement.recording import Recording
from armid.model.base import BaseParameters, find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.model.expression import symbols
from armid.robot import Robot
from armid.study.cut import cut, refuse_shared
from armid.study.plausibility import excitation_finding, gravity_finding, torque_finding
from armid.study.study import RecordingChoice, Study, build_estimator, build_model, load_choice, resolve_model
from armid.validation.predict import Score, Validation, score, validate
from armid.values import Array, digest

__all__ = ["Progress", "Result", "identify", "read_recording", "score_recordings"]

Progress = Callable[[str, float], None]
"""Told the name of the stage and the share of it that is done."""


@dataclass(frozen=True, eq=False, slots=True)
class Result:
    """What an identification gives.

    Attributes:
        study: The study, its automatic choices made.
        robot: The arm.
        model: Arm and torque terms.
        information: What the training recordings say.
        estimate: The parameters.
        validation: Torque error on unseen motion.
        training: Torque error on the training recordings.
    """

    study: Study
    robot: Robot
    model: DynamicsModel
    information: Information
    estimate: Estimate
    validation: Validation
    training: tuple[Score, ...]


def read_recording(
    choice: RecordingChoice,
    folder: Path | str,
    robot: Robot,
    given: Mapping[str, Recording] | None = None,
) -> tuple[Recording, tuple[Finding, ...]]:
    """One recording of a study in the robot's joints, SI units, on the joint side.

    Args:
        choice: File, reading and part.
        folder: What its path is relative to.
        robot: The arm.
        given: Recordings at hand, by path.

    Raises:
        RecordingError: It cannot be read or does not fit the robot.
    """
    raw = (given or {}).get(choice.path)
    if raw is None:
        raw = load_recording(Path(folder) / choice.path, choice.reading)
    read = interpret(raw, choice.reading, robot)
    return cut(read.recording, choice.part), read.findings


def identify(
    study: Study,
    *,
    given: Mapping[str, Recording] | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> Result:
    """Identify the model of a study and check it on the recordings that it keeps for validation.

    Args:
        study: The study.
        given: Recordings that are at hand and need not be read, by their path in the study.
        threads: Threads of the kernel.
        progress: Told of stages.

    Raises:
        ArmidError: Bad input; the message says what and where.
    """
    began = time.perf_counter()
    tell = progress or _silent
    tell("robot", 0.0)
    robot = load_choice(study.robot, study.folder)
    model = build_model(robot, study.model, motor_side=_is_motor_side(study))
    base = find_base_parameters(model)
    findings = list(robot.findings)
    recordings: list[tuple[RecordingChoice, Recording]] = []
    for k, choice in enumerate(study.recordings):
        tell("recordings", k / len(study.recordings))
        recording, found = read_recording(choice, study.folder, robot, given)
        findings += found
        recordings.append((choice, recording))
    refuse_shared(recordings)
    train = [(choice, recording) for choice, recording in recordings if choice.role == "train"]
    tell("processing", 0.0)
    processing = resolve(study.processing, [recording for _, recording in train])
    study = replace(study, model=resolve_model(model), processing=processing)
    observations, found = _observe(train, processing, robot)
    findings += found
    information = inform(
        model, base, observations, threads=threads, progress=lambda done, all: tell("information", done / all)
    )
    information = replace(information, scale_deviation=_scale_deviation(train, robot))
    tell("estimation", 0.0)
    estimate = _estimate(study, model, base, information, observations, recordings)
    findings += _doubts(model, observations, information, estimate)
    tell("validation", 0.0)
    training, _ = score_recordings(model, estimate, train, processing)
    held_out = [(choice, recording) for choice, recording in recordings if choice.role == "validate"]
    scores, found = score_recordings(model, estimate, held_out, processing)
    validation = validate(robot.joint_names, scores, estimate)
    tell("validation", 1.0)
    seconds = time.perf_counter() - began
    estimate = replace(estimate, findings=(*findings, *found), seconds=seconds)
    return Result(study, robot, model, information, estimate, validation, training)


def _silent(stage: str, share: float) -> None:
    """Progress nobody asked for."""
    del stage, share


def score_recordings(
    model: DynamicsModel,
    estimate: Estimate,
    recordings: Sequence[tuple[RecordingChoice, Recording]],
    processing: Processing,
) -> tuple[tuple[Score, ...], tuple[Finding, ...]]:
    """Torque error on recordings, each processed by itself, and what was noticed on the way."""
    scores: list[Score] = []
    findings: list[Finding] = []
    for choice, recording in recordings:
        observations, found = _observe([(choice, recording)], processing, model.robot)
        findings += found
        scores.append(score(model, estimate, observations, path=choice.path, sha256=recording.sha256))
    return tuple(scores), tuple(findings)


def _observe(
    recordings: Sequence[tuple[RecordingChoice, Recording]], processing: Processing, robot: Robot
) -> tuple[Observations, tuple[Finding, ...]]:
    """Observations of several recordings."""
    readings: list[Reading] = [choice.reading for choice, _ in recordings]
    limits = np.array([joint.effort_limit for joint in robot.joints])
    return observe(
        [recording for _, recording in recordings],
        processing,
        periods=[reading.period for reading in readings],
        starts=[reading.start for reading in readings],
        effort_limits=limits,
    )


def _is_motor_side(study: Study) -> bool:
    """Whether every recording's effort is that of the motors."""
    return all(
        choice.reading.transmission is not None or choice.reading.drive_gain is not None
        for choice in study.recordings
    )


def _estimate(
    study: Study,
    model: DynamicsModel,
    base: BaseParameters,
    information: Information,
    observations: Observations,
    recordings: Sequence[tuple[RecordingChoice, Recording]],
) -> Estimate:
    """Estimate with what it was made from."""
    if study.estimation.friction_per_recording:
        if len(np.unique(information.recording)) < 2:
            raise StudyError("friction_per_recording needs at least two training recordings.")
        information = separate_by_recording(information, _changing(model)[base.kept])
    problem = Problem(information, standard_of(model, base), model, base, observations)
    fit = cover(build_estimator(study.estimation).estimate(problem), information)
    options = digest(repr((study.model, study.processing, study.estimation)))
    made_from = (
        f"robot {model.robot.sha256}",
        *(f"{choice.role} {recording.sha256}" for choice, recording in recordings),
        f"options {options}",
    )
    return Estimate(
        model.robot.name,
        study.estimation.method,
        _uses(model),
        base,
        fit,
        made_from=made_from,
        made_by=information.made_by,
    )


def _scale_deviation(train: Sequence[tuple[RecordingChoice, Recording]], robot: Robot) -> Array:
    """Relative standard deviation of each joint's torque scale: the largest of the training recordings."""
    given = [choice.reading.drive_gain_deviation for choice, _ in train]
    said = [np.broadcast_to(np.asarray(each, dtype=np.float64), robot.n) for each in given if each is not None]
    return np.max([np.zeros(robot.n), *said], axis=0)


def _doubts(
    model: DynamicsModel, observations: Observations, information: Information, estimate: Estimate
) -> list[Finding]:
    """What speaks against taking the estimate at its word."""
    found = [
        gravity_finding(model.robot),
        torque_finding(model, observations),
        excitation_finding(information),
    ]
    if estimate.fit.covariance_kind == "white":
        found.append(
            Finding(
                "few-blocks",
                "warning",
                "",
                f"Fewer than {FEWEST_BLOCKS} blocks of rows: intervals take residuals as white and are too narrow.",
                "record longer.",
            )
        )
    return [finding for finding in found if finding is not None]


def _changing(model: DynamicsModel) -> NDArray[np.bool_]:
    """Which standard parameters may differ from one recording to the next: friction and offsets, no inertia."""
    changing = np.zeros(len(model.parameters), dtype=np.bool_)
    for column, (_, law) in zip(model.law_columns, model.laws, strict=True):
        changing[column] = "ddq" not in symbols(law.expression)
    return changing


def _uses(model: DynamicsModel) -> tuple[TermUse, ...]:
    """Which terms were used, on which joints, with which shapes."""
    names = model.robot.joint_names
    uses: list[TermUse] = []
    for term in model.terms:
        laws = [law for _, law in [(term.name, law) for law in term.laws(model.robot)]]
        touched = sorted({j for law in laws for j, _ in law.coordinate}) or range(model.n)
        width = getattr(term, "width", None)
        uses.append(TermUse(term.name, tuple(names[j] for j in touched), {} if width is None else {"width": width}))
    return tuple(uses)
