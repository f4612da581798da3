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
