"""Known truth from simulated commands and positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import EstimationError
from armid.robot.robot import InertialParameters
from armid.servo import identify_servo as steps
from armid.servo import servo_prior as module
from armid.servo.closed_loop import position_derivatives, simulate
from armid.servo.equation_error import EquationErrorFit
from armid.servo.estimate_table import NARROW, estimated_values
from armid.servo.identify_servo import identify_servo
from armid.servo.options import ServoOptions
from armid.servo.output_error import correlation_times, minimise_output_error
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
    for seed in range(ARMS):
        rng = np.random.default_rng(seed)
        truth = any_parameters(model, rng)
        train, held_out = (recorded(model, truth, rng, 20.0) for _ in range(2))
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


def test_what_is_called_identified_is_known(identified):
    """Gravity does not load the upright pan joint; only links that are known to 10 % accelerate with it."""
    for truth, estimate, train, _ in identified:
        values = {(each.kind, each.joint): each for each in estimated_values(estimate, [train])}
        pan, lift = values["stiffness", 0], values["stiffness", 1]
        assert lift.origin == "identified"
        assert np.log(pan.high / pan.low) > np.log(lift.high / lift.low)
        for each in values.values():
            if each.origin == "identified" and each.kind not in ("offset", "delay"):
                assert abs(np.log(each.value / true_value(truth, estimate.model, each))) < np.log(NARROW)


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
    with pytest.raises(EstimationError, match="gives no mass for link_1, link_2, link_3"):
        identify_servo(servo_model(empty), [train])


def test_impossible_links_are_named(identified):
    _, _, train, _ = identified[0]
    robot = small_arm()
    vector = robot.links[1].inertial.vector.copy()
    vector[4] = 10.0 * vector[6]  # Ixx above Iyy + Izz
    flat = replace(robot.links[1], inertial=InertialParameters.from_vector(vector))
    with pytest.raises(EstimationError, match="gives for link_2"):
        identify_servo(servo_model(replace(robot, links=[robot.links[0], flat, robot.links[2]])), [train])


def test_joints_without_load_need_a_stiffness(identified):
    """Nothing shows the scale of torques without gravity and without a load in the first estimate."""
    _, estimate, train, _ = identified[0]
    model, none = servo_model(replace(small_arm(), gravity=(0.0, 0.0, 0.0))), np.zeros(3)
    first = EquationErrorFit(none, np.ones(3), none, none, none, none, np.full(3, np.inf), none)
    with pytest.raises(EstimationError, match="no stiffness is stated"):
        module.make_unknowns(model, first, model.robot.inertial_vector, [train], ServoOptions())
    known = module.make_unknowns(
        model, first, model.robot.inertial_vector, [train], ServoOptions(stiffness=np.full(3, 20.0))
    )
    assert np.array_equal(known.mean.stiffness, np.full(3, 20.0))
    assert estimate.unknowns.count > known.count


def test_a_motion_that_diverges_is_an_error(identified):
    """Positions of 1e200 rad make infinite centrifugal torques."""
    truth, estimate, train, _ = identified[0]
    wild = replace(train, command=np.full_like(train.command, 1e200))
    (found,) = simulate(estimate.model, truth, [wild])
    assert not np.isfinite(found.q).all()
    assert position_derivatives(estimate.model, truth, found) is None
    assert found.unsettled > 0
    with pytest.raises(EstimationError, match="diverges"):
        minimise_output_error(estimate.unknowns, [wild])


def test_the_first_estimate_is_kept_where_it_predicts_better(identified, monkeypatch):
    """Its intervals are then those at the first estimate."""
    _, estimate, train, _ = identified[0]
    real = steps.minimise_output_error

    def worse(unknowns, runs, *, start=None, most_steps=20, progress=None):
        if most_steps == steps.FEW_STEPS:
            away = 1.5 * np.array([name == "stiffness" for name, _ in unknowns.names()])
            return real(unknowns, runs, start=away, most_steps=0)
        return real(unknowns, runs, start=start, most_steps=most_steps, progress=progress)

    monkeypatch.setattr(steps, "minimise_output_error", worse)
    kept = identify_servo(estimate.model, [train])
    assert not kept.refined
    assert not kept.fit.x.any()
    assert np.allclose(kept.parameters.stiffness, kept.unknowns.mean.stiffness)


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
