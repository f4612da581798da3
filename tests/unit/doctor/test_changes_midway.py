"""Changes within one log: what changes, of which joint, from when on, and the part that is left out."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from armid.errors import Finding
from armid.study.diagnosis import diagnose_recording
from sick import Case, sound

SEEDS = (4, 51)
"""Seeds of logs of a UR10e and a Panda."""

NEAR = 0.12
"""Error of the time of a change, as a share of the log: a torque that is near zero for a while shows no sign."""


def told(case: Case) -> list[Finding]:
    return [f for f in diagnose_recording(case.robot, case.recording, case.reading) if f.severity != "info"]


def midway(case: Case) -> list[Finding]:
    return [f for f in told(case) if f.code == "changes-midway"]


def since(case: Case, share: float) -> np.ndarray:
    """Mask of the samples after a share of the log, shape (N,)."""
    time = case.motion.time
    return time >= time[0] + share * (time[-1] - time[0])


def torques(case: Case) -> np.ndarray:
    assert case.recording.effort is not None
    return case.recording.effort.copy()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_torque_whose_sign_changes_is_named_with_the_time(seed: int):
    case = sound(seed)
    effort = torques(case)
    effort[since(case, 0.5), 1] *= -1.0
    (found,) = midway(case.logged(effort=effort))
    assert found.channel == case.robot.joint_names[1] and found.severity == "error"
    time = case.motion.time
    stated = float(re.findall(r"t = (-?[\d.]+) s", found.evidence)[0])
    assert abs((stated - time[0]) / (time[-1] - time[0]) - 0.5) < NEAR


@pytest.mark.parametrize("seed", SEEDS)
def test_a_torque_whose_gain_changes_is_named(seed: int):
    """An offset, or a gain that changes gradually, explains such a log nearly as well on the right joint."""
    case = sound(seed)
    effort = torques(case)
    effort[since(case, 0.5), 1] *= 1.6
    (found,) = midway(case.logged(effort=effort))
    assert found.channel == case.robot.joint_names[1]


@pytest.mark.parametrize("seed", SEEDS)
def test_an_encoder_that_slips_is_named_without_a_model(seed: int):
    case = sound(seed)
    q = case.recording.q.copy()
    q[since(case, 0.7), 2] += 0.2
    (found,) = midway(replace(case, recording=replace(case.recording, q=q)))
    assert found.channel == case.robot.joint_names[2] and "+0.2 rad" in found.evidence


@pytest.mark.parametrize("seed", SEEDS)
def test_the_remedy_leaves_out_the_part_that_differs(seed: int):
    case = sound(seed)
    effort = torques(case)
    effort[since(case, 0.6), 1] *= -1.0
    (found,) = midway(case.logged(effort=effort))
    low, high = map(float, re.findall(r"\[(-?[\d.]+), (-?[\d.]+)\]", str(found.remedy))[0])
    cut = replace(case.logged(effort=effort), reading=replace(case.reading, exclude=((low, high),)))
    assert not midway(cut)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_torque_that_is_wrong_in_the_whole_log_does_not_change(seed: int):
    case = sound(seed)
    effort = torques(case)
    effort[:, 1] *= -1.0
    assert not midway(case.logged(effort=effort)) and not midway(case)


@pytest.mark.parametrize("seed", SEEDS)
def test_an_encoder_that_slips_several_times_is_named_once(seed: int):
    """Velocities that were logged do not follow the slips; they are no second fault."""
    case = sound(seed)
    q = case.recording.q.copy()
    for share, size in ((0.2, 0.1), (0.35, -0.1), (0.5, 0.06), (0.6, 0.1), (0.8, -0.08)):
        q[since(case, share), 2] += size
    (found,) = told(replace(case, recording=replace(case.recording, q=q)))
    assert (found.code, found.channel) == ("changes-midway", case.robot.joint_names[2])
    assert "jumps 5 times" in found.evidence and "-0.1 to +0.1 rad" in found.evidence


@pytest.mark.parametrize("seed", SEEDS)
def test_an_encoder_whose_bit_is_stuck_is_named(seed: int):
    case = sound(seed)
    q = case.recording.q.copy()
    counts = np.round(q[:, 1] / (2.0 * np.pi) * 8192.0).astype(np.int64)
    q[:, 1] -= np.where(counts & 256, 256, 0) * 2.0 * np.pi / 8192.0
    found = told(replace(case, recording=replace(case.recording, q=q)))
    assert [(f.code, f.channel) for f in found] == [("changes-midway", case.robot.joint_names[1])]


@pytest.mark.parametrize("seed", SEEDS)
def test_offsets_of_all_torques_that_settle_are_named(seed: int):
    case = sound(seed)
    effort = torques(case)
    share = (case.motion.time - case.motion.time[0]) / np.ptp(case.motion.time)
    effort += 0.8 * effort.std(axis=0) * np.exp(-4.0 * share)[:, None]
    (found,) = midway(case.logged(effort=effort))
    assert found.channel == "" and "shifted" in found.evidence


@pytest.mark.parametrize("seed", SEEDS)
def test_a_share_of_another_torque_since_some_time_is_named(seed: int):
    case = sound(seed)
    effort = torques(case)
    effort[since(case, 0.5), 2] += 0.5 * effort[since(case, 0.5), 1]
    (found,) = midway(case.logged(effort=effort))
    assert case.robot.joint_names[2] in found.channel and case.robot.joint_names[1] in found.channel


def test_a_gain_that_changes_in_two_parts_is_named_with_both():
    case = sound(SEEDS[0])
    effort = torques(case)
    for low, high in ((0.25, 0.5), (0.75, 1.0)):
        effort[since(case, low) & ~since(case, high), 1] *= 1.6
    (found,) = midway(case.logged(effort=effort))
    assert found.channel == case.robot.joint_names[1]
    assert len(re.findall(r"from about t", found.evidence, re.IGNORECASE)) == 2


def test_one_torque_that_is_late_since_some_time_is_named():
    case = sound(SEEDS[1])
    effort, time = torques(case), case.motion.time
    effort[:, 1] = np.where(since(case, 0.5), np.interp(time - 0.1, time, effort[:, 1]), effort[:, 1])
    (found,) = midway(case.logged(effort=effort))
    assert found.channel == case.robot.joint_names[1] and "late" in found.evidence


@pytest.mark.parametrize("seed", SEEDS)
def test_a_position_of_another_scale_since_some_time_is_named(seed: int):
    case = sound(seed).logged(dq=None)
    q = case.recording.q.copy()
    rows = since(case, 0.5)
    q[rows, 1] += 0.4 * (q[rows, 1] - q[np.argmax(rows), 1])
    found = midway(replace(case, recording=replace(case.recording, q=q)))
    assert [f.channel for f in found] == [case.robot.joint_names[1]]


@pytest.mark.parametrize("seed", SEEDS)
def test_all_torques_in_another_unit_since_some_time_are_named(seed: int):
    case = sound(seed)
    effort = torques(case)
    effort[since(case, 0.4)] *= 1000.0
    (found,) = midway(case.logged(effort=effort))
    (factor,) = re.findall(r"all torques are (\S+) times", found.evidence)
    assert found.severity == "error" and abs(abs(np.log10(float(factor))) - 3.0) < 0.1  # either part may be wrong
