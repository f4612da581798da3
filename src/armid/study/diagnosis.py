"""Checks of the recordings of a study by the doctor; a fault that prevents reading is bypassed if possible."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armid.doctor import CHECKS, SEVERITIES, LogEvidence, checks_of, effects, examine, explanations_of
from armid.doctor.check_definition import Scope
from armid.doctor.checks.signals.motor_side import explain as explain_scale
from armid.doctor.earlier_run_links import KnownLinks
from armid.doctor.position_unit import reconsidered
from armid.errors import ArmidError, EstimationError, Finding, RecordingError
from armid.measurement.convention_conversion import to_robot_convention, understood
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import process_recording
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.remedy import Remedy
from armid.robot import Robot
from armid.study.config import RecordingChoice, Study, build_model, load_choice
from armid.study.recordings.labels import labels, together
from armid.study.recordings.reading import recording_as_logged
from armid.study.remedy_translation import tables_of
from armid.threads import one_blas_thread
from armid.validation.gravity_sign import gravity_finding

TRIES = 4
"""Largest number of faults of one recording for which workarounds are tried one after the other."""

USUAL = ProcessingOptions()
"""Default processing options."""

FAR_OUTSIDE = ("position-limits", "position-sign", "position-offset", "degrees", "joint-order")
"""Codes of the doctor's findings that give the cause of positions far outside the joint limits. The reader of
recordings only warns of such positions, without a cause."""


LOSS_OF_ROWS = ("clock-gap", "run-short", "rows-repeated", "saturation")
"""Codes of findings about rows that cannot be used, which may be why the data do not determine the parameters."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Findings on one recording.

    Attributes:
        path: Path of the recording.
        findings: Findings on the recording, errors first.
    """

    path: str
    findings: tuple[Finding, ...]


def diagnose(study: Study, *, given: Mapping[str, Recording] | None = None) -> tuple[Diagnosis, ...]:
    """Checks the whole length of every recording of a study.

    Args:
        study: The study.
        given: Recordings that are in memory already, by their path in the study.

    Raises:
        ArmidError: The robot or a file does not exist, or a file cannot be read at all.
    """
    robot = load_choice(study.robot, study.folder)
    model = build_model(robot, study.model) if study.model.terms else None
    result: list[Diagnosis] = []
    for choice in {(each.path, repr(each.reading)): each for each in study.recordings}.values():
        raw = recording_as_logged(choice, study.folder, robot, given)
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
    """Checks one recording.

    A fault that prevents reading becomes a finding of severity `error`. If there is a workaround for the fault, the
    rest of the log is checked, too.

    Args:
        robot: The arm that was recorded.
        raw: The recording as logged.
        reading: Log format.
        model: Model of the study; if not given, the usual terms are assumed: rigid bodies, viscous and Coulomb
            friction, offset and rotor inertia.
        processing: Options of the study; they determine which rows are used near effort limits and at standstill.

    Raises:
        RecordingError: The recording does not fit the robot at all.
    """
    noted: list[Finding] = [*robot.findings]
    gravity = gravity_finding(robot)
    noted += [] if gravity is None else [gravity]
    if raw.effort is None:
        noted.append(_no_effort(raw))
    log, how, recording = raw, understood(raw, reading), None
    for _ in range(TRIES):
        try:
            read = to_robot_convention(log, how, robot)
        except RecordingError as error:
            if not error.code:
                raise
            finding = _finding(error)
            noted += [*log.findings, finding]
            around = _worked_around(finding, log, how)
            if around is None:
                break
            log, how = around
        else:
            recording = read.recording
            told = [each for each in read.findings if each.code != "effort-possible"]  # said with the error
            noted += [*told, *_standstill(recording, processing)]
            break
    evidence = LogEvidence(robot, raw, how, recording, tuple(noted), model, explanations_of())
    evidence = replace(evidence, saturation=processing.saturation, cutoff=_cutoff(processing))
    if any(f.code == "current-without-gain" and f.severity == "error" for f in noted):
        return _of_currents(evidence)
    found = examine(reconsidered(evidence))
    return tuple(finding for _, finding in _told_once([(0, finding) for finding in found]))


def _no_effort(raw: Recording) -> Finding:
    """Finding for a log without effort, with the columns that may contain the effort."""
    possible = next((each for each in raw.findings if each.code == "effort-possible"), None)
    commanded = "" if raw.command is None else ", but it has a command: `armid servo` identifies arms without torque"
    evidence = f"The recording has no effort (torque or motor current){commanded}." + (
        "" if possible is None else f" {possible.evidence}"
    )
    remedy = "" if possible is None else possible.remedy
    if raw.command is not None:
        remedy = remedy or "identify the arm with `armid servo`"
    remedy = remedy or (
        "log the torque or motor current of each joint; if the file has these columns, give their names with the key "
        "`columns` of the recording"
    )
    return Finding("effort-missing", "error" if raw.command is None else "info", "effort", evidence, remedy)


def _standstill(recording: Recording, processing: ProcessingOptions) -> list[Finding]:
    """Findings about joints that rest while others move, and about rests of the arm; empty if processing fails."""
    plain = replace(processing, edges="drop", average=False, saturation=None)
    try:
        found = process_recording(recording, plain)[1]
    except ArmidError:
        return []
    told = [each for each in found if each.code in ("sticking", "rests-left-out")]
    return [replace(each, channel="") if each.channel == recording.source else each for each in told]


def _of_currents(evidence: LogEvidence) -> tuple[Finding, ...]:
    """Findings about a log of motor currents without drive gains: those so far, and of checks without torque."""
    state = evidence.state
    scale = None if state is None else explain_scale(state)
    if scale is not None:
        remedy = scale.remedy(evidence)
        with_remedy = [replace(f, remedy=remedy) if f.code == "current-without-gain" else f for f in evidence.noted]
        evidence = replace(evidence, noted=tuple(with_remedy))
    evidence = replace(evidence, explains=())
    applicable = {"motor-side", *(finding.code for finding in evidence.noted)}  # positions of motors
    applicable |= {code for check in CHECKS.values() if not check.needs_torque for code in check.effects}
    return tuple(f for f in examine(evidence) if f.code in applicable)


def findings_of_each(
    model: DynamicsModel,
    recordings: Sequence[tuple[RecordingChoice, Recording]],
    read: Sequence[Sequence[Finding]],
    trained: Sequence[Finding] = (),
    known_links: KnownLinks | None = None,
    processing: ProcessingOptions = USUAL,
) -> list[tuple[int, Finding]]:
    """Findings of the reader and of the doctor, each with the index of its recording.

    Args:
        model: Arm and torque terms.
        recordings: Recordings with their roles.
        read: Findings of the reader on each recording.
        trained: Findings about all training recordings together; they are not repeated for single recordings.
        known_links: Inertial parameters of the links that are compared with the recordings, instead of those of the
            description.
        processing: Options of the study.
    """
    common = {finding.code for finding in trained if finding.severity != "info"}
    known_codes = [
        {finding.code for finding in found if finding.severity != "info"} - {"position-offset"}
        | (common if c.role == "train" else set())
        for (c, _), found in zip(recordings, read, strict=True)
    ]
    of_readers = [(k, finding) for k, found in enumerate(read) for finding in found]
    kinds = [_kind(choice) for choice, _ in recordings]
    told = run_checks(model, recordings, known_codes, known_links, processing)
    return _told_once([*of_readers, *told], kinds)


def merged(recordings: Sequence[RecordingChoice], findings: Sequence[tuple[int, Finding]]) -> list[Finding]:
    """Findings with the names of their recordings; equal findings on several recordings become one finding."""
    names = labels(recordings)
    return together((names[k], finding) for k, finding in findings)


@one_blas_thread
def run_checks(
    model: DynamicsModel,
    recordings: Sequence[tuple[RecordingChoice, Recording]],
    known_codes: Sequence[Collection[str]] = (),
    known_links: KnownLinks | None = None,
    processing: ProcessingOptions = USUAL,
) -> list[tuple[int, Finding]]:
    """Checks the recordings of an identification before the estimate, or the recordings of a finished run.

    Args:
        model: Arm and torque terms of the study.
        recordings: Recordings with their roles.
        known_codes: Codes of findings that are already reported for each recording.
        known_links: Inertial parameters of the links that are compared with the recordings, instead of those of the
            description.
        processing: Options of the study.

    Returns:
        Findings, each with the index of its recording.
    """
    result: list[tuple[int, Finding]] = []
    faulty: dict[str, bool] = {}
    each_alone: tuple[Scope, ...] = ("recording",)
    # The log format is checked on the first recording of each kind; the others are checked for faults of their own.
    # Validation recordings get all checks: their format may be wrong although it is right for the training ones.
    for k in sorted(range(len(recordings)), key=lambda k: _rank(recordings, k)):
        choice, recording = recordings[k]
        kind = _kind(choice)
        explains, checks = explanations_of(), checks_of(("recording", "format"))
        if kind in faulty and choice.role == "train":
            explains, checks = explains if faulty[kind] else explanations_of(each_alone), checks_of(each_alone)
        evidence = LogEvidence(model.robot, recording, choice.reading, recording, (), model, explains)
        evidence = replace(evidence, saturation=processing.saturation, cutoff=_cutoff(processing), known=known_links)
        evidence = reconsidered(evidence)
        known = known_codes[k] if known_codes else ()
        found = (*evidence.noted, *examine(evidence, checks))
        result += [(k, finding) for finding in found if finding.code not in known]
        own = {code for name in checks_of(each_alone) for code in CHECKS[name].effects}
        told = (*evidence.noted, *evidence.explanations)
        faulty.setdefault(kind, any(each.code not in own for each in told))
    return result


def _cutoff(processing: ProcessingOptions) -> float | None:
    """Cut-off frequency of a study [Hz]; `None` if it follows from the motion, or if nothing is filtered."""
    return None if processing.cutoff == "auto" or processing.family == "none" else processing.cutoff


def _rank(recordings: Sequence[tuple[RecordingChoice, Recording]], k: int) -> tuple[bool, int, int]:
    """Sort key: training recordings first, longer recordings before shorter ones."""
    choice, recording = recordings[k]
    return choice.role != "train", -recording.samples, k


def _kind(choice: RecordingChoice) -> str:
    """Text that is equal for recordings of one log format; period, start and excluded intervals may differ."""
    return repr(replace(choice.reading, period=None, start=None, exclude=()))


def diagnosis_record(diagnoses: tuple[Diagnosis, ...]) -> dict[str, Any]:
    """Content of the output of `armid doctor --json`: the findings on all recordings, errors first."""
    effect_of = effects()
    findings = [
        {
            "code": f.code,
            "severity": f.severity,
            "channel": f.channel,
            "evidence": f.evidence,
            "effect": effect_of.get(f.code, ""),
            "remedy": f.remedy,
            "recording": each.path,
        }
        for each in diagnoses
        for f in each.findings
    ]
    return {"findings": sorted(findings, key=lambda f: SEVERITIES.index(f["severity"]))}


def diagnosed_error(error: EstimationError, findings: Sequence[Finding]) -> EstimationError:
    """Estimation error whose text also states the likely causes: errors that the doctor found, and lost rows."""
    errors = [finding for finding in findings if finding.severity == "error"]
    lost = [finding for finding in findings if finding.severity == "warning" and finding.code in LOSS_OF_ROWS]
    if not errors and not lost:
        return error
    problem = " ".join([error.problem, *(f"[{finding.code}] {finding.evidence}" for finding in (*errors, *lost))])
    remedy = Remedy.joined(finding.remedy for finding in errors) if errors else error.remedy
    return EstimationError(problem, possible=error.possible, remedy=remedy)


def has_errors(diagnoses: tuple[Diagnosis, ...]) -> bool:
    """True if any finding on any recording has the severity `error`."""
    return any(f.severity == "error" for each in diagnoses for f in each.findings)


def _finding(error: RecordingError) -> Finding:
    """Converts the error that the reader raised about a recording to a finding of severity `error`."""
    evidence = error.evidence
    if error.code != "value-missing":  # that sentence begins with the name of a channel
        evidence = f"{evidence[0].upper()}{evidence[1:]}"
    return Finding(error.code, "error", "", evidence, error.remedy)


def _worked_around(finding: Finding, log: Recording, reading: LogFormat) -> tuple[Recording, LogFormat] | None:
    """Log and log format that are changed so that the rest of the log can be checked in spite of a fault.

    The result is `None` if no such change is known.
    """
    if finding.code == "current-without-gain":
        return replace(log, effort_is_current=False), reading
    keys = tables_of(finding.remedy).get("recording", {})
    if finding.code == "clock-missing":
        rate = _implied_rate(log)
        return None if rate is None else (log, replace(reading, rate=rate))
    if keys.get("columns", {}).get("time") == "" and "rate" in keys:
        return replace(log, time=None), replace(reading, rate=keys["rate"])
    if "time_unit" in keys and log.time is not None:
        return replace(log, time=log.time * (keys["time_unit"] / reading.clock_unit)), reading
    left_out = [name for name, column in keys.get("columns", {}).items() if column == "" and name in ("dq", "ddq")]
    if left_out:
        return replace(log, **dict.fromkeys(left_out)), reading
    return (log, replace(reading, **keys)) if keys else None


def _implied_rate(log: Recording) -> float | None:
    """Sample rate [Hz] at which the logged velocities agree with differences of the positions; `None` if unknown."""
    if log.dq is None or not np.isfinite(log.dq).all() or not np.isfinite(log.q).all():
        return None
    step, mean = np.diff(log.q, axis=0), (log.dq[1:] + log.dq[:-1]) / 2
    along, speed = (step * mean).sum(axis=1), (mean**2).sum(axis=1)
    fast = (speed > 0.01 * speed.max()) & (along > 0.0)
    if not fast.any():
        return None
    rate = float(np.median(speed[fast] / along[fast]))
    return rate if np.isfinite(rate) and rate > 0.0 else None


def _told_once(findings: Sequence[tuple[int, Finding]], kinds: Sequence[str] = ("",)) -> list[tuple[int, Finding]]:
    """Leaves out the reader's warnings about positions far outside the limits if another finding gives the cause.

    Args:
        findings: Findings, each with the index of its recording.
        kinds: Log format of each recording; a cause that is known for one recording is known for all recordings with
            this format.
    """
    known = [(kinds[k], finding) for k, finding in findings]
    return [
        (k, finding)
        for k, finding in findings
        if (finding.code, finding.severity) != ("position-offset", "warning")
        or not any(kind == kinds[k] and _says_why(cause) for kind, cause in known)
    ]


def _says_why(cause: Finding) -> bool:
    """True if a finding gives the cause of positions far outside the limits."""
    severities = ("error", "warning") if cause.code == "joint-order" else ("error",)
    return cause.code in FAR_OUTSIDE and cause.severity in severities
