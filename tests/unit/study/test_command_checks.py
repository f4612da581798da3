"""Findings about commands and gaps of the clock before servos are identified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.measurement.recording import Recording, select_rows
from armid.study.config import RecordingChoice
from armid.study.servos.command_checks import command_findings
from servo_labs import any_parameters, recorded, servo_model, small_arm

LOST = 9
"""Rows that are lost: 0.2 s at 50 Hz."""


@pytest.fixture(scope="module")
def recording() -> Recording:
    rng, model = np.random.default_rng(5), servo_model(small_arm())
    run = recorded(model, any_parameters(model, rng), rng, 6.0)
    return Recording(q=run.q, command=run.held(run.time), time=run.time, source="log.csv")


def codes(recording: Recording) -> list[str]:
    return [each.code for each in command_findings(small_arm(), [(RecordingChoice("log.csv"), recording)])]


def test_a_whole_recording_has_no_finding(recording: Recording):
    assert codes(recording) == []


def test_lost_rows_are_told(recording: Recording):
    rows = np.arange(recording.samples)
    assert codes(select_rows(recording, (rows < 150) | (rows >= 150 + LOST))) == ["clock-gap"]


def test_uneven_steps_are_not(recording: Recording):
    assert recording.time is not None
    shifted = recording.time + 0.002 * np.random.default_rng(1).uniform(-1.0, 1.0, recording.samples)
    assert codes(replace(recording, time=shifted)) == []
