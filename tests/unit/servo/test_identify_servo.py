"""Known truth from simulated commands and positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import EstimationError
from armid.servo.estimate_table import estimated_values
from armid.servo.identify_servo import identify_servo
from armid.servo.options import ServoOptions
from armid.servo.output_error import correlation_times
from armid.servo.score import closed_loop_error, command_error
from servo_labs import BITS, any_parameters, recorded, servo_model, small_arm

ENCODER = 2.0 * np.pi / 2**BITS / np.sqrt(12.0)
"""RMS error of the encoders [rad]."""

ARMS = 4
INSIDE = 0.85
"""Smallest share of 95 % intervals of four arms (about 75 values) that hold the truth: with a true share of 0.95, a
share below 0.85 has a probability of 2e-4, were the values independent."""


@pytest.fixture(scope="module")
def identified():
    """Truth, estimate, training and held-out run of four arms."""
    found, model = [], servo_model(small_arm())
    with pytest.MonkeyPatch.context() as patched:
        for seed in range(ARMS):
            rng = np.random.default_rng(seed)
            truth = any_parameters(model, rng)
            train, held_out = (recorded(model, truth, rng, 20.0, patched) for _ in range(2))
            found.append((truth, identify_servo(model, [train]), train, held_out))
    return found


def true_value(truth, model, each) -> float:
    law = [k for k, law in enumerate(model.laws) if (law.symbol, law.joint) == (each.kind, each.joint)]
    return truth.friction[law[0]] if law else getattr(truth, each.kind)[each.joint]


def test_motion_that_was_not_seen_is_predicted(identified):
    for _, estimate, _, held_out in identified:
        error = closed_loop_error(estimate.model, estimate.parameters, [held_out])
        assert error.total < 2.0 * ENCODER
        assert error.total < 0.05 * command_error([held_out]).total
        assert estimate.refined
        assert estimate.fit.settled


def test_intervals_hold_the_truth(identified):
    inside = [
        each.low <= true_value(truth, estimate.model, each) <= each.high
        for truth, estimate, train, _ in identified
        for each in estimated_values(estimate, [train])
    ]
    assert len(inside) > 60
    assert np.mean(inside) >= INSIDE


def test_gains_that_no_load_shows_are_not_called_identified(identified):
    """The upright pan joint is accelerated by links that are known to 10 %, and not loaded by gravity."""
    for _, estimate, train, _ in identified:
        values = {(each.kind, each.joint): each for each in estimated_values(estimate, [train])}
        pan, lift = values["stiffness", 0], values["stiffness", 1]
        assert lift.origin == "identified"
        assert np.log(pan.high / pan.low) > np.log(lift.high / lift.low)


def test_known_gains_stay(identified):
    truth, estimate, train, held_out = identified[0]
    options = ServoOptions(stiffness=truth.stiffness, damping=np.zeros(3), bodies=0.0)
    known = identify_servo(estimate.model, [train], options)
    assert np.array_equal(known.parameters.stiffness, truth.stiffness)
    assert closed_loop_error(known.model, known.parameters, [held_out]).total < 8.0 * ENCODER


def test_a_description_without_masses_is_refused(identified):
    _, _, train, _ = identified[0]
    robot = small_arm()
    empty = replace(robot, links=[replace(link, inertial=None) for link in robot.links])
    with pytest.raises(EstimationError, match="gives no mass"):
        identify_servo(servo_model(empty), [train])


def test_correlation_times():
    """White noise has one sample, a first-order process (1 + a) / (1 - a), and a constant the whole length."""
    rng = np.random.default_rng(0)
    white = rng.normal(size=20_000)
    slow = np.zeros(20_000)
    for k in range(1, 20_000):
        slow[k] = 0.9 * slow[k - 1] + white[k]
    constant = np.full(20_000, 2.0)
    found = correlation_times(np.column_stack([white, slow, constant]))
    assert found[0] == pytest.approx(1.0, abs=0.3)
    assert found[1] == pytest.approx(19.0, rel=0.3)
    assert found[2] > 0.9 * 20_000
