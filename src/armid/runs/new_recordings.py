"""Reading and processing of new recordings of the arm of a run, and computation of their triangular factors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.dataclass_files import load
from armid.doctor.checks.dynamics.rotor_inertia_missing import CODE as ROTOR_INERTIA_MISSING
from armid.doctor.earlier_run_links import DESCRIPTION, KnownLinks
from armid.errors import Finding, RobotError, StudyError
from armid.estimation.estimate_record import torque_parameters
from armid.estimation.friction_per_recording import changing_parameters
from armid.estimation.problem import EstimationProblem, build_problem
from armid.information.information import Information
from armid.maths.inertia import transform
from armid.measurement.recording import Recording
from armid.model.base_parameters import BaseParameters
from armid.remedy import Remedy, setting
from armid.robot.robot import Robot
from armid.runs.run import Run, failed_checks, format_of_new_recording, only_drive_gains_failed
from armid.study.config import RecordingChoice
from armid.study.diagnosis import findings_of_each, merged
from armid.study.recordings.processed import (
    ProcessedRecording,
    joined_observations,
    judged_without_memory,
    process_each,
)
from armid.study.recordings.reading import position_zero_deviation, read_choice, scale_deviation

ReadRecording = tuple[RecordingChoice, Recording]
"""Recording that was read, with its path, role and log format."""


@dataclass(frozen=True, eq=False, slots=True)
class NewRecordings:
    """New recordings and the run that they extend.

    Attributes:
        run: The run.
        base: Base parameters of the run.
        earlier: Factors of the recordings on which the run was trained.
        new: Factors of the new recordings, in the same base parameters.
        samples: Estimation problem of the new recordings, with their samples.
        recordings: The new recordings, processed.
        held_out: New recordings for validation, processed.
        findings: Findings about the run, and of the reader, the doctor and the processing.
    """

    run: Run
    base: BaseParameters
    earlier: Information
    new: Information
    samples: EstimationProblem
    recordings: tuple[ProcessedRecording, ...]
    held_out: tuple[ProcessedRecording, ...]
    findings: tuple[Finding, ...]

    @property
    def changing(self) -> NDArray[np.bool_]:
        """Mask of the base parameters that may change over time, which are friction and offsets; shape (b,)."""
        return changing_parameters(self.run.model)[self.base.kept]

    @property
    def faults(self) -> tuple[str, ...]:
        """Codes of the findings about faults that make an estimate from the new recordings wrong."""
        codes = (f.code for f in self.findings if f.severity == "error" or f.code == ROTOR_INERTIA_MISSING)
        return tuple(dict.fromkeys(codes))


def load_new_recordings(
    run: Run,
    paths: Sequence[str],
    reading: Mapping[str, Any],
    *,
    held_out: Sequence[str] = (),
    gain_deviation: float | None = None,
    loaded: int | None = None,
) -> NewRecordings:
    """Reads, checks and processes new recordings of the arm of a run.

    Args:
        run: The run.
        paths: Recordings.
        reading: Fields of the log format that differ from that of the run's first recording.
        held_out: Recordings for validation.
        gain_deviation: Relative standard deviation of every drive gain; if not given, that of the run.
        loaded: Number of the link that may carry a load; by default that of the tip.

    Raises:
        StudyError: The run was trained on a recording, or a recording is given twice, or the run has no drive gains.
        RecordingError: A recording cannot be read or has other joints.
    """
    if gain_deviation is not None and run.log_format.drive_gain is None:
        raise StudyError(
            f"The run {run.folder} has no drive gains, because its effort is a torque, so a deviation of the "
            "gains has no meaning.",
            remedy="leave --gain-deviation out.",
        )
    recordings, read = read_new_recordings(run, paths, reading)
    unseen, read_unseen = _read_held_out(run, held_out, recordings)
    processed = process_each(recordings, run.processing, run.robot, edges_required=False)
    observations = joined_observations(processed)
    base = run.estimate.base
    earlier = earlier_information(run)
    of_processing = tuple(finding for each in processed for finding in each.findings)
    told = check_new_recordings(run, (*recordings, *unseen), (*read, *read_unseen), of_processing, loaded)
    choices = [choice for choice, _ in recordings]
    deviation = scale_deviation(choices, run.robot)
    if gain_deviation is not None:
        deviation = np.full(run.robot.n, gain_deviation)
    samples = build_problem(
        run.model,
        observations,
        base=base,
        scale_deviation=deviation,
        position_zero_deviation=position_zero_deviation(choices, run.robot),
    )
    return NewRecordings(
        run,
        base,
        earlier,
        samples.information,
        samples,
        processed,
        judged_without_memory(process_each(unseen, run.processing, run.robot, edges_required=False), run.model),
        (*new_recording_findings(run), *told, *of_processing),
    )


def read_new_recordings(
    run: Run, paths: Sequence[str], reading: Mapping[str, Any]
) -> tuple[tuple[ReadRecording, ...], tuple[tuple[Finding, ...], ...]]:
    """Reads recordings on which a run was not trained, with the log format of the run.

    The second result contains the findings of the reader about each recording.

    Args:
        run: The run.
        paths: Recordings.
        reading: Fields of the log format that differ from that of the run's first recording.

    Raises:
        StudyError: The run was trained on a recording, or a recording is given twice.
        RecordingError: A recording cannot be read or has other joints.
    """
    how = format_of_new_recording(run, reading)
    recordings: list[ReadRecording] = []
    findings: list[tuple[Finding, ...]] = []
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
        findings.append(found)
        recordings.append((choice, recording))
    return tuple(recordings), tuple(findings)


def _read_held_out(
    run: Run, paths: Sequence[str], training: Sequence[ReadRecording]
) -> tuple[tuple[ReadRecording, ...], tuple[tuple[Finding, ...], ...]]:
    """Reads validation recordings with the log format of the first new recording.

    The second result contains the findings of the reader about each recording.

    Args:
        run: The run.
        paths: Validation recordings.
        training: New recordings for training.

    Raises:
        StudyError: A recording was already used for training, or is given twice.
    """
    recordings: list[ReadRecording] = []
    findings: list[tuple[Finding, ...]] = []
    for path in paths:
        choice = replace(training[0][0], path=str(Path(path).absolute()), role="validate")
        recording, found = read_choice(choice, ".", run.robot)
        if recording.sha256 in {*run.trained_on, *(each.sha256 for _, each in training)}:
            raise StudyError(
                f"{path} cannot be used for validation, because the same data are used for training (sha256 "
                f"{recording.sha256[:12]}…).",
                remedy="give a recording that was used neither by the run nor by the recalibration.",
            )
        if recording.sha256 in {each.sha256 for _, each in recordings}:
            raise StudyError(
                f"{path} is given twice for validation (sha256 {recording.sha256[:12]}…).",
                remedy="leave one of them out.",
            )
        recordings.append((choice, recording))
        findings.append(found)
    return tuple(recordings), tuple(findings)


def check_new_recordings(
    run: Run,
    recordings: Sequence[ReadRecording],
    read: Sequence[Sequence[Finding]],
    processing: Sequence[Finding] = (),
    loaded: int | None = None,
) -> tuple[Finding, ...]:
    """Findings of the readers and of the doctor on new recordings of the arm of a run.

    The doctor compares the recordings with the links of the run, which may carry a load. These links are more
    accurate than those of the description, unless the run failed its validation (`known_links`).

    Args:
        run: The run.
        recordings: The recordings.
        read: Findings of the reader about each recording.
        processing: Findings of the processing, which are not repeated in the result.
        loaded: Number of the link that may carry a load; by default that of the tip.
    """
    links = known_links(run, loaded)
    found = findings_of_each(run.model, recordings, read, processing, links, run.processing)
    return tuple(
        _without_rotors(run, finding) if finding.code == ROTOR_INERTIA_MISSING else finding
        for finding in merged([choice for choice, _ in recordings], found)
    )


def _without_rotors(run: Run, finding: Finding) -> Finding:
    """Extends a finding about missing rotor inertia by the consequence for estimates from new recordings."""
    evidence = (
        f"{finding.evidence} The model of {run.folder} has no rotor inertia, so a new estimate would attribute "
        "it to links or load. These recordings may contain the effort on the motor side of the gears, but those of "
        "the run the effort on the joint side."
    )
    terms = Remedy.read(finding.remedy).keys.get("terms", ["default", "rotor-inertia"])
    # In a run that was recalibrated with such a recording, the finding is an error.
    known = any(each.code == finding.code and each.severity != "error" for each in run.estimate.findings)
    remedy = Remedy(
        "give recordings whose effort is measured on the same side of the gears as in the run, or identify the arm "
        "from recordings like these with ",
        setting("terms", terms),
        ".",
    )
    return replace(finding, severity="warning" if known else finding.severity, evidence=evidence, remedy=remedy)


def known_links(run: Run, loaded: int | None = None) -> KnownLinks | None:
    """Inertial parameters of the links for the doctor, which compares their torque with new recordings.

    They are the parameters of the run. If the run has only base parameters, the bodies of the description are used,
    changed so that they give the torque of the run. If the run failed its validation for another reason than its
    drive gains, its parameters may be wrong, and the bodies of the description are used unchanged. The result is
    `None` if no inertial parameters are known.

    Args:
        run: The run.
        loaded: Number of the link that may carry a load; by default that of the tip, or else the last link.
    """
    model, estimate = run.model, run.estimate
    if not model.has_rigid_bodies:
        return None
    theta = torque_parameters(estimate.base, estimate.fit)
    described = model.nominal_parameters()
    source = f"the run {run.folder}"
    if run.verdict == "fail" and not only_drive_gains_failed(run):
        if described is None:
            return None
        theta, source = described, DESCRIPTION
    elif estimate.fit.standard is None and described is not None:
        shifted = described.copy()
        shifted[estimate.base.kept] += theta[estimate.base.kept] - estimate.base.values_of(described)
        theta = shifted
    tip = run.robot.tip.parent
    last = tip if tip >= 0 else run.robot.n - 1
    bodies = theta[model.inertial_columns].reshape(-1, 10)
    return KnownLinks(bodies, source, last if loaded is None else loaded)


def earlier_information(run: Run) -> Information:
    """Reads the triangular factors of the training recordings of a run.

    Args:
        run: The run.
    """
    return load(Information, Path(run.folder) / "information.npz")


def new_recording_findings(run: Run) -> list[Finding]:
    """Finding about a run that failed its own validation; an empty list if the run did not fail."""
    if run.verdict != "fail":
        return []
    named = "; ".join(["verdict fail", *failed_checks(run)])
    return [
        Finding(
            "earlier-run-failed",
            "warning",
            "",
            f"The run {run.folder} did not pass its own validation ({named}), so "
            "results that are based on it may be wrong.",
            "read the report of the run, and identify the arm with a better motion first.",
        )
    ]


def load_columns(run: Run) -> tuple[Array, Array]:
    """Matrices that map the ten parameters of a payload in the tip frame to other parameters.

    The first matrix (b, 10) gives base parameters, the second (10, 10) the ten parameters in the frame of the last
    link.

    Raises:
        RobotError: The tip is fixed to the base, or its link carries further joints.
        StudyError: The run's model has no rigid bodies.
    """
    _, columns = link_columns(run)
    rotation, translation = run.robot.tip.placement[:3, :3], run.robot.tip.placement[:3, 3]
    to_link = transform(np.eye(10), rotation, translation).T
    return columns @ to_link, to_link


def link_columns(run: Run, link: int | None = None) -> tuple[int, Array]:
    """Number of the link that carries a load, and matrix (b, 10) from the load's ten parameters to base parameters.

    The ten parameters are in the frame of the link.

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
            remedy="identify again with the term `rigid-body`.",
        )
    columns = run.model.inertial_columns.reshape(-1, 10)[link]
    return link, run.estimate.base.regrouping[:, columns]


def _tip_link(robot: Robot) -> int:
    """Number of the link that carries the tip, which must be the last link."""
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
