"""MuJoCo moves the written arm as the identified one moves, under the same commands."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from armid.export.servos.mjcf_actuators import TIMESTEP, servo_mjcf
from armid.robot.readers import mjcf
from armid.servo.closed_loop import simulate
from armid.servo.held_command import held_means
from armid.servo.parameters import described_parameters
from servo_labs import any_parameters, recorded, servo_model, small_arm

SAME = 5e-4
"""RMS difference of the positions [rad]: MuJoCo's steps of 1 ms are of first order."""


def test_closed_loop_of_the_written_file():
    model, rng = servo_model(small_arm()), np.random.default_rng(3)
    parameters = replace(any_parameters(model, rng), limit=np.array([2.0, np.inf, 1.5]))
    run = recorded(model, parameters, rng, 10.0)
    (ours,) = simulate(model, parameters, [run])
    written = mujoco.MjModel.from_xml_string(servo_mjcf(model, parameters).decode())
    data = mujoco.MjData(written)
    data.qpos[:], data.qvel[:] = run.q[0], run.dq
    each = round(run.step / TIMESTEP)
    steps = (run.samples - 1) * each
    command, _ = held_means(run.command_time, run.command, parameters.delay, run.start, TIMESTEP, steps)
    theirs = [data.qpos.copy()]
    for k in range(steps):
        data.ctrl[:] = command[k]
        mujoco.mj_step(written, data)
        if (k + 1) % each == 0:
            theirs.append(data.qpos.copy())
    assert np.sqrt(np.mean((np.array(theirs) - ours.q) ** 2, axis=0)).max() < SAME


def test_the_file_can_be_read_again():
    model = servo_model(small_arm())
    parameters = replace(any_parameters(model, np.random.default_rng(3)), damping=np.array([0.1, 0.2, 0.0]))
    text = servo_mjcf(model, parameters).decode()
    again = servo_model(mjcf.read(text, source="the written file", locked={}, tip=None))
    found = described_parameters(again)
    assert found is not None
    assert np.allclose(found.inertial, parameters.inertial, rtol=1e-9)
    for name in ("friction", "stiffness", "damping", "rotor_inertia"):
        assert np.allclose(getattr(found, name), getattr(parameters, name), rtol=1e-12)
