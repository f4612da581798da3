"""Every format gives back what was written, and says which arms it cannot move."""

from __future__ import annotations

import json

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.excitation.formats import FORMATS
from armid.excitation.plan import Plan
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.robot import load_robot
from armid.study.plans.design_writing import track_of

POSITIONS = 1e-9
"""FRI and URScript have nine decimals."""

HAVE_THE_PLAN = ("ros2", "urscript", "mat")


def track(arm):
    robot = load_robot(arm)
    basis = SeriesBasis(1.3, 4, np.full(robot.n, 0.2))
    x = 0.1 * np.random.default_rng(1).normal(size=basis.unknowns)
    plan = Plan(basis.excitation(x, robot.name), 2, np.zeros(robot.n), None, 1.0, 0.0)
    return track_of(plan, robot, 100.0)


@pytest.mark.parametrize("name", FORMATS)
def test_reading_gives_back_what_was_written(name):
    made = track("ur5e" if name == "urscript" else "iiwa14-r820")
    form = FORMATS[name]
    assert form.problem(made) == ""
    read = form.read(form.write(made))
    assert np.abs(read.motion.q - made.motion.q).max() < POSITIONS
    if name in ("csv", "ros2", "mat"):
        assert read.joints == made.joints
        assert read.motion.time == pytest.approx(made.motion.time, abs=1e-9)
        assert np.abs(read.motion.dq - made.motion.dq).max() < POSITIONS
        assert np.abs(read.motion.ddq - made.motion.ddq).max() < POSITIONS
    if name in HAVE_THE_PLAN:
        assert json.loads(read.plan) == json.loads(made.plan)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("content", [b"", b"nonsense\n1,2\n", b"\x00\xff" * 40])
def test_what_is_no_such_file(name, content):
    with pytest.raises(ArmidError):
        FORMATS[name].read(content)


def test_arms_that_a_controller_does_not_know():
    assert "7 revolute joints" in FORMATS["fri"].problem(track("ur5e"))
    assert "6 revolute joints" in FORMATS["urscript"].problem(track("iiwa14-r820"))
    with pytest.raises(ArmidError, match="rate of a motion must be above zero"):
        track_of(None, None, 0.0)
