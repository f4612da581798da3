"""Held commands: means over steps keep the area, and their derivatives are those by the delay."""

from __future__ import annotations

import numpy as np
import pytest

from armid.servo.held_command import held_means

TIME = np.cumsum(np.concatenate([[3.0], np.random.default_rng(0).uniform(0.015, 0.03, 60)]))
COMMAND = np.random.default_rng(1).normal(size=(61, 2))
ROUNDING = 1e-12


def test_a_step_inside_a_sample_has_its_command():
    means, slopes = held_means(TIME, COMMAND, np.zeros(2), TIME[3], 1e-3, 10)
    assert np.allclose(means, COMMAND[3], atol=ROUNDING)
    assert not slopes.any()


def test_the_area_does_not_depend_on_the_steps():
    for steps in (1, 7, 200):
        means, _ = held_means(TIME, COMMAND, np.array([0.0, 0.013]), TIME[2], 0.4 / steps, steps)
        coarse, _ = held_means(TIME, COMMAND, np.array([0.0, 0.013]), TIME[2], 0.4, 1)
        assert np.allclose(means.mean(axis=0), coarse[0], atol=ROUNDING)


def test_a_delay_shifts_the_command():
    late, _ = held_means(TIME, COMMAND, np.full(2, 0.25), TIME[10], 2e-3, 300)
    early, _ = held_means(TIME, COMMAND, np.zeros(2), TIME[10] - 0.25, 2e-3, 300)
    assert np.allclose(late, early, atol=ROUNDING)


def test_before_the_first_sample_the_first_command_is_held():
    means, slopes = held_means(TIME, COMMAND, np.full(2, 0.5), TIME[0], 1e-2, 40)
    assert np.allclose(means, COMMAND[0], atol=ROUNDING)
    assert not slopes.any()


@pytest.mark.parametrize("delay", [-0.017, 0.0043, 0.031])
def test_slopes_are_derivatives_by_the_delay(delay):
    step, small = 2e-3, 1e-7
    _, slopes = held_means(TIME, COMMAND, np.full(2, delay), TIME[5], step, 400)
    up, _ = held_means(TIME, COMMAND, np.full(2, delay + small), TIME[5], step, 400)
    down, _ = held_means(TIME, COMMAND, np.full(2, delay - small), TIME[5], step, 400)
    # No change of the command is within 1e-7 s of the border of a step, so the mean is linear in between.
    assert np.allclose((up - down) / (2 * small), slopes, atol=1e-4 * np.abs(slopes).max())
