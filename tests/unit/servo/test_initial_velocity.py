"""Initial velocities of simulated runs, which arms with little damping remember for seconds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.servo.closed_loop import VELOCITY, simulate, with_initial_velocities
from armid.servo.output_error import TRANSIENT
from servo_labs import BITS, RATE, any_parameters, recorded, servo_model, small_arm

ENCODER = 2.0 * np.pi / 2**BITS / np.sqrt(12.0)
"""RMS error of the encoders [rad]."""

DAMPED = 0.7
"""Rate at which the motion after a wrong initial velocity decays [1/s]: half of it is there after the transient."""

NEAR = 1.2
"""Largest error of a motion with fitted velocities, in RMS errors of the encoders: those of the initial positions and
of the steps of the integration are left."""


def heavy():
    """Arm of the lab with heavy rotors, little friction, and steps like those of its truth."""
    model, rng = replace(servo_model(small_arm()), longest_step=5e-4), np.random.default_rng(6)
    parameters = any_parameters(model, rng)
    inertia = parameters.stiffness / 15.0**2  # natural frequency of 15 rad/s
    friction = [2.0 * DAMPED * inertia[law.joint] if law.symbol == "FV" else 1e-4 for law in model.laws]
    truth = replace(parameters, rotor_inertia=inertia, friction=np.array(friction))
    return model, truth, recorded(model, truth, rng, 10.0)


def later_error(model, truth, run) -> float:
    (found,) = simulate(model, truth, [run])
    return float(np.sqrt(np.mean((run.q - found.q)[round(TRANSIENT * RATE) :] ** 2)))


def test_fitted_velocities_take_the_slow_error_away():
    model, truth, run = heavy()
    (better,) = with_initial_velocities(model, truth, [run])
    assert later_error(model, truth, run) > 2.0 * NEAR * ENCODER
    assert later_error(model, truth, better) < NEAR * ENCODER


def test_only_velocities_change():
    model, truth, run = heavy()
    (better,) = with_initial_velocities(model, truth, [run])
    assert (np.abs(better.dq - run.dq) < 5.0 * VELOCITY).all()
    assert replace(better, dq=run.dq).q is run.q
    assert better.command is run.command


def test_runs_are_fitted_one_by_one():
    model, truth, run = heavy()
    two = with_initial_velocities(model, truth, [run, run.part(100, run.samples)])
    alone = (
        with_initial_velocities(model, truth, [run])[0],
        with_initial_velocities(model, truth, [run.part(100, run.samples)])[0],
    )
    for together, single in zip(two, alone, strict=True):
        assert together.dq == pytest.approx(single.dq, abs=1e-9)  # rounding of side by side


def test_a_motion_that_diverges_keeps_its_velocities():
    model, truth, run = heavy()
    wild = replace(run, command=np.full_like(run.command, 1e200))
    (kept,) = with_initial_velocities(model, truth, [wild])
    assert np.array_equal(kept.dq, run.dq)
