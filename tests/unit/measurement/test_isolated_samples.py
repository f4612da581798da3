"""Isolated samples lie beyond both of their sides; steps, motion and noise have none."""

from __future__ import annotations

import numpy as np
import pytest

from armid.checked_array import Array
from armid.measurement.processing.channels.isolated_samples import heights, isolated_samples

SAMPLES, STEP = 4000, 1e-3


def noise(seed: int = 0, joints: int = 2) -> Array:
    return np.random.default_rng(seed).standard_normal((SAMPLES, joints))


@pytest.mark.parametrize("length", [1, 2, 3])
@pytest.mark.parametrize("row", [2, 3, 700, SAMPLES - 6])
def test_a_short_run_is_found_and_nothing_else(length: int, row: int):
    x = noise()
    x[row : row + length, 1] += 60.0
    expected = np.zeros(x.shape, dtype=np.bool_)
    expected[row : row + length, 1] = True
    np.testing.assert_array_equal(isolated_samples(x, STEP), expected)


@pytest.mark.parametrize("length", [4, 30])
def test_a_longer_run_is_no_spike(length: int):
    x = noise()
    x[700 : 700 + length] += 60.0
    assert not isolated_samples(x, STEP).any()


def test_white_noise_and_steps_have_none():
    """The torque of dry friction steps at each reversal, and an impact decays over many samples."""
    t = 0.1 + STEP * np.arange(SAMPLES)
    torque = 30.0 * np.sign(np.sin(6.0 * t)) + np.where(t > 2.0, 80.0 * np.exp(-(t - 2.0) / 0.02), 0.0)
    x = np.column_stack([torque, np.round(torque)]) + np.array([0.1, 0.0]) * noise(1)
    assert not isolated_samples(x, STEP).any()
    assert not any(isolated_samples(noise(seed), STEP).any() for seed in range(20))


def test_few_and_constant_samples_have_none():
    assert not isolated_samples(np.zeros((SAMPLES, 2)), STEP).any()
    assert not isolated_samples(np.array([[0.0], [9.0], [0.0]]), STEP).any()


def test_rest_does_not_lower_what_is_usual():
    """Short peaks are usual where the channel changes, even if it is constant nearly always; where none is, nothing
    is known about the usual ones."""
    x = np.zeros((SAMPLES, 2))
    peaks = np.arange(200, SAMPLES, 400)
    x[peaks, 0], x[peaks, 1] = 1.0, np.linspace(1.0, 2.0, len(peaks))
    x[700:900] += np.linspace(0.0, 1.0, 200)[:, None] ** 2
    assert not isolated_samples(x, STEP).any()
    moving = np.arange(1000, 1200)
    x[moving] += 0.02 * noise()[moving]
    x[1100] += 60.0
    np.testing.assert_array_equal(np.flatnonzero(isolated_samples(x, STEP).any(axis=1)), [1100])


def test_a_run_of_steady_motion_has_no_height():
    for length in (1, 2, 3):
        height, _ = heights(np.arange(50.0), length)
        assert not height.any()


def test_heights_are_those_of_the_definition():
    x = np.array([0.0, 1.0, 0.0, 1.0, 9.0, 7.0, 2.0, 3.0, 2.0, 3.0])
    height, difference = heights(x, 2)
    assert height[4] == 7.0 - 2.0  # the smaller of 9 and 7 above the larger of the medians 1 and 2
    assert difference[4] == 1.0


def test_a_peak_must_be_higher_where_samples_are_long():
    """Torque that stops an arm can be one sample long at 100 Hz, but not at 1 kHz."""
    x = noise()
    x[700, 1] += 60.0
    assert isolated_samples(x, 1e-3)[700, 1] and not isolated_samples(x, 1e-2).any()
    x[700, 1] += 300.0
    assert isolated_samples(x, 1e-2)[700, 1]


def test_a_step_next_to_an_end_is_no_spike():
    """Friction may reverse in the last sample; only positions, which cannot step, are examined there."""
    x = noise()
    x[-2:, 1] += 60.0
    x[0, 0] += 60.0
    assert not isolated_samples(x, STEP).any()
    assert heights(x[:, 1], 2, ends=True)[0][-1] > 50.0


@pytest.mark.parametrize("share", [0.005, 0.01, 0.02])
def test_outliers_in_a_share_of_the_samples_do_not_hide_each_other(share: float):
    rng = np.random.default_rng(5)
    time = np.arange(6000) / 1000.0
    clean = np.sin(2.0 * time) + 0.001 * rng.standard_normal(len(time))
    bad = np.zeros(len(time), dtype=np.bool_)
    bad[rng.choice(np.arange(5, 5995, 8), round(share * len(time)), replace=False)] = True
    found = isolated_samples(np.where(bad, 999.0, clean)[:, None], 1e-3)[:, 0]
    assert found[bad].all() and not found[~bad].any()


def test_a_lost_sample_is_found_at_any_rate():
    """At 100 Hz a peak of one sample may be motion; a zero between two loads is none."""
    t = 0.01 * np.arange(800)
    load = -6.0 + 2.0 * np.sin(2.0 * t) + np.sign(np.cos(3.0 * t))
    lost, peak = load.copy(), load.copy()
    row = int(np.argmin(np.abs(t - 4.6)))
    lost[row], peak[row] = 0.0, load[row] + 0.4
    assert np.flatnonzero(isolated_samples(np.column_stack([lost]), 0.01)[:, 0]).tolist() == [row]
    assert not isolated_samples(np.column_stack([load, peak]), 0.01).any()


def test_zeros_of_a_motor_that_is_switched_off_and_crossings_of_zero_are_not_lost():
    t = 0.01 * np.arange(800)
    crossing = np.round(3.0 * np.sin(2.0 * t) + np.sign(np.cos(3.0 * t)), 1)
    off = np.where((t > 2.0) & (t < 4.0), 0.0, crossing)
    assert not isolated_samples(np.column_stack([crossing, off]), 0.01).any()
