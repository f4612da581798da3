"""Servos at their largest torque, known and found, and steps of the integration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.servo.equation_error import fit_equation_error
from armid.servo.estimate_table import estimated_values
from armid.servo.identify_servo import SMALL_SHIFT, identify_servo
from armid.servo.output_error import minimise_output_error
from armid.servo.score import closed_loop_error
from armid.servo.unknowns import Unknowns
from servo_labs import BITS, any_parameters, recorded, servo_model, small_arm

ENCODER = 2.0 * np.pi / 2**BITS / np.sqrt(12.0)
"""RMS error of the encoders [rad]."""

SEEN = 0.9
"""Quantile of the torques without a limit that is made the largest torque, so that a tenth of the rows saturates."""

NEAR = 2.0
"""Factor within which the first estimate finds the position error at the largest torque: the next quantiles that it
tries differ by about as much."""

UNKNOWN_SCALE = 0.25
"""Largest error of the logarithm of a largest torque: links of 10 % leave a common scale of torques open by 6 %."""


def limited(seed: int):
    """Arm without a stated limit, parameters with one that is reached, and two runs."""
    rng, model = np.random.default_rng(seed), servo_model(small_arm())
    free = any_parameters(model, rng)
    run = recorded(model, free, np.random.default_rng(seed + 50), 20.0)
    asked = np.abs(free.stiffness * (run.held(run.time - free.delay[0]) - run.q - free.offset))
    truth = replace(free, limit=np.quantile(asked, SEEN, axis=0))
    return model, truth, [recorded(model, truth, rng, 20.0) for _ in range(2)]


def stating(limit):
    """The arm with a description that states largest torques."""
    arm = small_arm()
    joints = [replace(joint, effort_limit=float(each)) for joint, each in zip(arm.joints, limit, strict=True)]
    return servo_model(replace(arm, joints=joints))


@pytest.mark.parametrize("seed", [0, 1])
def test_the_first_estimate_finds_saturated_rows(seed):
    model, truth, (train, _) = limited(seed)
    first = fit_equation_error(model.robot.tree, model.robot.inertial_vector, [train], saturated=True)
    loaded = [1, 2]  # gravity loads these joints, so K is known
    assert (np.abs(np.log(first.saturation * truth.stiffness / truth.limit))[loaded] < np.log(NEAR)).all()
    unlimited = any_parameters(model, np.random.default_rng(seed))
    run = recorded(model, unlimited, np.random.default_rng(seed + 50), 20.0)
    none = fit_equation_error(model.robot.tree, model.robot.inertial_vector, [run], saturated=True)
    assert np.isinf(none.saturation).all()


@pytest.mark.parametrize("stated", [1.3, 0.1, np.inf], ids=["near", "too small", "none"])
def test_the_largest_torque_is_found(stated):
    """Whatever the description states: a value 30 % too large, a number without meaning, or nothing."""
    _, truth, (train, held_out) = limited(0)
    model = stating(stated * truth.limit)
    estimate = identify_servo(model, [train])
    assert closed_loop_error(model, estimate.parameters, [held_out]).total < 2.0 * ENCODER
    assert (np.abs(np.log(estimate.parameters.limit / truth.limit)) < UNKNOWN_SCALE).all()
    found = {each.joint: each for each in estimated_values(estimate, [train]) if each.kind == "limit"}
    assert len(found) == 3
    assert {each.origin for each in found.values()} <= {"identified", "weakly identified", "prior-dominated"}
    assert all(found[j].low < truth.limit[j] < found[j].high for j in found)


def test_a_described_limit_that_is_exceeded_is_not_used():
    """Servos without a limit, and a description with a number that the motion exceeds."""
    model, rng = servo_model(small_arm()), np.random.default_rng(3)
    truth = any_parameters(model, rng)
    train, held_out = (recorded(model, truth, rng, 20.0) for _ in range(2))
    estimate = identify_servo(stating(np.full(3, 0.1)), [train])
    assert np.isinf(estimate.parameters.limit).all()
    assert closed_loop_error(model, estimate.parameters, [held_out]).total < 2.0 * ENCODER


def test_steps_are_shortened_where_they_matter():
    """Exact positions show steps of 2 ms: dry friction changes its sign at the end of a step."""
    model, rng = servo_model(small_arm()), np.random.default_rng(4)
    truth = any_parameters(model, rng)
    coarse = recorded(model, truth, rng, 20.0)
    exact = recorded(model, truth, np.random.default_rng(4), 20.0, bits=18)
    usual, fine = identify_servo(model, [coarse]), identify_servo(model, [exact])
    assert fine.unknowns.model.longest_step < usual.unknowns.model.longest_step
    at_usual_steps = Unknowns(model, fine.unknowns.mean, fine.unknowns.deviations)
    shifted = minimise_output_error(at_usual_steps, [exact], start=fine.fit.x, most_steps=0)
    assert shifted.integration > SMALL_SHIFT
    assert fine.fit.integration < 0.5 * shifted.integration
