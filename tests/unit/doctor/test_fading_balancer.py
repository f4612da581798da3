"""A balancer or a spring that loses its force along a log."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from armid.errors import Finding
from armid.study.diagnosis import diagnose_recording
from sick import Case, sound


def told(case: Case) -> list[Finding]:
    found = diagnose_recording(case.robot, case.recording, case.reading)
    return [f for f in found if f.severity != "info"]


SHAPES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "slowly": lambda share: share,
    "at first": lambda share: 1.0 - np.exp(-4.0 * share),
    "bent": lambda share: share**1.5,
}


@pytest.mark.parametrize(("joint", "shape"), [(1, "slowly"), (1, "at first"), (2, "slowly"), (2, "bent")])
def test_a_balancer_that_loses_its_force_is_named(joint: int, shape: str):
    case = sound(11, name="ur10e")
    assert case.recording.effort is not None
    effort, time = case.recording.effort.copy(), case.motion.time
    share = (time - time[0]) / np.ptp(time)
    weight = effort[:, joint].std() * np.cos(case.motion.q[:, joint] + 0.4)
    effort[:, joint] -= SHAPES[shape](share) * weight
    (found,) = told(case.logged(effort=effort))
    assert (found.code, found.channel) == ("changes-midway", case.robot.joint_names[joint])
    assert "balancer" in found.evidence


def test_a_balancer_with_a_constant_force_is_told_nothing():
    case = sound(11, name="ur10e")
    assert case.recording.effort is not None
    effort = case.recording.effort.copy()
    effort[:, 1] -= 0.6 * effort[:, 1].std() * np.cos(case.motion.q[:, 1] + 0.4)
    assert told(case.logged(effort=effort)) == []
