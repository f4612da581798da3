"""Residuals of a run on unseen motion: motion that was not used to estimate the parameters.

If reference recordings without contact are given, the residuals are computed from them. Otherwise the recordings of
the run are used: each recording for validation, and each recording for training with an estimate from the other
recordings. A single training recording is divided into at most five parts; each part is predicted by an estimate from
the other parts.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError, EstimationError, Finding
from armid.estimation.catalogue import Estimator, EstimatorWithPrior
from armid.estimation.crossvalidation import FOLDS
from armid.estimation.estimate_record import torque_parameters
from armid.estimation.fit_result import Fit
from armid.estimation.friction_per_recording import changing_parameters, offset_names, separate_by_recording
from armid.estimation.problem import EstimationProblem, build_problem
from armid.measurement.observations import Observations
from armid.measurement.processing.uniform_runs import cut_at_gaps, resample_uniform
from armid.measurement.recording import Recording
from armid.runs.locate_recording import read_recording_of
from armid.runs.monitoring.observer import Observed, ObserverOptions, external_torque_along
from armid.runs.read_records import read_records, trained_and_validated
from armid.runs.run import Run
from armid.study.config import RecordingChoice, Study, build_estimator
from armid.study.recordings.processed import ProcessedRecording, joined_observations, of_role, process_each
from armid.study.recordings.reading import position_zero_deviation, scale_deviation

MARGIN = 0.5
"""Time on both sides of a left-out part that is not used for the estimate either [s], because filters correlate it
with the left-out part."""

LEAST_PART = 2.0
"""Shortest part of a recording that is left out [s]."""


@dataclass(frozen=True, eq=False, slots=True)
class UnseenResiduals:
    """Residuals of unseen motion.

    Attributes:
        parts: The residuals along each contiguous part of the recordings.
        source: Source of the motion: `reference`, `recordings` (left out in turn, or for validation) or `parts`.
        recordings: Number of recordings.
        findings: Findings about data that could not be used.
    """

    parts: tuple[Observed, ...]
    source: str
    recordings: int
    findings: tuple[Finding, ...] = ()


def external_torque_of(
    run: Run,
    options: ObserverOptions,
    recording: Recording,
    parameters: Array | None = None,
    *,
    velocity: bool | None = None,
) -> tuple[Observed, ...]:
    """Computes the external torque along each contiguous part of a recording.

    Args:
        run: The run.
        options: Options of the observer.
        recording: Recording in the convention of the robot.
        parameters: Standard parameters; if not given, those of the run.
        velocity: True if recorded velocities must be used, false if they must not be used; if not given, they are
            used if the recording has velocities.

    Raises:
        ArmidError: The rows of the recording are not consecutive, or it lacks torque, clock or required velocities.
    """
    if recording.consecutive is False:
        raise ArmidError(
            f"The rows of {recording.source} are not consecutive in time, so no observer can follow them.",
            remedy="give a recording whose rows are in the order of time.",
        )
    if velocity and recording.dq is None:
        raise ArmidError(
            f"{recording.source} has no velocities, but the recordings from which the thresholds come have some.",
            remedy="give reference recordings without velocities, or leave their columns out.",
        )
    theta = torque_parameters(run.estimate.base, run.estimate.fit) if parameters is None else parameters
    segments, _ = cut_at_gaps(recording, None)
    found: list[Observed] = []
    for segment in segments:
        if segment.samples < 4:
            continue
        even = resample_uniform(segment, None, 0.0, each=False)
        found.append(
            external_torque_along(
                run.model,
                theta,
                options,
                rate=even.rate,
                q=even.q,
                dq=None if velocity is False else even.dq,
                torque=even.effort,
                start=float(even.time[0]),
                bad=even.bad,
            )
        )
    return tuple(found)


def reference_residuals(run: Run, options: ObserverOptions, references: Sequence[Recording]) -> UnseenResiduals:
    """Residuals of a run on reference recordings without contact, on which the run was not trained."""
    velocity = all(each.dq is not None for each in references)
    parts = [part for each in references for part in external_torque_of(run, options, each, velocity=velocity)]
    return UnseenResiduals(tuple(parts), "reference", len(references))


def own_residuals(run: Run, options: ObserverOptions, data: Path | str | None = None) -> UnseenResiduals:
    """Residuals of the recordings of a run; each training recording is predicted by an estimate without it.

    Args:
        run: The run.
        options: Options of the observer.
        data: Folder of the recordings, if they were moved.

    Raises:
        ArmidError: A recording is missing or has changed, or the run was recalibrated.
    """
    study = read_records(run).study
    try:
        method = build_estimator(study.estimation)
    except ArmidError as error:
        raise ArmidError(
            f"The estimate of {run.folder} cannot be repeated without a part of its recordings: {error.problem}",
            remedy="give recordings of motion without contact with --reference.",
        ) from error
    pairs = trained_and_validated(run, study)
    read = [(choice, read_recording_of(run, choice, sha256, study.folder, data)) for choice, sha256 in pairs]
    velocity = all(each.dq is not None for _, each in read)
    observed = partial(external_torque_of, run, options, velocity=velocity)
    processed = process_each(read, study.processing, run.robot)
    training = of_role(processed, "train")
    parts = [part for each in of_role(processed, "validate") for part in observed(each.recording)]
    count = len(processed) - len(training)
    problem = _problem(run, training)
    fixed = method.with_prior_of(_separated(run, study, problem), run.estimate.fit) \
        if isinstance(method, EstimatorWithPrior) else method  # fmt: skip
    source, omitted = "recordings", list[str]()
    if len(training) > 1:
        for k, each in enumerate(training):
            theta = _parameters(run, _separated(run, study, _without(problem, k)), fixed)
            if theta is None:
                omitted.append(each.choice.path)
                continue
            parts += observed(each.recording, theta)
            count += 1
    elif not study.processing.average:  # the mean of all repetitions leaves none of them unseen
        found, failed = _left_out_parts(run, observed, study, next(iter(training)), problem, fixed)
        parts += found
        omitted += [f"{failed} of its parts"] * (failed > 0)
        source = "parts" if count == 0 else "recordings"
        count += 1
    if not parts:
        raise ArmidError(
            f"The recordings of {run.folder} give no unseen motion: they are too short to leave a part of them out, "
            "the mean of all repetitions was taken, or the other parts do not determine the parameters.",
            remedy="give recordings of motion without contact with --reference.",
        )
    files = len({sha256 for _, sha256 in pairs})  # parts of one file are one recording
    findings = _omitted_finding(run, omitted) if omitted else ()
    return UnseenResiduals(tuple(parts), source if files > 1 else "parts", min(count, files), findings)


def _omitted_finding(run: Run, omitted: Sequence[str]) -> tuple[Finding, ...]:
    """Finding that names data without which the parameters are not determined, so that they cannot be left out."""
    evidence = (
        f"The thresholds do not contain {', '.join(omitted)}: the other data of {run.folder} do not determine all "
        "parameters."
    )
    remedy = "give recordings of motion without contact with --reference."
    return (Finding("unseen-omitted", "warning", "", evidence, remedy),)


def _problem(run: Run, training: Sequence[ProcessedRecording]) -> EstimationProblem:
    choices: list[RecordingChoice] = [each.choice for each in training]
    return build_problem(
        run.model,
        joined_observations(training),
        base=run.estimate.base,
        scale_deviation=scale_deviation(choices, run.robot),
        position_zero_deviation=position_zero_deviation(choices, run.robot),
    )


def _separated(run: Run, study: Study, problem: EstimationProblem) -> EstimationProblem:
    """Problem with separate friction or offsets for each recording, if the study asks for them.

    If there is only one recording, the problem is returned unchanged.
    """
    choice = study.estimation
    several = len(np.unique(problem.information.recording)) > 1
    if not several or not (choice.friction_per_recording or choice.offset_per_recording):
        return problem
    offsets = np.isin(problem.information.names, offset_names(run.model))
    own = changing_parameters(run.model)[run.estimate.base.kept] if choice.friction_per_recording else offsets
    return replace(problem, information=separate_by_recording(problem.information, own))


def _without(problem: EstimationProblem, recording: int) -> EstimationProblem:
    """Estimation problem without the recording of the given number."""
    model, base, observations = problem.require_samples("monitoring")
    rest = tuple(each for each in observations.runs if each.recording != recording)
    return _again(problem, model, base, replace(observations, runs=rest))


def _again(problem: EstimationProblem, model: Any, base: Any, observations: Observations) -> EstimationProblem:
    return build_problem(
        model,
        observations,
        base=base,
        scale_deviation=problem.information.scale_deviation,
        position_zero_deviation=problem.position_zero_deviation,
    )


def _parameters(run: Run, problem: EstimationProblem, method: Estimator) -> Array | None:
    """Standard parameters (p,) from the data of a problem; `None` if the data do not determine the parameters."""
    try:
        fit: Fit = method.solve(problem)
    except (EstimationError, np.linalg.LinAlgError):
        return None
    return torque_parameters(run.estimate.base, fit)


def _left_out_parts(
    run: Run,
    observed: Callable[..., tuple[Observed, ...]],
    study: Study,
    training: ProcessedRecording,
    problem: EstimationProblem,
    method: Estimator,
) -> tuple[list[Observed], int]:
    """Residuals of the parts of a single training recording; each part is predicted by an estimate from the others.

    The second result is the number of parts that could not be left out, because the other parts do not determine the
    parameters.
    """
    model, base, observations = problem.require_samples("monitoring")
    begin = min(float(each.motion.time[0]) for each in observations.runs)
    end = max(float(each.motion.time[-1]) for each in observations.runs)
    count = min(FOLDS, int((end - begin) / LEAST_PART))
    borders = np.linspace(begin, end, count + 1) if count > 1 else np.zeros(0)
    parts, failed = list[Observed](), 0
    for k in range(len(borders) - 1):
        low, high = borders[k], borders[k + 1]
        kept = [_outside(each, low - MARGIN, high + MARGIN) for each in observations.runs]
        rest = replace(observations, runs=tuple(each for each in kept if each.mask.any()))
        if not rest.runs:
            continue
        theta = _parameters(run, _separated(run, study, _again(problem, model, base, rest)), method)
        if theta is None:
            failed += 1
            continue
        first, last = k == 0, k == len(borders) - 2
        for part in observed(training.recording, theta):
            own = ((part.time >= low) | first) & ((part.time < high) | last)
            if own.any():
                parts.append(_only(part, own))
    return parts, failed


def _outside(observed: Any, low: float, high: float) -> Any:
    """Contiguous run in which the rows between the times `low` and `high` [s] are masked."""
    time = observed.motion.time[observed.rows]
    return replace(observed, mask=observed.mask & ~((time >= low) & (time < high))[:, None])


def _only(observed: Observed, rows: NDArray[np.bool_]) -> Observed:
    """External torque at the samples that a mask (N,) selects."""
    names = ("time", "q", "dq", "external", "change", "usable")
    return replace(observed, **{name: getattr(observed, name)[rows] for name in names})
