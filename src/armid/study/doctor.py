"""The doctor on a study: every recording as it stands, what stops the reading worked around."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.errors import Finding, RecordingError
from armid.measurement.interpret import interpret
from armid.measurement.readers import load_recording
from armid.measurement.reading import Reading
from armid.measurement.recording import Recording
from armid.model.dynamics import DynamicsModel
from armid.robot import Robot
from armid.study.plausibility import gravity_finding
from armid.study.study import RecordingChoice, Study, build_model, load_choice
from armid.validation.doctor import EFFECTS, EXPLAINS, SEVERITIES, Evidence, examine
from armid.validation.doctor.state import State

__all__ = ["Diagnosis", "diagnose", "diagnose_recording", "diagnosis_record", "is_ill", "watch"]

CODE = re.compile(r"\[([a-z-]+)\]$")
"""Where an error about a recording ends with the code of its finding."""

TRIES = 4
"""Faults in a row that are worked around to see what lies behind them."""

PLAUSIBLE_CONFLICT, PLAUSIBLE_CORRELATION, PLAUSIBLE_SCALE = 0.6, 0.7, 0.3
"""Conflict between joints up to which, and correlation with and share of the description from which, angles read
as degrees are believed to be degrees: motors' angles are not, whatever limits they stay in."""


OF_LOG = ("channel-dead", "saturation", "filtered-before-logging", "velocity-mismatch")
"""Checks of every log that an identification makes; gaps, unevenness and repetitions it reports as it processes."""

OF_MODEL = (
    "motor-side",
    "degrees",
    "torque-sign",
    "joint-order",
    "gravity-direction",
    "channel-delay",
    "position-offset",
    "rotor-inertia-missing",
    "temperature-drift",
    "contact",
)
"""Checks beside a model that it makes, once for each way of reading: what a reading says of signs, order, units,
zeros and sides holds for all logs that are read so. Excitation it judges by all recordings together."""

