"""Recordings of a study with their observations, so that each recording is processed only once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from armid.errors import Finding, RecordingError
from armid.information.hysteresis_states import with_sliding_states
from armid.measurement.observations import Observations
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import differenced_noise, process_recording, resolve_options
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.robot import Robot
from armid.study.config import RecordingChoice


@dataclass(frozen=True, eq=False, slots=True)
class ProcessedRecording:
    """Recording of a study, with its observations.

    Attributes:
        choice: Path, role, log format and part.
        recording: The recording in the robot's convention.
        observations: Observations of the recording: contiguous runs of motion and torque, and the band.
        findings: Findings of the processing.
    """

    choice: RecordingChoice
    recording: Recording
    observations: Observations
    findings: tuple[Finding, ...]


def process_each(
    recordings: Sequence[tuple[RecordingChoice, Recording]],
    processing: ProcessingOptions,
    robot: Robot,
    *,
    edges_required: bool = True,
) -> tuple[ProcessedRecording, ...]:
    """Processes recordings one by one; the recordings are numbered, training recordings first.

    Periodic edges need a motion that closes, that is, ends in the state in which it begins. A validation recording
    without a stated period may have any motion: if its motion does not close, the rows at its ends are dropped, and a
    finding says so.

    Args:
        recordings: Recordings with their roles and log formats.
        processing: Processing options.
        robot: The arm.
        edges_required: True if training recordings must be processed with the option `edges` of `processing`. If
            false (new recordings for a finished run), the rows at the ends of all of them are dropped if the motion
            of one does not close.

    Raises:
        RecordingError: A recording cannot be processed with these options.
    """
    if not recordings:
        return ()
    processing = resolve_options(processing, [recording for _, recording in recordings])
    training = sum(choice.role == "train" for choice, _ in recordings)
    number = {"train": count(), "validate": count(training)}
    numbered = [(choice, recording, next(number[choice.role])) for choice, recording in recordings]
    processed: dict[int, ProcessedRecording] = {}
    for choice, recording, index in numbered:
        open_ends = choice.reading.stated_period is None and not (edges_required and choice.role == "train")
        try:
            processed[index] = _processed(choice, recording, processing, robot, index)
        except RecordingError as error:
            if processing.edges != "periodic" or not open_ends:
                raise
            processed[index] = _with_dropped_edges(choice, recording, processing, robot, index, error.problem)
    train = [index for choice, _, index in numbered if choice.role == "train"]
    if len({processed[index].observations.band for index in train}) > 1:  # one estimate has one band
        for choice, recording, index in numbered:
            if index in train and processed[index].observations.band.edges == "periodic":
                why = "The motion of another recording does not close, and all recordings need the same edges."
                processed[index] = _with_dropped_edges(choice, recording, processing, robot, index, why)
    return tuple(processed[index] for _, _, index in numbered)


def _processed(
    choice: RecordingChoice, recording: Recording, processing: ProcessingOptions, robot: Robot, index: int
) -> ProcessedRecording:
    runs, findings = process_recording(
        recording,
        processing,
        period=choice.reading.repeats,
        start=choice.reading.start,
        effort_limits=np.array([joint.effort_limit for joint in robot.joints]),
        index=index,
    )
    observations = Observations(runs, processing.band, differenced_noise(recording, processing))
    return ProcessedRecording(choice, recording, observations, findings)


def _with_dropped_edges(
    choice: RecordingChoice, recording: Recording, processing: ProcessingOptions, robot: Robot, index: int, why: str
) -> ProcessedRecording:
    """Processes a recording without periodic edges; Fourier series cannot give the derivatives then.

    Args:
        choice: Options of the recording in the study.
        recording: The recording.
        processing: Processing options, with periodic edges.
        robot: The arm.
        index: Number of the recording.
        why: Reason why the edges cannot be periodic, a sentence for the finding.
    """
    derivatives = "central" if processing.derivatives == "periodic" else processing.derivatives
    dropped = replace(processing, edges="drop", average=False, derivatives=derivatives)
    processed = _processed(choice, recording, dropped, robot, index)
    finding = Finding(
        "edges-dropped",
        "info",
        "",
        f"{choice.path} cannot have periodic edges, so the rows that its ends influence are dropped. {why}",
    )
    return replace(processed, findings=(*processed.findings, finding))


def judged_without_memory(
    processed: Iterable[ProcessedRecording], model: DynamicsModel
) -> tuple[ProcessedRecording, ...]:
    """Makes a model with hysteresis usable on validation recordings whose rows are not consecutive.

    In such rows the state of the hysteresis is unknown, so it is replaced by the state after a long motion in the
    same direction (Coulomb friction), and a finding says so. Training recordings do not change.

    Args:
        processed: Recordings.
        model: Arm and torque terms.
    """
    return tuple(each if each.choice.role == "train" else _without_memory(each, model) for each in processed)


def _without_memory(processed: ProcessedRecording, model: DynamicsModel) -> ProcessedRecording:
    runs = processed.observations.runs
    separate = [run for run in runs if not run.consecutive]
    if not model.nodes or not separate:
        return processed
    finding = Finding(
        "judged-without-memory",
        "warning",
        "",
        f"The {sum(len(run.rows) for run in separate)} rows of {processed.choice.path} are not consecutive, so the "
        f"state of the torque term {model.nodes[0].term!r} is unknown. The predicted torque is that after a long "
        "motion of each joint in the same direction. Near reversals this is wrong, so the torque error on this "
        "recording is larger than the error of the model.",
        "validate on a recording with consecutive rows.",
    )
    runs = tuple(run if run.consecutive else with_sliding_states(model, run) for run in runs)
    observations = replace(processed.observations, runs=runs)
    return replace(processed, observations=observations, findings=(*processed.findings, finding))


def joined_observations(processed: Sequence[ProcessedRecording]) -> Observations:
    """Observations of several recordings that were processed with the same options."""
    runs = tuple(run for each in processed for run in each.observations.runs)
    noise = np.max([each.observations.position_noise for each in processed], axis=0)
    return Observations(runs, processed[0].observations.band, noise)


def of_role(processed: Iterable[ProcessedRecording], role: str) -> tuple[ProcessedRecording, ...]:
    """Selects the processed recordings with a role, `train` or `validate`."""
    return tuple(each for each in processed if each.choice.role == role)
