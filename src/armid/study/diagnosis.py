"""The doctor on a study: every recording as it stands, what stops the reading worked around."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.doctor import EFFECTS, EXPLAINS, SEVERITIES, LogEvidence, examine
from armid.doctor.checks.dynamics.channel_delay import explain as explain_delay
from armid.doctor.checks.dynamics.contact import explain as explain_contact
from armid.doctor.checks.signals.motor_side import explain as explain_scale
from armid.doctor.explanation import LogState
from armid.errors import ArmidError, Finding, RecordingError
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import process_recording
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording
from armid.measurement.robot_convention import to_robot_convention, understood
from armid.model.dynamics import DynamicsModel
from armid.robot import Robot
from armid.study.config import RecordingChoice, Study, build_model, load_choice
from armid.study.recording_labels import labels, together
from armid.study.remedies import tables_of
from armid.threads import one_blas_thread
from armid.validation.gravity_sign import gravity_finding

__all__ = [
    "Diagnosis",
    "diagnose",
    "diagnose_recording",
    "diagnosis_record",
    "findings_on",
    "has_errors",
    "run_checks",
]

CODE = re.compile(r"\[([a-z-]+)\]$")
"""Where an error about a recording ends with the code of its finding."""

TRIES = 4
"""Faults in a row that are worked around to see what lies behind them."""

PLAUSIBLE_CONFLICT, PLAUSIBLE_CORRELATION, PLAUSIBLE_SCALE = 0.6, 0.7, 0.3
"""Conflict between joints up to which, and correlation with and share of the description from which, angles read
as degrees are believed to be degrees: motors' angles are not, whatever limits they stay in."""


USUAL = ProcessingOptions()
"""What a study has that says nothing of it."""

OF_LOG = ("channel-dead", "saturation", "filtered-before-logging", "velocity-mismatch")
"""Checks of every log that an identification makes; gaps, unevenness and repetitions it reports as it processes."""

OF_READING = (
    "motor-side",
    "degrees",
    "torque-sign",
    "position-sign",
    "joint-order",
    "gravity-direction",
    "position-offset",
    "rotor-inertia-missing",
)
"""Checks beside a model that it makes once for each way of reading: what a reading says of signs, order, units, zeros
and sides holds for all logs that are read so. Excitation it judges by all recordings together."""

OF_EACH = ("channel-delay", "contact", "temperature-drift")
"""Checks beside a model of what happens to one recording and not to another."""

OWN = (explain_delay, explain_contact)
"""What these need of the contest, where the reading has nothing wrong."""

GEARED = 3.0
"""Span of the motion, in spans of the limits, from which it is that of motors."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Findings on one recording.

    Attributes:
        path: The recording.
        findings: Errors first.
    """

    path: str
    findings: tuple[Finding, ...]


def diagnose(study: Study, *, given: Mapping[str, Recording] | None = None) -> tuple[Diagnosis, ...]:
    """Examine every recording of a study, whole.

    Args:
        study: The study.
        given: Recordings at hand, by their path in the study.

    Raises:
        ArmidError: No such robot or file, or a file that cannot be read at all.
    """
    robot = load_choice(study.robot, study.folder)
    model = build_model(robot, study.model) if study.model.terms else None
    result: list[Diagnosis] = []
    for choice in {(each.path, repr(each.reading)): each for each in study.recordings}.values():
        raw = (given or {}).get(choice.path)
        if raw is None:
            raw = load_recording(Path(study.folder) / choice.path, choice.reading, robot)
        found = diagnose_recording(robot, raw, choice.reading, model, processing=study.processing)
        result.append(Diagnosis(choice.path, found))
    return tuple(result)


@one_blas_thread
def diagnose_recording(
    robot: Robot,
    raw: Recording,
    reading: LogFormat,
    model: DynamicsModel | None = None,
    *,
    processing: ProcessingOptions = USUAL,
) -> tuple[Finding, ...]:
    """Examine one recording.

    What stops the reading is an error; where it can be worked around, for the eyes of the doctor alone, the rest
    of the log is examined too.

    Args:
        robot: The arm that was recorded.
        raw: As the file has it.
        reading: How it is read.
        model: The study's model; the usual terms if not given.
        processing: The study's, which says which rows count: near limits, or at rest among others that move.

    Raises:
        RecordingError: The recording does not fit the robot at all.
    """
    noted: list[Finding] = [*robot.findings]
    gravity = gravity_finding(robot)
    noted += [] if gravity is None else [gravity]
    if raw.effort is None:
        remedy = 'find out what its columns are called, and name them: columns = { effort = "tau{}" }'
        noted.append(Finding("channel-dead", "error", "effort", "There is no effort in the recording.", remedy))
    log, how, recording = raw, understood(raw, reading), None
    for _ in range(TRIES):
        try:
            read = to_robot_convention(log, how, robot)
        except RecordingError as error:
            finding = _finding(error, log)
            noted += [*log.findings, finding]
            around = _worked_around(finding, log, how)
            if around is None:
                break
            log, how = around
        else:
            recording = read.recording
            noted += [*read.findings, *_sticking(recording, processing)]
            break
    evidence = LogEvidence(robot, raw, how, recording, tuple(noted), model, EXPLAINS, processing.saturation)
    if any(f.code == "current-without-gain" and f.severity == "error" for f in noted):
        return _of_currents(evidence)
    return examine(_reconsidered(evidence))


