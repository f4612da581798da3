"""Findings about an estimate of servos."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.servo.identify_servo import identify_servo
from armid.study.servos.servo_estimate_findings import LARGE_SHIFT, servo_estimate_findings
from servo_labs import any_parameters, recorded, servo_model, small_arm


def codes(estimate) -> set[str]:
    return {each.code for each in servo_estimate_findings(estimate)}


def stating(limit: float):
    arm = small_arm()
    return servo_model(replace(arm, joints=[replace(joint, effort_limit=limit) for joint in arm.joints]))


@pytest.fixture(scope="module")
def sound():
    """Estimate of an arm whose servos have no limit, and its training run."""
    model, rng = servo_model(small_arm()), np.random.default_rng(3)
    run = recorded(model, any_parameters(model, rng), rng, 20.0)
    return identify_servo(model, [run]), run


def test_a_sound_estimate_has_none(sound):
    assert codes(sound[0]) == set()


def test_a_limit_that_the_motion_exceeds_is_named(sound):
    found = servo_estimate_findings(identify_servo(stating(0.1), [sound[1]]))
    assert [each.code for each in found] == ["servo-limit-unused"]
    assert all(f"joint_{k} (0.1)" in found[0].evidence for k in (1, 2, 3))


def test_another_limit_than_that_of_the_description_is_named(sound):
    """Servos that saturate at a seventh of what the description states."""
    model, rng = servo_model(small_arm()), np.random.default_rng(0)
    free = any_parameters(model, rng)
    run = recorded(model, free, np.random.default_rng(50), 20.0)
    asked = np.abs(free.stiffness * (run.held(run.time - free.delay[0]) - run.q - free.offset))
    truth = replace(free, limit=np.quantile(asked, 0.9, axis=0))
    train = recorded(model, truth, rng, 20.0)
    assert "servo-limit-differs" in codes(identify_servo(stating(7.0 * float(truth.limit.max())), [train]))


def test_coarse_steps_of_the_integration_are_reported(sound):
    estimate, _ = sound
    coarse = replace(estimate, fit=replace(estimate.fit, integration=2.0 * LARGE_SHIFT))
    assert codes(coarse) == {"integration-steps"}
