"""Rollout of the model of a run over recordings: comparison of simulated and recorded motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError, Finding, StudyError
from armid.estimation.estimate_record import torque_parameters
from armid.input_boundary import read_json
from armid.remedy import Remedy, setting
from armid.runs.run import Run, format_of_new_recording
from armid.study.config import RecordingChoice
from armid.study.recordings.processed import process_each
from armid.study.recordings.reading import read_choice
from armid.study.storage.array_files import by_joint, is_archive, write_archive, write_table
from armid.validation.rollout import Feedback
from armid.validation.rollout_score import MotionScore, score_motion
from armid.validation.simulated_windows import SimulatedWindows, simulate_windows
from armid.validation.torque_validation import Check, Validation

MOST_LOST = 0.5
"""Largest share of lost windows with which the check of the rollout passes. If more than half of the windows are
lost, there is no median error."""

LOST, INDEFINITE = ROLL_OUT_CODES = ("roll-out-lost", "roll-out-indefinite")
"""Codes of findings about lost windows: the simulated motion diverged, or the mass matrix became indefinite."""

GAINS = ("proportional", "derivative", "integral")

SIMULATED = "Simulated motion"
"""Name of the content of the written file in messages."""

DIGITS = 10
"""Number of significant digits in the written table, far more than the accuracy of the simulation."""


@dataclass(frozen=True, eq=False, slots=True)
class RunRollout:
    """Rollout of the model of a run over recordings.

    Attributes:
        scores: Position errors on each recording.
        simulated: Recorded and simulated motion and torque of each recording.
        closed: True if the feedback of the recorded controller acted; otherwise only the recorded torque acted.
        findings: Findings of the reader and of the processing, and about lost windows.
    """

    scores: tuple[MotionScore, ...]
    simulated: tuple[SimulatedWindows, ...]
    closed: bool
    findings: tuple[Finding, ...]


def load_feedback(path: Path | str) -> Feedback:
    """Reads controller gains from a JSON file: `{"controller": {"proportional", "derivative", "integral"}}`.

    A `truth.json` of the lab contains these gains.

    Raises:
        ArmidError: The file is missing, is not JSON, or has no gains.
    """
    table: Any = read_json(path, "controller gains", remedy="give a JSON file.").get("controller")
    if not isinstance(table, Mapping) or any(name not in table for name in GAINS[:2]):
        raise ArmidError(
            f"{path} has no controller gains.",
            remedy='write {"controller": {"proportional": […], "derivative": […]}}, with one number for each joint.',
        )
    try:
        none = np.zeros(len(table["proportional"]))
        return Feedback(table["proportional"], table["derivative"], table.get("integral") or none)
    except TypeError as error:
        raise ArmidError(
            f"{path}: controller gains must be lists with one number for each joint ({error}).",
            remedy="write each gain as a list, for instance [100.0, 80.0].",
        ) from error


def roll_out_run(
    run: Run,
    paths: Sequence[str],
    reading: Mapping[str, Any],
    *,
    seconds: float = 0.5,
    tolerance: float = 0.01,
    feedback: Feedback | None = None,
) -> RunRollout:
    """Simulates the model of a run over windows of recordings, and compares the simulated with the recorded motion.

    Args:
        run: The run.
        paths: Recordings.
        reading: Fields of the log format that differ from that of the run's first recording.
        seconds: Length of a window [s].
        tolerance: Tolerated position error [rad or m]; the time until the error exceeds it is part of the score.
        feedback: Feedback of the controller of the recordings; if not given, only the recorded torque acts.

    Raises:
        RecordingError: A recording cannot be read or does not fit.
        StudyError: The feedback has another number of joints.
    """
    if feedback is not None and len(feedback.proportional) != run.robot.n:
        raise StudyError(
            f"The controller has gains for {len(feedback.proportional)} joints, but {run.robot.name} has "
            f"{run.robot.n}.",
            remedy="give the gains of this arm.",
        )
    how = format_of_new_recording(run, reading)
    parameters = torque_parameters(run.estimate.base, run.estimate.fit)
    every_row = replace(run.processing, slow=0.0, saturation="keep", standstill="keep")
    scores: list[MotionScore] = []
    rollouts: list[SimulatedWindows] = []
    findings: list[Finding] = []
    for path in paths:
        choice = RecordingChoice(path, "validate", how)
        recording, found = read_choice(choice, ".", run.robot)
        (processed,) = process_each([(choice, recording)], every_row, run.robot, edges_required=False)
        observations = processed.observations
        findings += (*found, *processed.findings)
        rollouts.append(simulate_windows(run.model, parameters, observations, seconds=seconds, feedback=feedback))
        scores.append(score_motion(rollouts[-1], tolerance=tolerance, path=path))
        findings += _lost(scores[-1])
    return RunRollout(tuple(scores), tuple(rollouts), feedback is not None, tuple(findings))


def judged_by_motion(validation: Validation, scores: Sequence[MotionScore], *, closed: bool) -> Validation:
    """Adds a check to a validation: at most half of the windows of the rollout are lost.

    Args:
        validation: Validation of the torque.
        scores: Position errors of the rollout.
        closed: True if the feedback of the recorded controller acted; otherwise only the recorded torque acted.
    """
    lost = sum(score.lost for score in scores) / max(sum(score.windows for score in scores), 1)
    how = "the same controller" if closed else "the recorded torque alone"
    name = f"share of windows of {scores[0].seconds:g} s lost under {how}"
    check = Check(name, lost, MOST_LOST, lost <= MOST_LOST)
    verdict = validation.verdict if check.ok else "fail"
    return replace(validation, verdict=verdict, checks=(*validation.checks, check))


def _lost(score: MotionScore) -> list[Finding]:
    """Findings about the lost windows of one recording: the motion diverged, or the mass matrix became indefinite."""
    windows_text = f"of {score.windows} windows of {score.seconds:g} s of {score.path}"
    found: list[Finding] = []
    if score.losses.ran_away:
        found.append(
            Finding(
                LOST,
                "warning",
                "",
                f"{score.losses.ran_away} {windows_text} diverged: the simulated speed of a joint became "
                "impossibly large.",
                "choose shorter windows, or give the gains of the controller, because with torque alone "
                "every model diverges.",
            )
        )
    if score.losses.indefinite:
        found.append(
            Finding(
                INDEFINITE,
                "warning",
                "",
                f"{score.losses.indefinite} {windows_text} reached poses in which the mass matrix is not "
                "positive definite.",
                Remedy("estimate with physically consistent links: ", setting("method", "physical"), "."),
            )
        )
    return found


def motion_record(scores: Sequence[MotionScore], *, closed: bool) -> dict[str, Any]:
    """Scores of a rollout as a JSON object."""
    return {
        "closed_loop": closed,
        "recordings": [
            {
                "path": score.path,
                "rms": score.rms,
                "peak": score.peak,
                "held": score.held,
                "travelled": score.travelled,
                "prior_rms": score.prior_rms,
                "windows": score.windows,
                "lost": score.lost,
                "ran_away": score.losses.ran_away,
                "not_positive_definite": score.losses.indefinite,
                "nominal_lost": None if score.prior_rms is None else score.losses.nominal,
                "seconds": score.seconds,
                "tolerance": score.tolerance,
            }
            for score in scores
        ],
    }


def write_rollout(path: Path | str, rollout: RunRollout, joints: Sequence[str]) -> Path:
    """Writes simulated and recorded motion and torque, as CSV or NPZ; the suffix decides.

    Each row is a sample of a window of a recording, both numbered from 1, with the time in the recording [s]. Values
    of a window that is lost are NaN after its end.

    Args:
        path: The file; it is written completely or not at all.
        rollout: The rollout.
        joints: Names of the joints.

    Raises:
        ArmidError: The suffix is neither `.csv` nor `.npz`, or the file cannot be written.
    """
    table = _table(rollout)
    if is_archive(path, SIMULATED):
        facts = {"joints": np.array(joints), "paths": np.array([score.path for score in rollout.scores])}
        return write_archive(path, {**facts, **table})
    columns = [{name: x} if x.ndim == 1 else by_joint(f"{name}_", x) for name, x in table.items()]
    return write_table(path, {name: x for each in columns for name, x in each.items()}, DIGITS)


def _table(rollout: RunRollout) -> dict[str, Array]:
    """Columns of a file of simulated motion: shape (K,), or (K, n) for a value of each joint."""
    parts = rollout.simulated
    numbers = [np.broadcast_to(np.arange(1.0, len(s.time) + 1.0)[:, None], s.time.shape).ravel() for s in parts]
    values = {
        name: [getattr(getattr(s, source), quantity).reshape(s.time.size, -1) for s in parts]
        for name, source, quantity in (
            ("q", "found", "q"), ("dq", "found", "dq"), ("tau", "found", "torque"),
            ("recorded_q", "windows", "q"), ("recorded_dq", "windows", "dq"), ("recorded_tau", "windows", "torque"),
        )
    }  # fmt: skip
    return {
        "recording": np.concatenate([np.full(s.time.size, k + 1.0) for k, s in enumerate(parts)]),
        "window": np.concatenate(numbers),
        "t": np.concatenate([s.time.ravel() for s in parts]),
        **{name: np.concatenate(each) for name, each in values.items()},
    }