def _sticking(recording: Recording, processing: ProcessingOptions) -> list[Finding]:
    """Find joints that stand among others, as an identification does; nothing in a log that it cannot use."""
    plain = replace(processing, edges="drop", average=False, saturation=None)
    try:
        found = process_recording(recording, plain)[1]
    except ArmidError:
        return []
    return [replace(each, channel="") for each in found if each.code == "sticking"]


def _of_currents(evidence: LogEvidence) -> tuple[Finding, ...]:
    """Examine a log of currents: nothing that needs torques, but the gains that a description makes."""
    state = evidence.state
    scale = None if state is None else explain_scale(state)
    if scale is not None:
        remedy = scale.remedy(evidence)
        told = [replace(f, remedy=remedy) if f.code == "current-without-gain" else f for f in evidence.noted]
        evidence = replace(evidence, noted=tuple(told))
    evidence = replace(evidence, explains=())
    kept = {"channel-dead", "clock-gap", "clock-jitter", "saturation", "velocity-mismatch", "period-misaligned"}
    kept |= {finding.code for finding in evidence.noted}
    return tuple(f for f in examine(evidence) if f.code in kept)


def findings_on(
    model: DynamicsModel,
    recordings: Sequence[tuple[RecordingChoice, Recording]],
    read: Sequence[Sequence[Finding]],
    trained: Sequence[Finding] = (),
) -> list[Finding]:
    """Return what reading the recordings told and what the doctor says of them, with their names, each once.

    Args:
        model: Arm and torque terms.
        recordings: As read, with their roles.
        read: What was told of each as it was read.
        trained: What has been told of those that train, all together.
    """
    common = {finding.code for finding in trained if finding.severity != "info"}
    said = [
        {finding.code for finding in found if finding.severity != "info"} | (common if c.role == "train" else set())
        for (c, _), found in zip(recordings, read, strict=True)
    ]
    names = labels([choice for choice, _ in recordings])
    named = [(name, finding) for name, found in zip(names, read, strict=True) for finding in found]
    return [*together(named), *run_checks(model, recordings, said)]


@one_blas_thread
def run_checks(
    model: DynamicsModel,
    recordings: Sequence[tuple[RecordingChoice, Recording]],
    said: Sequence[Collection[str]] = (),
) -> list[Finding]:
    """Examine recordings while a study is identified, before anything is estimated, or beside a run.

    Args:
        model: Arm and torque terms of the study.
        recordings: As read, with their roles.
        said: Codes that have been told of each recording already.
    """
    told: list[tuple[str, Finding]] = []
    ill: dict[str, bool] = {}
    names = labels([choice for choice, _ in recordings])
    # The first of each kind tells what is wrong with their reading; the others what is wrong with them alone.
    # Nothing of a recording that validates is left to others: it may have been read as one that it is not like.
    for k in sorted(range(len(recordings)), key=lambda k: _rank(recordings, k)):
        choice, recording = recordings[k]
        kind = _kind(choice)
        explains, checks = EXPLAINS, (*OF_LOG, *OF_READING, *OF_EACH)
        if kind in ill and choice.role == "train":
            explains, checks = EXPLAINS if ill[kind] else OWN, (*OF_LOG, *OF_EACH)
        evidence = LogEvidence(model.robot, recording, choice.reading, recording, (), model, explains)
        known = said[k] if said else ()
        told += [(names[k], finding) for finding in examine(evidence, checks) if finding.code not in known]
        ill.setdefault(kind, any(each.code not in OF_EACH for each in evidence.explanations))
    return together(told)


def _rank(recordings: Sequence[tuple[RecordingChoice, Recording]], k: int) -> tuple[bool, int, int]:
    """Those that train before others, the longest first."""
    choice, recording = recordings[k]
    return choice.role != "train", -recording.samples, k


def _kind(choice: RecordingChoice) -> str:
    """Return what all recordings have in common that are read in the same way."""
    return repr(replace(choice.reading, period=None, start=None, exclude=()))


