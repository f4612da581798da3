"""Band of the position of a simulated arm."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from armid.servo import position_band as module
from armid.servo.position_band import COVERED, band_coverage, position_band
from servo_labs import any_parameters, recorded, servo_model, small_arm

HALF = 0.5 * 2.0 * np.pi / 2**12
"""Half a step of the encoders [rad]: the largest error of a model without any other error."""


@pytest.fixture
def exact(monkeypatch):
    """A true arm as its own estimate, and two of its runs."""
    model, rng = servo_model(small_arm()), np.random.default_rng(4)
    truth = any_parameters(model, rng)
    runs = [recorded(model, truth, rng, 20.0) for _ in range(2)]
    return SimpleNamespace(model=model, without_left_out=truth), runs


def test_the_band_of_a_true_model_is_that_of_the_encoders(exact):
    """The error of rounding is uniform, so its quantile of 95 % is 0.95 half steps; the integration adds little."""
    estimate, runs = exact
    band = position_band(estimate, runs)
    assert (band > 0.8 * COVERED * HALF).all()
    assert (band < 1.5 * HALF).all()


def test_few_independent_errors_widen_the_band(exact, monkeypatch):
    """An error that keeps its value for seconds counts as one: the level of the quantile grows, up to the maximum."""
    estimate, runs = exact
    slow = []
    for run in runs:
        t = run.time[:, None] - run.start
        slow.append(replace(run, q=run.q + 0.01 * np.sin(0.5 * t + np.arange(3))))
    wide = position_band(estimate, slow)
    monkeypatch.setattr(module, "correlation_times", lambda x: np.ones(x.shape[1]))
    assert (wide > position_band(estimate, slow)).all()


def test_coverage_counts_samples():
    errors = [np.array([[1.0, 3.0], [-1.0, -3.0]]), np.array([[3.0, 1.0], [0.0, 0.0]])]
    assert band_coverage(errors, np.array([2.0, 2.0])) == pytest.approx([0.75, 0.5])
