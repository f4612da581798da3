"""Measures of oscillation, shapes of other motions, and the torque of bodies by M, C and g."""

from __future__ import annotations

import numpy as np
import pytest

from armid.lab.inverse_dynamics_recording import thesis_truth
from armid.thesis.experiments.motion_variants import SHAPES
from armid.thesis.experiments.residual_causes import between_jumps, oscillation, ringing
from armid.thesis.lagrange import link_motion, make_frames, torque_of_bodies
from armid.thesis.published import published
from armid.thesis.reduction import physical_of_standard
from armid.thesis.setting import HANGING, QUICK, make_setting, random_states

ROUNDING = 1e-11

TIME = np.arange(0.0, 12.0, 0.01)
SPEED = np.sin(2.0 * np.pi * (TIME + 0.005) / 6.0)[:, None]  # reversals every 3 s, none on a sample


def test_stretches_leave_the_jumps_out():
    stretches = between_jumps(SPEED[:, 0], TIME)
    assert len(stretches) == 2
    for rows in stretches:
        assert np.ptp(np.sign(SPEED[rows, 0])) == 0.0
        assert np.ptp(TIME[rows]) == pytest.approx(3.0 - 2 * 0.3, abs=0.03)
    assert between_jumps(np.ones(len(TIME)), TIME) == []


def test_oscillation_is_the_rms_between_jumps():
    ripple = 0.2 * np.sin(2.0 * np.pi * 5.0 * TIME)[:, None]
    jumps = 10.0 * np.sign(SPEED)
    assert oscillation(ripple + jumps, SPEED, TIME) == pytest.approx(0.2 / np.sqrt(2.0), rel=0.02)
    assert oscillation(jumps, SPEED, TIME) == pytest.approx(0.0, abs=ROUNDING)
    assert np.isnan(oscillation(jumps, np.ones_like(SPEED), TIME)).all()


def test_ringing_leaves_the_slow_part_out():
    slow = 20.0 * np.sin(2.0 * np.pi * 0.3 * TIME)[:, None]
    fast = 0.2 * np.sin(2.0 * np.pi * 3.5 * TIME)[:, None]
    assert ringing(slow, SPEED, TIME)[0] < 0.01
    assert ringing(fast, SPEED, TIME)[0] > 0.5 * 0.2 / np.sqrt(2.0)
    assert ringing(slow + fast, SPEED, TIME) == pytest.approx(ringing(fast, SPEED, TIME), rel=0.05)


@pytest.mark.parametrize("name", list(SHAPES))
def test_motions_begin_and_end_at_rest_in_zero(name: str):
    count, shape = SHAPES[name]
    step = 1e-4
    ends = np.array([0.0, step, 2 * step, 1.0 - 2 * step, 1.0 - step, 1.0 - 1e-12])
    q = shape(np.random.default_rng(1).standard_normal((7, count)), ends)
    middle = shape(np.random.default_rng(1).standard_normal((7, count)), np.linspace(0.0, 1.0, 50, endpoint=False))
    size = np.abs(middle).max(axis=0)
    assert q.shape == (6, 7) and (size > 0.0).all()
    assert (np.abs(q[[0, -1]]) < 1e-9 * size).all()
    assert (np.abs(q[1] - q[0]) / step < 0.05 * size * 2 * np.pi).all()  # no velocity, within the step
    assert (np.abs(q[2] - 2.0 * q[1] + q[0]) / step**2 < 25.0 * size).all()  # accelerations inside are some hundreds


def test_torque_of_bodies_is_that_of_the_recursion():
    setting = make_setting(QUICK)
    model, states = setting.hanging.dynamics, random_states(setting, seed=7)
    mu = physical_of_standard(model, thesis_truth(model))
    frames = make_frames(published())
    tau = model.torque(states, thesis_truth(model))
    error = np.abs(torque_of_bodies(frames, states, mu, np.array(HANGING)) - tau).max()
    assert error < ROUNDING * np.abs(tau).max()
    wrong = torque_of_bodies(frames, states, mu, -np.array(HANGING))
    assert np.abs(wrong - tau).max() > 0.1 * np.abs(tau).max()


def test_links_move_as_difference_quotients_say():
    frames, rng, step = make_frames(published()), np.random.default_rng(3), 1e-6
    q, dq = rng.standard_normal((2, 20, 7))
    found = link_motion(frames, q, dq)
    (R0, p0), (R1, p1) = frames.forward(q - step * dq), frames.forward(q + step * dq)
    velocity = np.einsum("nkxy,nkx->nky", found.rotation, (p1 - p0) / (2.0 * step))
    spin = np.swapaxes(found.rotation, -1, -2) @ (R1 - R0) / (2.0 * step)  # S(ω) in the frame of the link
    turning = np.stack([spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]], axis=-1)
    assert np.abs(found.velocity - velocity).max() < 1e-8 and np.abs(found.turning - turning).max() < 1e-8
