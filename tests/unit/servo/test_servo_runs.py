"""Runs of recordings with commands."""

from __future__ import annotations

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.recording import Recording
from armid.servo.servo_run import servo_runs

T = 0.02 * np.arange(400)
Q = np.column_stack([np.sin(T), np.cos(T)])


def test_a_gap_and_masked_rows_split_a_recording():
    time = np.where(T > 3.0, T + 0.5, T)
    valid = np.ones((400, 2), dtype=bool)
    valid[100, 0] = False  # one row is like a lost sample, and does not split
    valid[300:303, 1] = False
    runs = servo_runs(Recording(time, Q, command=Q + 0.1, valid=valid))
    assert [round(run.start, 6) for run in runs] == [0.0, 3.52, 6.56]
    # At the sample that is lost, the position is interpolated and the command before it is held: 0.02 rad at most.
    assert all(np.abs(run.held(run.time) - run.q - 0.1).max() < 0.021 for run in runs)


def test_jitter_is_interpolated_and_commands_keep_their_times():
    rng = np.random.default_rng(0)
    time = T + rng.uniform(-0.004, 0.004, 400)
    (run,) = servo_runs(Recording(time, np.column_stack([np.sin(time), np.cos(time)]), command=Q))
    assert np.array_equal(run.command_time, time)
    # Linear interpolation over a step h has an error of h² / 8 times the second derivative, here 1.
    assert np.abs(run.q[:, 0] - np.sin(run.time)).max() < 0.03**2 / 8.0
    assert abs(run.dq[0] - np.cos(run.time[2])) < 1e-3


def test_the_command_is_held():
    (run,) = servo_runs(Recording(T, Q, command=Q))
    assert np.array_equal(run.held(np.array([T[5] + 0.019]))[0], Q[5])


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"command": None}, "has no commanded positions"),
        ({"time": None}, "has no clock"),
        ({"valid": np.arange(400) % 20 > 2}, r"no part of 1 s without a gap"),
    ],
)
def test_what_is_missing_is_named(changes, text):
    made = {"time": T, "q": Q, "command": Q, **changes}
    with pytest.raises(RecordingError, match=text):
        servo_runs(Recording(**made))


def test_a_rate_replaces_a_clock():
    (run,) = servo_runs(Recording(None, Q, command=Q, rate=50.0))
    assert run.step == pytest.approx(0.02)