def diagnosis_record(diagnoses: tuple[Diagnosis, ...]) -> dict[str, Any]:
    """The contents of `doctor --json`."""
    findings = [
        {
            "code": f.code,
            "severity": f.severity,
            "channel": f.channel,
            "evidence": f.evidence,
            "effect": EFFECTS.get(f.code, ""),
            "remedy": f.remedy,
            "recording": each.path,
        }
        for each in diagnoses
        for f in each.findings
    ]
    return {"findings": sorted(findings, key=lambda f: SEVERITIES.index(f["severity"]))}


def has_errors(diagnoses: tuple[Diagnosis, ...]) -> bool:
    """Tell whether anything that was found is an error."""
    return any(f.severity == "error" for each in diagnoses for f in each.findings)


def _finding(error: RecordingError, log: Recording) -> Finding:
    """Return what stopped the reading, as a finding; what has no code is named by what is wrong with the rows."""
    found = CODE.search(error.problem)
    if found is not None:
        code, evidence = found[1], error.problem[: found.start()].strip()
    elif log.time is not None and (np.diff(log.time) <= 0.0).any():
        code, evidence = "clock-jitter", error.problem
    elif "not consecutive" in error.problem:
        code, evidence = "rows-not-consecutive", error.problem
    else:
        raise error
    evidence = evidence.removeprefix(log.source or "The recording").lstrip(": ")
    sentence = evidence.startswith(("the ", "there ", "joint "))  # and not the name of a quantity
    return Finding(code, "error", "", f"{evidence[0].upper()}{evidence[1:]}" if sentence else evidence, error.remedy)


def _worked_around(finding: Finding, log: Recording, reading: LogFormat) -> tuple[Recording, LogFormat] | None:
    """The log with the fault out of the way, for the doctor's eyes; `None` where there is no way."""
    if finding.code == "current-without-gain":
        return replace(log, effort_is_current=False), reading
    said = tables_of(finding.remedy).get("recording", {})
    if finding.code == "clock-missing":
        rate = _implied_rate(log)
        return None if rate is None else (log, replace(reading, rate=rate))
    if "time_unit" in said and log.time is not None:
        return replace(log, time=log.time * said["time_unit"]), reading
    left_out = [name for name, column in said.get("columns", {}).items() if column == "" and name in ("dq", "ddq")]
    if left_out:
        return replace(log, **dict.fromkeys(left_out)), reading
    return (log, replace(reading, **said)) if said else None


def _implied_rate(log: Recording) -> float | None:
    """Samples a second at which velocities are the differences of positions [Hz]."""
    if log.dq is None or not np.isfinite(log.dq).all() or not np.isfinite(log.q).all():
        return None
    step, mean = np.diff(log.q, axis=0), (log.dq[1:] + log.dq[:-1]) / 2
    along, speed = (step * mean).sum(axis=1), (mean**2).sum(axis=1)
    fast = (speed > 0.01 * speed.max()) & (along > 0.0)
    if not fast.any():
        return None
    rate = float(np.median(speed[fast] / along[fast]))
    return rate if np.isfinite(rate) and rate > 0.0 else None


def _reconsidered(evidence: LogEvidence) -> LogEvidence:
    """Angles far outside all limits, and degrees that the model does not believe, are angles of motors."""
    degrees = next((f for f in evidence.noted if f.code == "degrees"), None)
    far = next((f for f in evidence.noted if f.code == "position-offset"), None)
    if degrees is not None and evidence.state is not None and not _believable(evidence.state):
        doubted, why = degrees, "taken as degrees they contradict the torque"
    elif far is not None and _turns_too_far(evidence):
        doubted, why = far, "and its neighbours as far"
    else:
        return evidence
    motor = Finding(
        "motor-side",
        "error",
        "q",
        f"{doubted.evidence.split('; taken')[0].rstrip('.')}; {why}, as motors before their gears do.",
        "find out N with q_motor = N (q - joint_offset), and say it: transmission = [[N1, 0, …], …]",
    )
    noted = tuple(motor if f is doubted else f for f in evidence.noted)
    return replace(evidence, noted=noted, recording=None)


def _turns_too_far(evidence: LogEvidence) -> bool:
    """Tell whether most joints move over a multiple of the span of their limits."""
    recording = evidence.recording
    assert recording is not None  # a finding about limits is made from it
    span = np.array([high - low for low, high in (joint.position_limits for joint in evidence.robot.joints)])
    known = np.isfinite(span) & (span > 0.0)
    moved = np.ptp(recording.q, axis=0)
    return bool(known.any() and np.median(moved[known] / span[known]) > GEARED)


def _believable(state: LogState) -> bool:
    """Tell whether a model explains the log as it is read."""
    if state.nominal is not None:
        loaded = int(np.argmax(state.nominal.size))
        alike = abs(float(state.nominal.correlation[loaded])) > PLAUSIBLE_CORRELATION
        return alike and abs(float(state.nominal.scale[loaded])) > PLAUSIBLE_SCALE
    return state.conflict < PLAUSIBLE_CONFLICT
