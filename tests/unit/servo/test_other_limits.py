"""Largest torques that no simulated row reaches at first, so that no derivative shows them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.servo import identify_servo as module
from armid.servo.identify_servo import identify_servo
from armid.servo.other_limits import MOST_WINDOWS, WINDOW, encoder_errors, windows_of
from servo_labs import RATE, any_parameters, recorded, servo_model, small_arm

FINE = 16
"""Bits of the encoders."""

ENCODER = 2.0 * np.pi / 2**FINE / np.sqrt(12.0)
"""RMS error of the encoders [rad]."""

NEAR, FAR = 2.0, 50.0
"""Residuals of a joint with the right limit, and without it, in RMS errors of the encoders."""

SCALE = 0.25
"""Largest error of the logarithm of a largest torque: links of 10 % leave a common scale of torques open by 6 %."""


def saturated(seed: int):
    """Arm whose description states 1.6 times the torques that its servos reach in some rows, truth and a run."""
    rng, arm = np.random.default_rng(seed), small_arm()
    free = any_parameters(servo_model(arm), rng)
    run = recorded(servo_model(arm), free, np.random.default_rng(seed + 50), 20.0, bits=FINE)
    asked = np.abs(free.stiffness * (run.held(run.time - free.delay[0]) - run.q - free.offset))
    truth = replace(free, limit=np.quantile(asked, 0.99, axis=0))
    joints = [replace(j, effort_limit=1.6 * float(limit)) for j, limit in zip(arm.joints, truth.limit, strict=True)]
    model = servo_model(replace(arm, joints=joints))
    return model, truth, recorded(model, truth, rng, 20.0, bits=FINE)


@pytest.mark.long
def test_a_limit_that_no_simulated_row_reaches_is_found(monkeypatch):
    model, truth, run = saturated(0)
    found = identify_servo(model, [run])
    monkeypatch.setattr(module, "with_other_limits", lambda unknowns, runs, fit, progress: (unknowns, fit))
    without = identify_servo(model, [run])
    assert without.fit.rms[2] > FAR * ENCODER
    assert found.fit.rms[2] < NEAR * ENCODER
    assert abs(np.log(found.parameters.limit[2] / truth.limit[2])) < SCALE


def test_windows_of_long_runs_are_spread():
    _, _, run = saturated(0)
    each = windows_of([run])
    assert len(each) == int(run.samples / RATE / WINDOW)
    assert np.array_equal(np.concatenate([w.q for w in each]), run.q[: round(len(each) * WINDOW * RATE)])
    many = windows_of([run] * 10)
    assert len(many) == MOST_WINDOWS
    assert many[0].start == each[0].start
    assert many[-1].start == each[-1].start


@pytest.mark.parametrize("bits", [10, 12])
def test_the_step_of_an_encoder_is_the_smallest_change(bits):
    model, truth, _ = saturated(0)
    run = recorded(model, truth, np.random.default_rng(1), 5.0, bits=bits)
    assert encoder_errors([run]) == pytest.approx(2.0 * np.pi / 2**bits / np.sqrt(12.0), rel=1e-6)
