"""A remedy applied to a virtual log: what the log then says, and whether that is what the arm did."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.errors import ArmidError, Finding
from armid.measurement.columns.column_selection import assemble, select
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.recording import Recording
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study, build_model
from armid.study.diagnosis import diagnose_recording
from armid.study.remedy_translation import applied, tables_of
from sick import PATTERNS, Case

PATH = "log.csv"

EXACT = 1e-6
"""Relative difference from the truth of what is only renamed, counted otherwise or read in another unit."""

OFFSET = 0.1
"""Error of a zero that still heals [rad]: what the doctor does not mention is up to 0.08."""

TILT = np.radians(6.0)
"""Error of a direction of gravity that still heals [rad]: it says nothing below 8°."""

RATE = 0.02
"""Relative error of a rate that is taken from velocities."""

SAMPLES = 0.2
"""Error of a delay that still heals, in samples."""


def healed(case: Case, remedy: str) -> tuple[Case, ModelChoice, ProcessingOptions]:
    """The case as a study with the remedy reads it, the study's model, and its processing."""
    study = Study(RobotChoice(case.robot.name), ModelChoice(), (RecordingChoice(PATH, reading=case.reading),))
    study = applied(study, PATH, remedy)
    reading = study.recordings[0].reading
    gravity = study.robot.gravity
    robot = case.robot if gravity is None else case.robot.with_gravity(gravity)
    again = replace(case, robot=robot, reading=reading, recording=read_again(case.recording, reading))
    return again, study.model, study.processing


def read_again(log: Recording, reading: LogFormat) -> Recording:
    """Return what a reader makes of a table of the log."""
    table = {} if log.time is None else {"t": log.time}
    for name, pattern in PATTERNS.items():
        values = getattr(log, name)
        if values is not None:
            table |= {pattern.format(j + 1): values[:, j] for j in range(log.n)}
    again = assemble(select(list(table), reading, Path(PATH)), table.__getitem__, reading, Path(PATH))
    return replace(again, valid=log.valid, effort_is_current=log.effort_is_current)


def told_after(case: Case, finding: Finding) -> set[str]:
    """Codes that are still told, but for information, when the remedy of a finding is followed."""
    again, choice, processing = healed(case, finding.remedy)
    model = build_model(again.robot, choice) if choice.terms else None
    found = diagnose_recording(again.robot, again.recording, again.reading, model, processing=processing)
    return {f.code for f in found if f.severity != "info"}


def is_right(case: Case, name: str, findings: tuple[Finding, ...]) -> bool:
    """Tell whether the remedy of a fault whose truth is known gives what the arm did."""
    remedies = [f.remedy for f in findings if f.code == name]
    if name not in TRUE or not remedies:
        return True
    return any(TRUE[name](case, remedy) for remedy in remedies)


def delay_error(case: Case, remedy: str) -> float:
    """Error of a delay, in samples."""
    (told,) = np.asarray(healed(case, remedy)[0].reading.delay)
    return abs(float(told) - case.truth["delay"]) / float(case.motion.time[1])


def _same(case: Case, remedy: str, *, q: float = EXACT) -> bool:
    if not tables_of(remedy):
        return False
    try:
        again, _, _ = healed(case, remedy)
        log = to_robot_convention(again.recording, again.reading, again.robot).recording
    except ArmidError:
        return False
    assert log.effort is not None
    limits = np.array([joint.effort_limit for joint in case.robot.joints])
    # What was drawn as noise is in the log, too: a channel that is another's is off by far more.
    allowed = OTHER * np.abs(case.torque).mean(axis=0) + NOISE * limits
    torque = np.abs(log.effort - case.torque).mean(axis=0) < allowed
    return bool(np.abs(log.q - case.motion.q).max() < q + ENCODER and torque.all())


OTHER = 0.3
"""Share of a joint's torque by which no sound channel is off."""

NOISE, ENCODER = 0.012, 1e-4
"""Noise of torque in limits, a little more than is drawn, and of positions [rad], ten times what is drawn."""


def _gravity(case: Case, remedy: str) -> bool:
    g, true = healed(case, remedy)[0].robot.gravity, case.truth["gravity"]
    return bool(np.arccos(np.clip(g @ true / np.linalg.norm(g) / np.linalg.norm(true), -1.0, 1.0)) < TILT)


def _rate(case: Case, remedy: str) -> bool:
    if remedy.startswith("find out"):
        return case.recording.dq is None
    rate = healed(case, remedy)[0].reading.rate
    return rate is not None and abs(rate * float(case.motion.time[1]) - 1.0) < RATE


def _time_unit(case: Case, remedy: str) -> bool:
    unit = healed(case, remedy)[0].reading.time_unit
    return unit is not None and abs(unit / case.truth["unit"] - 1.0) < SCALE


SCALE = 0.05
"""Relative error of a unit of time that is estimated from the dynamics: ten times what is found without friction that
the model lacks."""


def _delay(case: Case, remedy: str) -> bool:
    return delay_error(case, remedy) < SAMPLES


def _offset(case: Case, remedy: str) -> bool:
    return _same(case, remedy, q=OFFSET)


TRUE: dict[str, Any] = {
    "torque-sign": _same,
    "position-sign": _same,
    "joint-order": _same,
    "degrees": _same,
    "position-offset": _offset,
    "gravity-direction": _gravity,
    "clock-missing": _rate,
    "clock-unit": _same,
    "time-scale": _time_unit,
    "channel-delay": _delay,
    "torque-gain": _same,
}
"""Faults whose remedy has one truth, and how a remedy is compared with it."""
