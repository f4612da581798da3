"""Torques that do not follow each other in time: most of them jump at the same rows while the joints move on."""

from __future__ import annotations

import numpy as np
import pytest

from armid.doctor.changes.torque_jumps import common_jumps
from armid.study.diagnosis import diagnose_recording
from sick import Case, sound

CODE = "rows-not-consecutive"

SEEDS = (3, 4, 11)


PACKET = 0.2
"""Length of a packet [s]."""


NOISE = 2e-3
"""Noise of the torques, relative to their standard deviations."""


def length(case: Case) -> int:
    """Rows of a packet."""
    return round(PACKET / float(np.median(np.diff(case.motion.time))))


def packets_swapped(case: Case) -> Case:
    """The log with little noise whose torques stand in packets, every other pair of which is in the wrong order."""
    noise = np.random.default_rng(0).standard_normal(case.torque.shape)
    effort, rows = case.torque + NOISE * case.torque.std(axis=0) * noise, length(case)
    order = np.arange(len(effort))
    for start in range(0, len(order) - 2 * rows, 4 * rows):
        order[start : start + 2 * rows] = np.roll(order[start : start + 2 * rows], rows)
    return case.logged(effort=effort[order])


def at_corners(case: Case) -> Case:
    """The log of a motion whose accelerations step together, five times a second, with the torques of it."""
    time = case.motion.time
    q, slope = case.recording.q.copy(), np.zeros_like(case.recording.q[0])
    steps = np.where(np.floor(time * 5.0) % 2 == 0.0, 1.0, -1.0)
    rate = 1.0 / float(np.median(np.diff(time)))
    speed = 1.0 + np.cumsum(steps - steps.mean()) / rate
    q = q[0] + np.outer(np.cumsum(speed) / rate, 0.2 * np.ones_like(slope))
    torque = 3.0 + steps[:, None] * np.linspace(1.0, 2.0, q.shape[1]) + np.zeros_like(q)
    noise = np.random.default_rng(1).standard_normal(q.shape)
    return case.logged(q=q, dq=None, ddq=None, effort=torque + 0.01 * noise)


@pytest.mark.parametrize("seed", SEEDS)
def test_swapped_packets_of_torques_are_named(seed: int):
    case = packets_swapped(sound(seed))
    found = diagnose_recording(case.robot, case.recording, case.reading)
    assert CODE in {f.code for f in found if f.channel == "effort"}


@pytest.mark.parametrize("seed", SEEDS)
def test_jumps_are_found_where_they_are(seed: int):
    case = packets_swapped(sound(seed))
    rows = common_jumps(case.recording)
    assert len(rows) and ((rows + 1) % length(case) == 0).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_torques_of_a_sound_log_do_not_jump_together(seed: int):
    assert not len(common_jumps(sound(seed).recording))


def test_torques_that_step_with_the_accelerations_are_sound():
    case = at_corners(sound(4))
    assert not len(common_jumps(case.recording))


def test_the_torque_of_one_joint_that_jumps_is_no_jump_of_all():
    case = sound(4)
    assert case.recording.effort is not None
    effort = case.recording.effort.copy()
    effort[::50, 1] += 10.0 * effort[:, 1].std()
    assert not len(common_jumps(case.logged(effort=effort).recording))
