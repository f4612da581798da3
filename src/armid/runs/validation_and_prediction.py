"""Validation of a run on new recordings, and prediction of torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, StudyError
from armid.estimation.estimate_record import torque_parameters
from armid.information.hysteresis_states import with_hysteresis_states
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording
from armid.model.motion import Motion
from armid.runs.new_recordings import check_new_recordings
from armid.runs.run import Run, format_of_new_recording
from armid.study.config import RecordingChoice
from armid.study.plans.plan_reading import motion_of_plan, other_joints_of_plan
from armid.study.plausibility.recording_errors import contradicted
from armid.study.recordings.processed import judged_without_memory, process_each
from armid.study.recordings.reading import read_choice
from armid.study.score_recordings import score_recordings
from armid.study.storage.array_files import by_joint, is_archive, write_archive, write_table
from armid.validation.prediction_interval import torque_band
from armid.validation.torque_validation import Validation, validate


def validate_run(
    run: Run, paths: Sequence[str], reading: Mapping[str, Any]
) -> tuple[Validation, tuple[Finding, ...]]:
    """Validates a run on recordings that were not used to train it.

    The verdict is `fail` if a finding on these recordings is an error.

    Args:
        run: The run.
        paths: Recordings.
        reading: Fields of the log format that differ from that of the run's first recording.

    Raises:
        StudyError: The run was trained on one of the recordings.
        RecordingError: A recording cannot be read or does not fit.
    """
    recordings: list[tuple[RecordingChoice, Recording]] = []
    read_findings: list[tuple[Finding, ...]] = []
    for path in paths:
        choice = RecordingChoice(path, "validate", format_of_new_recording(run, reading))
        recording, found = read_choice(choice, ".", run.robot)
        read_findings.append(found)
        if recording.sha256 in run.trained_on:
            raise StudyError(
                f"{path} cannot be used to validate {run.folder}, because the run was trained on the same "
                f"data (sha256 {recording.sha256[:12]}…).",
                remedy="give a recording that was not used for training.",
            )
        recordings.append((choice, recording))
    processed = judged_without_memory(
        process_each(recordings, run.processing, run.robot, edges_required=False), run.model
    )
    scores, found = score_recordings(run.model, run.estimate, processed)
    told = check_new_recordings(run, recordings, read_findings)
    return contradicted(validate(run.robot.joint_names, scores, run.estimate), told), (*told, *found)


def motion_of(run: Run, path: str, *, rate: float, reading: Mapping[str, Any]) -> tuple[Motion, tuple[Finding, ...]]:
    """Motion of a plan, of a file for a controller, or of a recording, and the findings about it.

    A recording is processed with the options of the run.

    Args:
        run: The run.
        path: Plan, file for a controller, or recording.
        rate: Sample rate of a plan [Hz].
        reading: Fields of the log format that differ from that of the run.

    Raises:
        ArmidError: The motion cannot be read, or its joints are not those of the arm.
    """
    planned = motion_of_plan(path, run.robot, rate)
    if planned is not None:
        return planned, other_joints_of_plan(path, run.robot)
    how = format_of_new_recording(run, reading)
    raw = load_recording(path, how, run.robot)
    if raw.effort is None:  # only the motion is needed
        how = replace(how, drive_gain=None, drive_gain_deviation=None)
    choice = RecordingChoice(path, reading=how)
    recording, _ = read_choice(choice, ".", run.robot, {path: raw})
    if recording.effort is None:
        recording = replace(recording, effort=np.zeros_like(recording.q))
    every_row = replace(run.processing, slow=0.0, saturation="keep", standstill="keep")
    (processed,) = process_each([(choice, recording)], every_row, run.robot, edges_required=False)
    observations = processed.observations
    # Hysteresis states begin anew in each run.
    motions = [
        with_hysteresis_states(run.model, observed, observations.band).motion for observed in observations.runs
    ]
    names = ("time", "q", "dq", "ddq", *(["memory"] if run.model.nodes else []))
    joined = [np.concatenate([getattr(motion, name) for motion in motions]) for name in names]
    # The motion has fewer rows than the log then.
    reduced = tuple(each for each in raw.findings if each.code == "rate-reduced")
    return Motion(*joined), (*reduced, *processed.findings)


def predict(run: Run, motion: Motion) -> Array:
    """Predicts the joint torque (N, n) of a motion [N·m or N]."""
    return run.model.torque(motion, torque_parameters(run.estimate.base, run.estimate.fit))


def band(run: Run, motion: Motion) -> Array:
    """Half width of the 95 % prediction interval of the torque after the low-pass filter, (N, n) [N·m or N]."""
    return torque_band(run.model, run.estimate, motion)


def write_torque(
    path: Path | str, motion: Motion, torque: Array, joints: Sequence[str], *, band: Array | None = None
) -> Path:
    """Writes time, torque and, if given, half widths of intervals to a CSV or NPZ file; the suffix decides.

    Args:
        path: The file.
        motion: Motion with the N times.
        torque: Joint torque, shape (N, n) [N·m or N].
        joints: Names of the joints.
        band: Half width of the prediction interval, shape (N, n) [N·m or N].

    Raises:
        ArmidError: The suffix is neither `.csv` nor `.npz`.
    """
    torques = {"torque": torque} if band is None else {"torque": torque, "band95": band}
    if is_archive(path, "Torque"):
        return write_archive(path, {"time": motion.time, "joints": np.array(joints), **torques})
    named = zip(("tau", "band95_"), torques.values(), strict=False)
    columns = [by_joint(name, values) for name, values in named]
    return write_table(path, {"t": motion.time} | {key: each[key] for each in columns for key in each})
