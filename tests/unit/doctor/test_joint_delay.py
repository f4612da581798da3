"""The check of positions of one joint that are late."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from armid.errors import Finding
from armid.measurement.recording import Recording
from armid.study.diagnosis import diagnose_recording
from sick import Case, sound


def late(case: Case, joint: int, seconds: float) -> tuple[Case, float]:
    """The log with a position and its velocity late by some seconds, and the delay in whole samples [ms]."""
    log, step = case.recording, float(case.motion.time[1])
    samples = round(seconds / step)
    q, dq = log.q.copy(), None if log.dq is None else log.dq.copy()
    for values in (q, dq):
        if values is not None:
            values[:, joint] = np.roll(values[:, joint], samples)
    return case.logged(q=q, dq=dq), 1e3 * samples * step


def told(case: Case) -> list[Finding]:
    return [f for f in diagnose_recording(case.robot, case.recording, case.reading) if f.code == "joint-delay"]


@pytest.mark.parametrize(("seed", "joint"), [(4, 1), (12, 2), (51, 1)])
@pytest.mark.parametrize("seconds", [0.06, -0.06])
def test_the_joint_is_named_with_its_delay(seed: int, joint: int, seconds: float):
    case, delay = late(sound(seed), joint, seconds)
    (found,) = told(case)
    assert (found.severity, found.channel) == ("error", case.robot.joint_names[joint])
    word, value, deviation = re.findall(r"are (late|early) by (\d+) ± ([\d.]+) ms", found.evidence)[0]
    assert word == ("late" if seconds > 0.0 else "early")
    assert (
        abs(float(value) - abs(delay)) < 4.0 * float(deviation) + 0.5
    )  # four deviations, and half of the last digit
    assert found.remedy.startswith("rewrite the log") and case.robot.joint_names[joint] in found.remedy


def test_torque_that_is_late_is_no_late_position():
    """All positions are early then, which is the delay of the torque."""
    case = sound(4)
    log = case.recording
    assert log.effort is not None
    everything: Recording = replace(log, effort=np.roll(log.effort, round(0.03 / float(case.motion.time[1])), axis=0))
    found = diagnose_recording(case.robot, everything, case.reading)
    assert {f.code for f in found if f.severity == "error"} == {"channel-delay"}
