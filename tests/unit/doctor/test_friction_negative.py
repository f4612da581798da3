"""Torques from which more friction was subtracted than there is."""

from __future__ import annotations

import numpy as np
import pytest

from armid.study.diagnosis import diagnose_recording
from sick import Case, sound

CODE = "friction-negative"


def compensated(case: Case, share: float, width: float = 0.02) -> Case:
    """The log without a share of the dry friction, which passes through zero over a velocity [rad/s]."""
    assert case.recording.effort is not None
    dry = np.zeros(case.robot.n)
    for parameter, value in zip(case.model.parameters, case.theta, strict=True):
        if parameter.symbol == "FS":
            dry[parameter.number - 1] = value
    return case.logged(effort=case.recording.effort - share * dry * np.tanh(case.motion.dq / width))


def told(case: Case) -> list[str]:
    return [f.code for f in diagnose_recording(case.robot, case.recording, case.reading) if f.severity == "error"]


@pytest.mark.parametrize(("name", "share", "width"), [("ur10e", 2.0, 0.02), ("iiwa14-r820", 3.0, 0.1)])
def test_friction_that_is_subtracted_twice_is_named_and_no_sign_is(name: str, share: float, width: float):
    assert told(compensated(sound(11, name=name), share, width)) == [CODE]


@pytest.mark.parametrize("share", [0.0, 0.5, 0.8])
def test_friction_that_is_compensated_in_part_is_no_error(share: float):
    assert told(compensated(sound(11, name="ur10e"), share)) == []


def test_the_opposite_torque_is_no_compensation():
    case = sound(11, name="ur10e")
    assert case.recording.effort is not None
    assert told(case.logged(effort=-case.recording.effort)) == ["torque-sign"]
