"""Tracking of the parameters of a run through further recordings, with forgetting."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError, Finding, StudyError
from armid.estimation.estimate_record import averaged
from armid.estimation.friction_per_recording import changing_parameters
from armid.estimation.recursive.recursive_estimate import JUMP, ForgettingOptions, RecursiveState, fit, resume, update
from armid.estimation.update.payload import LOAD_NAMES
from armid.estimation.update.stacked_problem import with_load_columns
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, select
from armid.measurement.observations import Observations, ObservedRun
from armid.measurement.processing.pipeline import process_recordings
from armid.model.parameter_name import ParameterName
from armid.model.terms.rigid_body import rigid_body_units
from armid.runs.new_recordings import (
    ReadRecording,
    check_new_recordings,
    earlier_information,
    load_columns,
    new_recording_findings,
    read_new_recordings,
)
from armid.runs.recalibration import Changed
from armid.runs.run import Run
from armid.study.diagnosis import diagnosed_error
from armid.study.progress import Progress, no_progress
from armid.study.storage.records import judgement_record
from armid.threads import one_blas_thread

THRESHOLD = 3.0
"""Normalised innovation from which a change is reported. With ten independent rows in a block, noise alone reaches it
once in 1e14 blocks. If the arm has not changed, other motions hardly give more than two."""

LOOSE = np.array([100.0, 50.0, 50.0, 50.0, 25.0, 25.0, 25.0, 25.0, 25.0, 25.0])
"""Prior standard deviations of an unknown payload [kg, kg·m, kg·m²]: ten times those of a usual payload."""


@dataclass(frozen=True, slots=True)
class Event:
    """Sudden change of the parameters, detected by the normalised innovation.

    Attributes:
        time: End of the block in which the change was detected [s].
        joint: The joint with the largest normalised innovation.
        normalized_innovation: Normalised innovation of that joint in the block.
    """

    time: float
    joint: str
    normalized_innovation: float


@dataclass(frozen=True, eq=False, slots=True)
class TrackedRun:
    """Parameters over time, with one row for each of K blocks.

    Attributes:
        names: Names of the m parameters: the base parameters and, with `tool`, the parameters of the payload.
        units: Units of the parameters.
        time: End of each block, shape (K,) [s]; the clock continues from one recording to the next.
        values: Estimated values, shape (K, m).
        deviation: Standard deviations, shape (K, m).
        error: RMS torque error in each block with the estimate from earlier blocks, shape (K, n) [N·m or N]; zero if
            the joint rests.
        before: RMS torque error in each block with the values of the run, shape (K, n) [N·m or N].
        normalized_innovation: Normalised innovation, shape (K, n).
        events: Blocks in which the normalised innovation was at least `THRESHOLD`.
        findings: Findings about the run, and of the reader, the doctor and the processing.
    """

    names: tuple[ParameterName, ...]
    units: tuple[str, ...]
    time: Array
    values: Array
    deviation: Array
    error: Array
    before: Array
    normalized_innovation: Array
    events: tuple[Event, ...]
    findings: tuple[Finding, ...]


@one_blas_thread
def track(
    run: Run,
    paths: Sequence[str],
    reading: Mapping[str, Any],
    *,
    memory: float = 30.0,
    block: float = 1.0,
    changed: Changed = "friction",
    progress: Progress | None = None,
) -> TrackedRun:
    """Tracks the parameters that may change, through recordings that were made after a run.

    Args:
        run: The run; its values and intervals are the initial estimate.
        paths: Recordings, in the order of time.
        reading: Fields of the log format that differ from that of the run's first recording.
        memory: Time constant of forgetting [s]; if infinite, nothing is forgotten.
        block: Time from one estimate to the next [s].
        changed: Parameters that may change: friction and offsets; friction, offsets and a payload at the tip; or all.
        progress: Callback that is called with the name of each step and its progress from 0 to 1.

    Raises:
        ArmidError: The recordings do not fit the run, or a time is not positive.
    """
    _check_times(memory, block)
    tell = progress or no_progress
    tell("recordings", 0.0)
    recordings, read = read_new_recordings(run, paths, reading)
    observations, found = _observed(run, recordings, block)
    tell("doctor", 0.0)
    findings = check_new_recordings(run, recordings, read, found)
    base = run.estimate.base
    tell("information", 0.0)
    new = accumulate_information(
        run.model, base, observations, progress=lambda done, all: tell("information", done / all)
    )
    ends, lengths = _times(observations)
    earlier = averaged(base.names, run.estimate.fit)
    changing = np.ones(base.count, dtype=np.bool_) if changed == "all" else changing_parameters(run.model)[base.kept]
    further, jump = None, JUMP * np.sqrt(np.diag(earlier.covariance))
    if changed == "tool":
        new = with_load_columns(new, np.ones(new.blocks, dtype=np.bool_), load_columns(run)[0])
        new = replace(new, names=(*base.names, *LOAD_NAMES))
        changing, further = np.append(changing, np.ones(10, dtype=np.bool_)), LOOSE
        jump = np.append(jump, LOOSE)
    elif not changing.any():
        raise StudyError(
            f"By default only friction is tracked, but the model of {run.folder} has no friction.",
            remedy="use --tool to track a payload, or --all to track all parameters.",
        )
    factors = earlier_information(run)
    forgetting = ForgettingOptions(memory, changing, THRESHOLD, jump)
    units = (*base.units, *(rigid_body_units() if changed == "tool" else ()))
    told = (*new_recording_findings(run), *findings, *found)
    try:
        state = resume(new, earlier, forgetting, further=further, factors=factors)
        return _update_all(run, state, new, ends, lengths, units, told, tell)
    except EstimationError as error:
        raise diagnosed_error(error, told) from error


def _check_times(memory: float, block: float) -> None:
    """Checks that the time constant of forgetting and the time between estimates are positive [s].

    Raises:
        StudyError: A time is not positive, or the time between estimates is infinite.
    """
    if not (memory > 0.0 and 0.0 < block < np.inf):
        problem = f"The times --memory and --block must be above 0 s; found {memory:g} s and {block:g} s."
        raise StudyError(problem, remedy="give for instance --memory 30 --block 1.")


def _observed(
    run: Run, recordings: Sequence[ReadRecording], block: float
) -> tuple[Observations, tuple[Finding, ...]]:
    """Observations of recordings in blocks of `block` seconds, without rows of joints at rest, and the findings."""
    # Periods averaged or taken together would hide what changes from one to the next.
    edges = "drop" if run.processing.edges == "periodic" else run.processing.edges
    # A joint at rest has any friction torque up to its bound; an estimate that forgets would be made of such rows.
    standstill = "keep" if run.processing.standstill == "keep" else "moving"
    processing = replace(run.processing, edges=edges, average=False, standstill=standstill)
    limits = [joint.effort_limit for joint in run.robot.joints]
    observed, found = process_recordings([each for _, each in recordings], processing, effort_limits=limits)
    if not any(one.mask.any() for one in observed.runs):
        raise StudyError(
            "The recordings have no row in which a joint moves, and joints at rest do not show their friction.",
            remedy="give recordings with motion; masked and trimmed rows do not count either.",
        )
    return Observations(tuple(_cut(one, block) for one in observed.runs), observed.band), found


def _update_all(
    run: Run,
    state: RecursiveState,
    new: Information,
    ends: Array,
    lengths: Array,
    units: tuple[str, ...],
    findings: tuple[Finding, ...],
    tell: Progress,
) -> TrackedRun:
    """Updates the recursive state with one block after the other, and collects the parameters after each block.

    Args:
        run: The run.
        state: State before the first block.
        new: Factors of the blocks.
        ends: End of each block, shape (K,) [s].
        lengths: Time from the end of the previous block to the end of each block, shape (K,) [s].
        units: Units of the parameters.
        findings: Findings for the result.
        tell: Callback with the name of the step and its progress from 0 to 1.
    """
    start = state.values
    shape = (new.blocks, new.n)
    error, before, innovation = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    values, deviation = np.zeros((2, new.blocks, new.count))
    events: list[Event] = []
    for k in range(new.blocks):
        tell("tracking", k / new.blocks)
        part = select(new, np.array([k]))
        error[k], before[k] = _errors(part, state.values), _errors(part, start)
        state = update(state, part, float(lengths[k]))
        now = fit(state)
        values[k], deviation[k] = now.values, np.sqrt(np.diag(now.covariance))
        innovation[k] = state.innovations.normalized_innovation
        j = int(np.argmax(innovation[k]))
        if innovation[k, j] >= THRESHOLD:
            events.append(Event(float(ends[k]), run.robot.joint_names[j], float(innovation[k, j])))
    tell("tracking", 1.0)
    return TrackedRun(new.names, units, ends, values, deviation, error, before, innovation, tuple(events), findings)


def _cut(run: ObservedRun, seconds: float) -> ObservedRun:
    """Divides a contiguous run of observations into blocks of `seconds`."""
    time = run.motion.time[run.rows]
    block = np.floor((time - time[0]) / seconds + 1e-9).astype(np.int64)
    return replace(run, block=np.unique(block, return_inverse=True)[1])


def _times(observations: Observations) -> tuple[Array, Array]:
    """End of each block, and time since the end of the previous block, shape (K,) each [s].

    The clock continues from one recording to the next without a gap.
    """
    ends: list[float] = []
    lengths: list[float] = []
    recording, shift = -1, 0.0
    for run in observations.runs:
        time, step = run.motion.time[run.rows], run.step / run.rate
        if run.recording != recording:
            recording, last = run.recording, ends[-1] if ends else 0.0
            shift = last - float(time[0]) + step if ends else 0.0
        for k in np.unique(run.block):
            at = float(time[run.block == k][-1]) + shift
            lengths.append(at - ends[-1] if ends else at - float(time[0]) - shift + step)
            ends.append(at)
    return np.array(ends), np.array(lengths)


def _errors(part: Information, values: Array) -> Array:
    """RMS torque error of each joint in one block for given parameters (m,), shape (n,) [N·m or N]."""
    squares = np.array(
        [np.sum((joint.R[0, :, -1] - joint.R[0, :, :-1] @ values[joint.parameters]) ** 2) for joint in part.joints]
    )
    return np.sqrt(squares / np.maximum(part.rows[0], 1))


def track_record(found: TrackedRun) -> dict[str, Any]:
    """Tracked parameters as a JSON object."""
    return {
        "time": found.time,
        "parameters": [
            {"name": name, "unit": unit, "value": found.values[:, k], "deviation": found.deviation[:, k]}
            for k, (name, unit) in enumerate(zip(found.names, found.units, strict=True))
        ],
        "error": found.error,
        "error_of_the_run": found.before,
        "surprise": found.normalized_innovation,
        "events": [{"time": e.time, "joint": e.joint, "surprise": e.normalized_innovation} for e in found.events],
        **judgement_record(found.findings),
    }


def track_table(found: TrackedRun) -> str:
    """Tracked parameters as CSV: time, parameters, standard deviations, and normalised innovation of each joint."""
    names = ["t"]
    for name in found.names:
        names += [name, f"{name}_deviation"]
    names += [f"surprise_{j + 1}" for j in range(found.normalized_innovation.shape[1])]
    both = np.stack([found.values, found.deviation], axis=2).reshape(len(found.time), -1)
    text = io.StringIO()
    np.savetxt(
        text,
        np.column_stack([found.time, both, found.normalized_innovation]),
        delimiter=",",
        header=",".join(names),
        comments="",
        fmt=["%.15g", *["%.10g"] * (len(names) - 1)],  # a clock in seconds since 1970 needs the digits
    )
    return text.getvalue()
