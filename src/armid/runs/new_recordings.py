"""New recordings of the arm of a run, which are read, processed and reduced to information like those of the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.dataclass_files import load
from armid.errors import Finding, RobotError, StudyError
from armid.estimation.friction_per_recording import changing_parameters
from armid.estimation.problem import EstimationProblem, build_problem
from armid.information.information import Information
from armid.maths.inertia import transform
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.model.base_parameters import BaseParameters
from armid.robot.robot import Robot
from armid.runs.run import Run
from armid.study.config import RecordingChoice
from armid.study.recordings.processed import ProcessedRecording, joined_observations, process_each
from armid.study.recordings.reading import read_choice


@dataclass(frozen=True, eq=False, slots=True)
class NewRecordings:
    """New recordings and the run that they extend.

    Attributes:
        run: The run.
        base: Base parameters of the run.
        earlier: Information of the training recordings of the run.
        new: Information of the new recordings about the same base parameters.
        samples: Estimation problem of the new recordings, with their samples.
        recordings: The new recordings, processed.
        findings: Findings of run, reading and processing.
    """

    run: Run
    base: BaseParameters
    earlier: Information
    new: Information
    samples: EstimationProblem
    recordings: tuple[ProcessedRecording, ...]
    findings: tuple[Finding, ...]

    @property
    def changing(self) -> NDArray[np.bool_]:
        """Mask of the base parameters that may change over time, which are friction and offsets; shape (b,)."""
        return changing_parameters(self.run.model)[self.base.kept]


def load_new_recordings(
    run: Run, paths: Sequence[str], reading: Mapping[str, Any], *, gain_deviation: float | None = None
) -> NewRecordings:
    """Reads and processes new recordings of the arm of a run.

    Args:
        run: The run.
        paths: Recordings.
        reading: Fields of the log format that differ from that of the run's first recording.
        gain_deviation: Relative standard deviation of every drive gain, instead of the value of the run.

    Raises:
        StudyError: A recording has trained the run or is given twice, or the run has no drive gains.
        RecordingError: A recording cannot be read or has other joints.
    """
    if gain_deviation is not None and run.reading.drive_gain is None:
        raise StudyError(
            f"The run {run.folder} has no drive gains, because its effort is a torque, so a deviation of the "
            "gains has no meaning.",
            remedy="leave --gain-deviation out.",
        )
    recordings, findings = read_new_recordings(run, paths, reading)
    processed = process_each(recordings, run.processing, run.robot)
    observations = joined_observations(processed)
    base = run.estimate.base
    earlier = load(Information, Path(run.folder) / "information.npz")
    found = tuple(finding for each in processed for finding in each.findings)
    deviation = _deviation(recordings[0][0].reading, run.robot.n)
    if gain_deviation is not None:
        deviation = np.full(run.robot.n, gain_deviation)
    samples = build_problem(run.model, observations, base=base, scale_deviation=deviation)
    return NewRecordings(
        run, base, earlier, samples.information, samples, processed, (*new_recording_findings(run), *findings, *found)
    )


def read_new_recordings(
    run: Run, paths: Sequence[str], reading: Mapping[str, Any]
) -> tuple[tuple[tuple[RecordingChoice, Recording], ...], tuple[Finding, ...]]:
    """Reads recordings that did not train a run, with the run's log format; returns them with findings.

    Args:
        run: The run.
        paths: Recordings.
        reading: Fields of the log format that differ from that of the run's first recording.

    Raises:
        StudyError: A recording has trained the run or is given twice.
        RecordingError: A recording cannot be read or has other joints.
    """
    how = replace(run.reading, **{"exclude": (), "start": None, **reading})
    recordings: list[tuple[RecordingChoice, Recording]] = []
    findings: list[Finding] = []
    seen = dict.fromkeys(run.trained_on, run.folder)
    for path in paths:
        choice = RecordingChoice(str(Path(path).absolute()), reading=how)
        recording, found = read_choice(choice, ".", run.robot)
        if recording.sha256 in seen:
            raise StudyError(
                f"{path} must be a new recording, but it has the same data as {seen[recording.sha256]} "
                f"(sha256 {recording.sha256[:12]}…).",
                remedy="give only recordings that were made after the run, and each of them once.",
            )
        seen[recording.sha256] = path
        findings += found
        recordings.append((choice, recording))
    return tuple(recordings), tuple(findings)


def new_recording_findings(run: Run) -> list[Finding]:
    """Findings that show why a run may be a bad basis."""
    if run.verdict != "fail":
        return []
    return [
        Finding(
            "earlier-run-failed",
            "warning",
            "",
            f"The run {run.folder} did not pass its own validation (verdict fail), so results that are based "
            "on it may be wrong.",
            "read the report of the run, and identify the arm with a better motion first.",
        )
    ]


def _deviation(reading: LogFormat, n: int) -> Array:
    """Relative standard deviation of the drive gain of each joint; zero if not given."""
    given = reading.drive_gain_deviation
    return np.array(np.broadcast_to(0.0 if given is None else np.asarray(given, dtype=np.float64), (n,)))


def load_columns(run: Run) -> tuple[Array, Array]:
    """Matrices from ten payload parameters in the tip frame to base parameters (b, 10) and link frame (10, 10).

    Raises:
        RobotError: The tip is fixed to the base, or its link carries further joints.
        StudyError: The run's model has no rigid bodies.
    """
    _, columns = link_columns(run)
    rotation, translation = run.robot.tip.placement[:3, :3], run.robot.tip.placement[:3, 3]
    to_link = transform(np.eye(10), rotation, translation).T
    return columns @ to_link, to_link


def link_columns(run: Run, link: int | None = None) -> tuple[int, Array]:
    """Link that carries a load, and matrix that maps its ten parameters to the base parameters, shape (b, 10).

    Args:
        run: Run of the arm.
        link: Number of the link; by default that of the tip.

    Raises:
        RobotError: No link is given, and the tip is fixed to the base, or its link carries further joints.
        StudyError: The run's model has no rigid bodies.
    """
    link = _tip_link(run.robot) if link is None else link
    if not run.model.has_rigid_bodies:
        raise StudyError(
            f"The model of {run.folder} has no rigid bodies, so the effect of a load cannot be computed.",
            remedy="identify again with the term rigid-body.",
        )
    columns = run.model.inertial_columns.reshape(-1, 10)[link]
    return link, run.estimate.base.regrouping[:, columns]


def _tip_link(robot: Robot) -> int:
    """Number of the link that carries the tip, which must be the last."""
    link = robot.tip.parent
    if link < 0:
        raise RobotError(
            f"The tip frame {robot.tip.name!r} of {robot.name} is fixed to the base and carries no load.",
            remedy='name the flange with tip = "…" in the [robot] table of the study and identify again.',
        )
    further = [joint.name for joint in robot.joints if joint.parent == link]
    if further:
        raise RobotError(
            f"The tip frame {robot.tip.name!r} of {robot.name} is on the link {robot.links[link].name!r}, "
            f"which is not the last link, because it carries the joints {', '.join(further)}.",
            remedy='name a frame on the last link with tip = "…" in the study, or lock these joints; for the load of '
            "armid payload, --link names any link.",
        )
    return link
