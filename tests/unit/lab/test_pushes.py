"""Pushes: torque on the links that drives do not give, in closed loop and along an exact motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid import kernel
from armid.errors import LabError
from armid.lab.options import parse_options
from armid.lab.pushes import Push, external_torque
from armid.lab.simulation import simulate
from plants import lab, short_plan, small_arm

PUSH = Push(joint=1, torque=6.0, start=0.8, seconds=0.3, rise=0.05)


def test_a_push_rises_and_falls():
    time = np.array([0.79, 0.8, 0.825, 0.9, 1.075, 1.1])
    assert np.allclose(PUSH.at(time), [0.0, 0.0, 3.0, 6.0, 3.0, 0.0])
    assert replace(PUSH, rise=0.0).at(time).tolist() == [0.0, 6.0, 6.0, 6.0, 6.0, 0.0]


def test_pushes_add_up_and_name_joints_that_exist():
    time = np.linspace(0.0, 2.0, 21)
    two = external_torque([PUSH, replace(PUSH, torque=1.0)], 3, time)
    assert two is not None and np.allclose(two[:, 1], 7.0 / 6.0 * PUSH.at(time)) and not two[:, [0, 2]].any()
    assert external_torque([], 3, time) is None
    with pytest.raises(LabError, match="joint 5"):
        external_torque([replace(PUSH, joint=5)], 3, time)
    with pytest.raises(LabError, match="seconds"):
        Push(seconds=0.0)


def test_along_an_exact_motion_only_the_torque_changes():
    options = lab(mode="inverse-dynamics")
    plan = short_plan(period=2.0)
    free = simulate(small_arm(), plan, options).recording
    pushed = simulate(small_arm(), plan, replace(options, pushes=(PUSH,))).recording
    assert np.array_equal(free.q, pushed.q)
    assert free.effort is not None and pushed.effort is not None and free.time is not None
    assert np.allclose(free.effort - pushed.effort, external_torque([PUSH], 3, free.time), atol=1e-9)


@pytest.mark.parametrize("stiffness", [None, np.full(3, 4e3)])
def test_in_closed_loop_the_links_get_drive_and_push(stiffness: np.ndarray | None):
    """Inverse dynamics of the true motion is what the gears transmit and the push; the arm yields to it."""
    pytest.importorskip("mujoco")
    truth = small_arm(rotor=np.full(3, 0.2))
    truth = replace(truth, stiffness=stiffness, spring_damping=np.full(3, 1.0) if stiffness is not None else ())
    plan = short_plan(period=2.0)
    found = simulate(truth, plan, lab(pushes=(PUSH,)))
    trace = found.trace
    rigid = kernel.inverse_dynamics(truth.robot.tree, truth.inertial, trace.q, trace.dq, trace.ddq)
    external = external_torque([PUSH], 3, trace.time)
    difference = rigid - trace.transmitted - external
    scale = np.abs(rigid).max()
    # Second order in the step, of 2 kHz; springs are faster than links. The push is a fifth of the scale.
    assert np.abs(difference).max() < (1e-4 if stiffness is None else 2e-3) * scale
    free = simulate(truth, plan, lab()).trace
    during = (trace.time > 0.9) & (trace.time < 1.05)
    assert (trace.q - free.q)[during, 1].mean() > 1e-5


def test_pushes_are_read_from_a_table():
    found = parse_options({"pushes": [{"joint": 2, "torque": 4.0}]})
    assert found.pushes == (Push(2, 4.0),)
    with pytest.raises(LabError, match="torqe"):
        parse_options({"pushes": [{"torqe": 4.0}]})
