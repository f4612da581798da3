"""Recordings of a study with their observations, so that each recording is processed only once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np

from armid.errors import Finding
from armid.measurement.observations import Observations
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import differenced_noise, process_recording, resolve_options
from armid.measurement.recording import Recording
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
    recordings: Sequence[tuple[RecordingChoice, Recording]], processing: ProcessingOptions, robot: Robot
) -> tuple[ProcessedRecording, ...]:
    """Processes recordings one by one; the recordings are numbered, training recordings first.

    Raises:
        RecordingError: A recording cannot be processed with these options.
    """
    if not recordings:
        return ()
    processing = resolve_options(processing, [recording for _, recording in recordings])
    limits = np.array([joint.effort_limit for joint in robot.joints])
    training = sum(choice.role == "train" for choice, _ in recordings)
    number = {"train": count(), "validate": count(training)}
    processed: list[ProcessedRecording] = []
    for choice, recording in recordings:
        runs, findings = process_recording(
            recording,
            processing,
            period=choice.reading.repeats,
            start=choice.reading.start,
            effort_limits=limits,
            index=next(number[choice.role]),
        )
        observations = Observations(runs, processing.band, differenced_noise(recording, processing))
        processed.append(ProcessedRecording(choice, recording, observations, findings))
    return tuple(processed)


def joined_observations(processed: Sequence[ProcessedRecording]) -> Observations:
    """Observations of several recordings that were processed with the same options."""
    runs = tuple(run for each in processed for run in each.observations.runs)
    noise = np.max([each.observations.position_noise for each in processed], axis=0)
    return Observations(runs, processed[0].observations.band, noise)


def of_role(processed: Iterable[ProcessedRecording], role: str) -> tuple[ProcessedRecording, ...]:
    """Selects the processed recordings with a role, `train` or `validate`."""
    return tuple(each for each in processed if each.choice.role == role)
