"""Identification of the servos of a study, and their validation on held-out motion."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError, Finding
from armid.measurement.recording import Recording
from armid.model.terms import TERMS
from armid.robot import Robot
from armid.servo.closed_loop import simulate
from armid.servo.estimate_table import EstimatedValue, estimated_values
from armid.servo.identify_servo import ServoEstimate, identify_servo
from armid.servo.parameters import ServoModel, ServoParameters, described_parameters, make_servo_model
from armid.servo.position_band import band_coverage, position_band
from armid.servo.score import ClosedLoopError, closed_loop_error, command_error, error_of
from armid.servo.servo_run import ServoRun, servo_runs
from armid.study.config import RecordingChoice, Study, load_choice
from armid.study.diagnosis import diagnosed_error
from armid.study.progress import Progress, no_progress
from armid.study.recordings.reading import read_all
from armid.study.servos.choice import servo_options
from armid.study.servos.command_checks import command_findings
from armid.study.servos.described_servo_findings import described_servo_findings
from armid.study.servos.servo_estimate_findings import servo_estimate_findings

USED = 0.9
"""Share of a recording from which the unused rest is not worth a finding."""


@dataclass(frozen=True, eq=False, slots=True)
class ServoScore:
    """Closed-loop errors on the validation runs.

    Attributes:
        model: Error of the identified arm.
        command: Error of an arm whose joints are where their commands are.
        described: Error of the description as it stands, with its own servos; `None` if it has none.
        coverage: Share of the samples of each joint that are inside the 95 % band of the position, shape (n,).
    """

    model: ClosedLoopError
    command: ClosedLoopError
    described: ClosedLoopError | None
    coverage: Array

    @property
    def verdict(self) -> Literal["pass", "fail"]:
        """`pass` if the identified arm predicts motion better than its commands do."""
        return "pass" if self.model.total < self.command.total else "fail"


@dataclass(frozen=True, eq=False, slots=True)
class ServoResult:
    """Result of the identification of servos.

    Attributes:
        study: The study.
        estimate: The estimate.
        values: Gains, friction, rotor inertias, offsets and delays with intervals.
        training: Training runs.
        validation: Validation runs.
        score: Errors on the validation runs; `None` without such runs.
        band: Half width of the 95 % band of the position of each joint, shape (n,) [rad or m].
        findings: Findings about description, recordings and estimate.
        seconds: Duration of the identification [s].
        digests: Digests (sha256) of the recordings of the study, in its order.
    """

    study: Study
    estimate: ServoEstimate
    values: tuple[EstimatedValue, ...]
    training: tuple[ServoRun, ...]
    validation: tuple[ServoRun, ...]
    score: ServoScore | None
    band: Array
    findings: tuple[Finding, ...]
    seconds: float
    digests: tuple[str, ...]

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.estimate.model.robot


def identify_servo_study(
    study: Study, *, given: Mapping[str, Recording] | None = None, progress: Progress | None = None
) -> ServoResult:
    """Identifies servos, friction and links of a study whose recordings have commands.

    Args:
        study: The study; its table `[servo]` states what is known of the servos.
        given: Recordings that are in memory already, by their path in the study.
        progress: Function that is called with the name of each stage and the share of the stage that is done.

    Raises:
        ArmidError: An input is wrong; the message names the input and the fault.
    """
    began = time.perf_counter()
    tell = progress or no_progress
    tell("robot", 0.0)
    robot = load_choice(study.robot, study.folder)
    options = servo_options(study.servo, robot)
    model = make_servo_model(robot, [TERMS[name]() for name in study.servo.terms])
    recordings, read_findings = read_all(study, robot, given, tell)
    parts = {
        role: tuple(run for choice, recording in recordings if choice.role == role for run in servo_runs(recording))
        for role in ("train", "validate")
    }
    faults = command_findings(robot, recordings)
    try:
        estimate = identify_servo(model, parts["train"], options, tell)
    except EstimationError as error:
        raise diagnosed_error(error, faults) from error
    tell("validation", 0.0)
    band = position_band(estimate, parts["train"])
    score = servo_score(estimate.model, estimate.parameters, parts["validate"], band) if parts["validate"] else None
    values = tuple(estimated_values(estimate, list(parts["train"])))
    findings = (
        *robot.findings,
        *(each for found in read_findings for each in found),
        *faults,
        *unused_findings(recordings, parts),
        *described_servo_findings(robot, (*parts["train"], *parts["validate"])),
        *servo_estimate_findings(estimate),
    )
    seconds = time.perf_counter() - began
    digests = tuple(recording.sha256 for _, recording in recordings)
    return ServoResult(
        study, estimate, values, parts["train"], parts["validate"], score, band, findings, seconds, digests
    )


def servo_score(model: ServoModel, parameters: ServoParameters, runs: Sequence[ServoRun], band: Array) -> ServoScore:
    """Errors of an identified arm on validation runs, beside those of its commands and of its description.

    Args:
        model: Arm and friction laws.
        parameters: Identified parameters.
        runs: Validation runs.
        band: Half width of the 95 % band of the position of each joint, shape (n,) [rad or m].
    """
    described = described_parameters(model)
    simulated = simulate(model, parameters, runs)
    errors = [run.q - each.q for run, each in zip(runs, simulated, strict=True)]
    return ServoScore(
        error_of(errors),
        command_error(runs),
        None if described is None else closed_loop_error(model, described, runs),
        band_coverage(errors, band),
    )


def unused_findings(
    recordings: Sequence[tuple[RecordingChoice, Recording]], parts: Mapping[str, Sequence[ServoRun]]
) -> list[Finding]:
    """Findings about recordings of which a part is not used, because of gaps, masks or short pieces."""
    found: list[Finding] = []
    for choice, recording in recordings:
        used = sum(run.seconds for run in parts[choice.role] if run.source == recording.source)
        span = recording.samples / (recording.rate or 1.0)
        if recording.time is not None:
            span = float(np.ptp(recording.time))
        if used < USED * span:
            what = f"{used:.3g} s of {span:.3g} s are used; gaps, masked rows and pieces below a second are not"
            remedy = "check the clock and the positions with `armid doctor`"
            found.append(Finding("servo-part-unused", "warning", recording.source, what, remedy))
    return found
