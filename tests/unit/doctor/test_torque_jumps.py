"""Torques that jump from one row to the next and stay there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from armid.doctor.changes.torque_jumps import torque_jumps
from armid.measurement.recording import Recording
from armid.study.diagnosis import diagnose_recording
from sick import sound

RATE = 200.0


def recording(seed: int = 0) -> tuple[Recording, NDArray[np.bool_]]:
    """A log of two joints with noise of 1 % of the torque, and the mask of rows in which both joints move."""
    t = np.arange(round(20.0 * RATE)) / RATE
    q = np.column_stack([np.sin(0.7 * t), np.cos(1.1 * t)])
    dq = np.column_stack([0.7 * np.cos(0.7 * t), -1.1 * np.sin(1.1 * t)])
    torque = 20.0 * q + 3.0 * np.tanh(dq / 0.02)
    torque = torque + 0.2 * np.random.default_rng(seed).normal(size=torque.shape)
    return Recording(time=t, q=q, effort=torque, source="log"), np.asarray((np.abs(dq) > 0.3).all(axis=1))


def shifted(log: Recording, rows: list[int], sizes: list[float]) -> Recording:
    """The log with the torque of the first joint shifted by these sizes from these rows on."""
    assert log.effort is not None
    effort = log.effort.copy()
    for row, size in zip(rows, sizes, strict=True):
        effort[row:, 0] += size
    return replace(log, effort=effort)


def moving_rows(moving: NDArray[np.bool_], count: int) -> list[int]:
    """Rows far from each other, from rests and from the ends."""
    inside = [k for k in range(50, len(moving) - 50) if moving[k - 10 : k + 10].all()]
    return [inside[k] for k in np.linspace(0, len(inside) - 1, count).astype(int)]


@pytest.mark.parametrize("count", [1, 5])
def test_jumps_are_found_where_they_are(count: int):
    log, moving = recording()
    rows, sizes = moving_rows(moving, count), [12.0, -11.0, 13.0, -12.0, 10.0][:count]
    (found,) = torque_jumps(shifted(log, rows, sizes))
    assert found.joint == 0 and list(found.rows) == [row - 1 for row in rows]
    assert found.sizes == pytest.approx(sizes, abs=1.0)  # five standard deviations of the noise of a step


@pytest.mark.parametrize("seed", range(5))
def test_noise_and_reversals_are_no_jumps(seed: int):
    assert torque_jumps(recording(seed)[0]) == []


def test_spikes_jumps_at_rest_and_gaps_are_no_jumps():
    log, moving = recording()
    assert log.effort is not None and log.time is not None
    row = moving_rows(moving, 3)[1]
    spike = log.effort.copy()
    spike[row, 0] += 50.0
    assert torque_jumps(replace(log, effort=spike)) == []
    reversal = int(np.argmin(np.abs(log.time - np.pi / 2.0 / 0.7)))  # the first joint reverses
    assert torque_jumps(shifted(log, [reversal], [8.0])) == []
    later = np.where(np.arange(len(log.time)) >= row, log.time + 5.0, log.time)
    assert torque_jumps(replace(shifted(log, [row], [8.0]), time=later)) == []
    assert torque_jumps(replace(log, effort=None)) == []


@pytest.mark.parametrize("seed", range(1, 9))
def test_sound_logs_have_none(seed: int):
    assert torque_jumps(sound(seed).recording) == []


def test_a_torque_whose_zero_is_set_anew_several_times_is_named_with_its_times():
    case = sound(11, name="ur10e")
    effort, time = case.recording.effort, case.recording.time
    assert effort is not None and time is not None
    starts = np.arange(6) * len(effort) // 6
    tared = effort.copy()
    tared[:, 2] += np.repeat([0.0, 40.0, -5.0, 35.0, -10.0, 30.0], np.diff(starts, append=len(effort)))
    found = diagnose_recording(case.robot, case.logged(effort=tared).recording, case.reading)
    named = [f for f in found if f.code == "changes-midway" and f.channel == case.robot.joint_names[2]]
    assert any(f"{time[starts[1] - 1]:.2f}, {time[starts[2] - 1]:.2f}" in f.evidence for f in named)
    sound_log = diagnose_recording(case.robot, case.recording, case.reading)
    assert not [f for f in sound_log if f.code == "changes-midway"]