GEARED = 3.0
"""Span of the motion, in spans of the limits, from which it is that of motors."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What was found on one recording.

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
    for choice in {each.path: each for each in study.recordings}.values():
        raw = (given or {}).get(choice.path)
        if raw is None:
            raw = load_recording(Path(study.folder) / choice.path, choice.reading)
        result.append(Diagnosis(choice.path, diagnose_recording(robot, raw, choice.reading, model)))
    return tuple(result)


def diagnose_recording(
    robot: Robot, raw: Recording, reading: Reading, model: DynamicsModel | None = None
) -> tuple[Finding, ...]:
    """Examine one recording.

    What stops the reading is an error; where it can be worked around, for the eyes of the doctor alone, the rest
    of the log is examined too.

    Args:
        robot: The arm that was recorded.
        raw: As the file has it.
        reading: How it is read.
        model: The study's model; the usual terms if not given.

    Raises:
        RecordingError: The recording does not fit the robot at all.
    """
    noted: list[Finding] = [*robot.findings]
    gravity = gravity_finding(robot)
    noted += [] if gravity is None else [gravity]
    if raw.effort is None:
        remedy = 'columns = { effort = "tau{}" }  # what its columns are called'
        noted.append(Finding("channel-dead", "error", "effort", "There is no effort in the recording.", remedy))
    log, recording = raw, None
    for _ in range(TRIES):
        try:
            read = interpret(log, reading, robot)
        except RecordingError as error:
            finding = _finding(error, log)
            noted.append(finding)
            around = _worked_around(finding.code, log, reading)
            if around is None:
                break
            log, reading = around
        else:
            recording = read.recording
            noted += read.findings
            break
    evidence = Evidence(robot, raw, reading, recording, tuple(noted), model, EXPLAINS)
    if any(f.code == "current-without-gain" and f.severity == "error" for f in noted):
        evidence = replace(evidence, explains=())
        kept = {"channel-dead", "clock-gap", "clock-jitter", "saturation", "velocity-mismatch", "period-misaligned"}
        early = replace(evidence, recording=recording)
        return tuple(f for f in examine(early) if f in noted or f.code in kept)
    return examine(_reconsidered(evidence))


def watch(model: DynamicsModel, recordings: Sequence[tuple[RecordingChoice, Recording]]) -> tuple[Finding, ...]:
    """What the doctor says while a study is identified, before anything is estimated.

    Args:
        model: Arm and torque terms of the study.
        recordings: As read, with their roles.
    """
    found: dict[tuple[str, str], Finding] = {}
    shown = _one_of_each_reading(recordings)
    for k, (choice, recording) in enumerate(recordings):
        evidence = Evidence(model.robot, recording, choice.reading, recording, (), model, EXPLAINS)
        where = f"{Path(choice.path).name}: " if len(recordings) > 1 else ""
        for finding in examine(evidence, OF_LOG + (OF_MODEL if k in shown else ())):
            said = replace(finding, evidence=f"{where}{finding.evidence}")
            found.setdefault((finding.code, finding.channel), said)
    return tuple(found.values())


def _one_of_each_reading(recordings: Sequence[tuple[RecordingChoice, Recording]]) -> set[int]:
    """The longest recording of each way of reading, those that train before others."""
    chosen: dict[str, int] = {}
    rank = [(choice.role != "train", -recording.samples, k) for k, (choice, recording) in enumerate(recordings)]
    for _, _, k in sorted(rank):
        reading = replace(recordings[k][0].reading, period=None, start=None, exclude=())
        chosen.setdefault(repr(reading), k)
    return set(chosen.values())


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


def is_ill(diagnoses: tuple[Diagnosis, ...]) -> bool:
    """Whether anything that was found is an error."""
    return any(f.severity == "error" for each in diagnoses for f in each.findings)


def _finding(error: RecordingError, log: Recording) -> Finding:
    """What stopped the reading, as a finding; what has no code is named by what is wrong with the rows."""
    found = CODE.search(error.problem)
    if found is not None:
        code, evidence = found[1], error.problem[: found.start()].strip()
    elif log.time is not None and (np.diff(log.time) <= 0.0).any():
        code, evidence = "clock-jitter", error.problem
    elif any(x is not None and not np.isfinite(x).all() for x in (log.q, log.dq, log.ddq, log.effort)):
        code, evidence = "channel-dead", error.problem
    elif "rate says" in error.problem or "seems not to count seconds" in error.problem:
        code, evidence = "clock-jitter", error.problem
    elif "not consecutive" in error.problem:
        code, evidence = "rows-not-consecutive", error.problem
    else:
        raise error
    evidence = evidence.removeprefix(log.source or "The recording").lstrip(": ")
    return Finding(code, "error", "", f"{evidence[:1].upper()}{evidence[1:]}", error.remedy)


def _worked_around(code: str, log: Recording, reading: Reading) -> tuple[Recording, Reading] | None:
    """The log with the fault out of the way, for the doctor's eyes; `None` where there is no way."""
    if code == "clock-missing":
        rate = _implied_rate(log)
        return None if rate is None else (log, replace(reading, rate=rate))
    if code == "degrees":
        return log, replace(reading, units="deg")
    if code == "current-without-gain":
        return replace(log, effort_is_current=False), reading
    if code == "channel-dead":
        for name in ("dq", "ddq"):
            values = getattr(log, name)
            if values is not None and (np.ptp(values, axis=0) == 0.0).any():
                return replace(log, **{name: None}), reading
    return None


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


def _reconsidered(evidence: Evidence) -> Evidence:
    """Angles far outside all limits, and degrees that the model does not believe, are angles of motors."""
    degrees = next((f for f in evidence.noted if f.code == "degrees"), None)
    far = next((f for f in evidence.noted if f.code == "position-offset"), None)
    if degrees is not None and (evidence.state is None or not _believable(evidence.state)):
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
        "transmission = [[…]]  # N with q_motor = N (q - joint_offset)",
    )
    noted = tuple(motor if f is doubted else f for f in evidence.noted)
    return replace(evidence, noted=noted, recording=None)


def _turns_too_far(evidence: Evidence) -> bool:
    """Whether most joints move over a multiple of the span of their limits."""
    recording = evidence.recording
    assert recording is not None  # a finding about limits is made from it
    span = np.array([high - low for low, high in (joint.position_limits for joint in evidence.robot.joints)])
    known = np.isfinite(span) & (span > 0.0)
    moved = np.ptp(recording.q, axis=0)
    return bool(known.any() and np.median(moved[known] / span[known]) > GEARED)


def _believable(state: State) -> bool:
    """Whether a model explains the log as it is read."""
    if state.nominal is not None:
        loaded = int(np.argmax(state.nominal.size))
        alike = abs(float(state.nominal.correlation[loaded])) > PLAUSIBLE_CORRELATION
        return alike and abs(float(state.nominal.scale[loaded])) > PLAUSIBLE_SCALE
    return state.conflict < PLAUSIBLE_CONFLICT
