"""Preparation of an estimate: makes data, model and estimation problem from a study."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from armid.errors import Finding, StudyError
from armid.estimation.friction.load_torque import with_load
from armid.estimation.friction.selection import FrictionSelection, choose_friction
from armid.estimation.friction_per_recording import changing_parameters, offset_names, separate_by_recording
from armid.estimation.problem import EstimationProblem, build_problem
from armid.information.hysteresis_states import memory_findings, without_creep
from armid.measurement.convention_conversion import understood
from armid.measurement.processing.pipeline import resolve_options
from armid.measurement.recording import Recording
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.study.config import (
    PER_RECORDING,
    Study,
    build_model,
    load_choice,
    resolve_model,
)
from armid.study.default_rotor_inertia import add_rotor_inertia
from armid.study.diagnosis import findings_of_each, merged
from armid.study.progress import Progress, no_progress
from armid.study.recordings.agreement import disagreement_findings
from armid.study.recordings.processed import (
    ProcessedRecording,
    joined_observations,
    judged_without_memory,
    of_role,
    process_each,
)
from armid.study.recordings.reading import position_zero_deviation, read_all, scale_deviation
from armid.study.selection_prior_options import as_chosen, chosen_finding
from armid.threads import one_blas_thread


@dataclass(frozen=True, eq=False, slots=True)
class Prepared:
    """Data, model and estimation problem of a study, before the estimate.

    Attributes:
        study: The study, in which automatic choices are replaced by their results.
        model: Arm and torque terms.
        base: Base parameters of the model.
        recordings: All recordings with their roles, processed.
        problem: Estimation problem of the training recordings.
        findings: Findings on description, recordings and processing, before the estimate.
        began: Time at which the identification began, from `time.perf_counter` [s].
        friction_selection: Result of the selection of friction; `None` if friction was not selected.
    """

    study: Study
    model: DynamicsModel
    base: BaseParameters
    recordings: tuple[ProcessedRecording, ...]
    problem: EstimationProblem
    findings: tuple[Finding, ...]
    began: float
    friction_selection: FrictionSelection | None = None


@one_blas_thread
def prepare(
    study: Study,
    *,
    given: Mapping[str, Recording] | None = None,
    threads: int = 1,
    progress: Progress | None = None,
) -> Prepared:
    """Prepares data and model of a study for one or more estimates; the arguments are those of `identify`.

    Raises:
        ArmidError: An input is wrong; the message names the input and the fault.
    """
    began = time.perf_counter()
    tell = progress or no_progress
    tell("robot", 0.0)
    robot = load_choice(study.robot, study.folder)
    model = build_model(robot, study.model, motor_side=study.is_motor_side)
    findings = list(robot.findings)
    recordings, read_findings = read_all(study, robot, given, tell)
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
        model, observations = selection.model, without_creep(observations)
        bodies = robot.inertial_vector
        described = bodies is not None and bool((bodies[:, 0] > 0.0).all())
        study = replace(study, estimation=as_chosen(study.estimation, selection, described=described))
        findings.append(chosen_finding(selection, study.estimation.method))
    model = with_load(model, observations, threads=threads)
    findings += memory_findings(model, observations)
    tell("doctor", 0.0)
    told = findings_of_each(model, recordings, read_findings, findings, processing=processing)
    model, told = add_rotor_inertia(model, study.model, study.recordings, told)
    findings += merged(study.recordings, told)
    understood_as = tuple(replace(c, reading=understood(r, c.reading)) for c, r in recordings)
    study = replace(study, model=resolve_model(model), processing=processing, recordings=understood_as)
    processed = judged_without_memory(processed, model)
    base = find_base_parameters(model)
    problem = build_problem(
        model,
        observations,
        base=base,
        scale_deviation=scale_deviation([choice for choice, _ in train], robot),
        position_zero_deviation=position_zero_deviation([choice for choice, _ in train], robot),
        threads=threads,
        progress=lambda done, all: tell("information", done / all),
    )
    findings += disagreement_findings(model, base, problem.information, [each.choice for each in training])
    return Prepared(study, model, base, processed, problem, tuple(findings), began, selection)


def stated_problem(prepared: Prepared) -> EstimationProblem:
    """Estimation problem of a study; each recording has its own friction or offsets if the study asks for this.

    Raises:
        StudyError: The study asks for parameters of each recording, but has only one training recording.
    """
    asked = [key for key in PER_RECORDING if getattr(prepared.study.estimation, key)]
    if asked and len(np.unique(prepared.problem.information.recording)) < 2:
        raise StudyError(
            f"The key `{asked[0]}` needs at least two training recordings, but the study has only one.",
            remedy="add another training recording, or leave this key of [estimation] out.",
        )
    return separated_problem(prepared, prepared.problem)


def separated_problem(prepared: Prepared, problem: EstimationProblem) -> EstimationProblem:
    """Gives each recording of an estimation problem its own friction or offsets, if the study asks for it."""
    choice = prepared.study.estimation
    if not any(getattr(choice, key) for key in PER_RECORDING):
        return problem
    offsets = np.isin(problem.information.names, offset_names(prepared.model))
    own = changing_parameters(prepared.model)[prepared.base.kept] if choice.friction_per_recording else offsets
    return replace(problem, information=separate_by_recording(problem.information, own))
