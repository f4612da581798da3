"""Rests of the whole arm in a log: what is said of them agrees with what an identification does with them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.recording import Recording
from armid.model.motion import Motion
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.diagnosis import diagnose
from armid.study.identify import identify
from armid.study.remedy_translation import applied
from labs import small_model, small_truth, write_arm

RATE, MOVE, REST, TIMES = 100.0, 8.0, 2.0, 4


def log() -> Recording:
    """The same motion four times, from rest to rest, with two seconds of rest behind each."""
    t = np.arange(0.0, MOVE + REST, 1.0 / RATE)
    s = np.minimum(t / MOVE, 1.0)
    phase = 2.0 * np.pi * (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)
    once = np.stack([np.sin(phase) + 0.4 * np.sin((j + 2) * phase) for j in range(3)], axis=1)
    q = np.tile(once, (TIMES, 1))
    q = np.round(q / 1e-5) * 1e-5  # an encoder, which stands still with the arm
    dq = np.gradient(q, 1.0 / RATE, axis=0)
    time = np.arange(len(q)) / RATE
    torque = small_model().torque(Motion(time, q, dq, np.gradient(dq, 1.0 / RATE, axis=0)), small_truth())
    torque += 0.05 * np.random.default_rng(0).normal(size=q.shape)
    return Recording(time, q, effort=torque, joint_names=small_model().robot.joint_names, source="log", sha256="0")


def study(folder: Path) -> Study:
    return Study(RobotChoice(str(write_arm(folder))), ModelChoice(), (RecordingChoice("log"),))


def test_rests_of_a_repeated_motion_are_told_as_what_they_are(tmp_path: Path):
    (doctor,) = diagnose(study(tmp_path), given={"log": log()})[0].findings
    assert (doctor.code, doctor.severity) == ("standstill", "info")
    assert f"the longest of {TIMES} rests of 1 s or more" in doctor.evidence and "of 40.0 s" in doctor.evidence
    found = {f.code: f for f in identify(study(tmp_path), given={"log": log()}).estimate.findings}
    assert {"standstill", "period-found"} <= found.keys()
    assert f"repeat every {MOVE + REST:g} s, {TIMES} times" in found["period-found"].evidence
    assert "rests are used, because they show gravity" in found["standstill"].evidence


def test_the_remedy_leaves_out_all_rests_and_keeps_the_repetitions(tmp_path: Path):
    (told,) = diagnose(study(tmp_path), given={"log": log()})[0].findings
    without = applied(study(tmp_path), "log", told.remedy)
    kept = identify(study(tmp_path), given={"log": log()})
    moving = identify(without, given={"log": log()})
    assert {"period-found", "rests-left-out"} <= {f.code for f in moving.estimate.findings}
    # Rests are a fifth of the log, and a joint is slow just before and after them.
    assert (moving.estimate.fit.rows < 0.82 * kept.estimate.fit.rows).all()


def test_a_log_at_rest_alone_is_an_error_and_no_repetition(tmp_path: Path):
    still = replace(log(), q=np.tile(log().q[:1], (len(log().q), 1)))
    (found,) = diagnose(study(tmp_path), given={"log": still})[0].findings
    assert (found.code, found.severity) == ("standstill", "error")
    with pytest.raises(RecordingError, match="stands still"):
        identify(study(tmp_path), given={"log": still})
