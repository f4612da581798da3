"""Resampling, automatic cut-off and delays of signals."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.interpolate

from armid.errors import ArmidError
from armid.maths.signals.delay import periodic_delay, periodic_shift
from armid.maths.signals.motion_cutoff import automatic_cutoff
from armid.maths.signals.resampling import resample


def jittered_clock(samples: int, rate: float, spread: float, seed: int = 0):
    """Times around an even clock, each step off by up to `spread` of itself."""
    steps = 1 + spread * np.random.default_rng(seed).uniform(-1, 1, samples)
    return np.concatenate([[0.0], steps.cumsum()[:-1]]) / rate


def motion(t: np.ndarray, top: float = 1.0):
    """Twelve sines up to `top` hertz, shape (N, 1)."""
    f = top * np.arange(1, 13) / 12
    return (np.sin(2 * np.pi * np.outer(t, f) + np.arange(12)) / 3.5).sum(axis=1)[:, None]


def test_resampling_a_jittered_clock_errs_by_the_fourth_power_of_the_step():
    for top, bound in ((1.0, 1e-5), (5.0, 6e-3)):
        # The error of a cubic spline on the longest step: 5/384 h⁴ max|x⁗| with h = 15 ms and amplitude 3.4.
        t = jittered_clock(2000, 100.0, 0.5)
        grid = np.arange(0.1, t[-1] - 0.1, 0.01)
        error = np.abs(resample(t, motion(t, top), grid) - motion(grid, top)).max()
        linear = np.abs(np.interp(grid, t, motion(t, top)[:, 0]) - motion(grid, top)[:, 0]).max()
        monotone = scipy.interpolate.PchipInterpolator(t, motion(t, top))(grid)
        assert error < bound
        assert error < 0.02 * linear
        assert error < 0.1 * np.abs(monotone - motion(grid, top)).max()


def test_resampling_does_not_raise_the_noise():
    rng = np.random.default_rng(5)
    t = jittered_clock(20000, 1000.0, 0.3)
    noise = resample(t, rng.normal(size=(20000, 1)), np.arange(0.1, t[-1] - 0.1, 1e-3))
    assert np.std(noise) < 1.1  # a spline passes white noise with a gain of about one


def test_resampling_leaves_an_even_clock_alone():
    t = np.arange(200) / 50.0
    x = motion(t)
    np.testing.assert_allclose(resample(t, x, t), x, atol=1e-14)


def test_resampling_refuses_gaps_backward_clocks_and_grids_outside():
    t = np.arange(20) / 10.0
    x = np.sin(t)
    with pytest.raises(ArmidError, match=r"over at most 0\.2 s"):
        resample(np.where(t > 0.95, t + 1.0, t), x, t[:5], longest=0.2)
    with pytest.raises(ArmidError, match="does not after sample 3"):
        resample(np.r_[t[:4], t[2:18]], x, t[:5])
    with pytest.raises(ArmidError, match="exceeds the recorded time"):
        resample(t, x, t + 0.1)


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
def test_the_automatic_cutoff_is_ten_times_the_band_of_the_motion(noise: float):
    # Ten harmonics of 1/20 Hz, the top one at 0.5 Hz with as much velocity as the others.
    t = np.arange(20000) / 1000.0
    q = sum(np.sin(2 * np.pi * k * t / 20 + k) / k for k in range(1, 11))[:, None]
    q = q + noise * np.random.default_rng(6).normal(size=q.shape)
    # The window spreads a line over two bins of 0.05 Hz to either side.
    assert 5.0 <= automatic_cutoff(q, 1000.0) <= 6.0


def test_the_automatic_cutoff_follows_the_fastest_joint_and_stays_in_range():
    t = np.arange(5000) / 500.0
    slow, fast = np.sin(2 * np.pi * 0.3 * t), 0.1 * np.sin(2 * np.pi * 1.5 * t)
    assert automatic_cutoff(np.column_stack([slow, fast]), 500.0) == pytest.approx(15.0, rel=0.15)
    assert automatic_cutoff(np.zeros((100, 2)), 100.0) == 2.0
    assert automatic_cutoff(np.sin(40 * t)[:, None], 500.0) == 50.0  # a tenth of the rate


@pytest.mark.parametrize("delay", [0.0, 3.0, -2.25, 17.4, 140.0])
def test_a_known_delay_is_found_to_a_thousandth_of_a_sample(delay: float):
    rng = np.random.default_rng(7)
    t = np.arange(500) * 2 * np.pi / 500
    x = np.column_stack([np.sin(t) + 0.3 * np.sin(4 * t), np.cos(2 * t)])
    late = periodic_shift(x, delay)
    assert periodic_delay(x, late) == pytest.approx(delay, abs=1e-7)
    noisy = late + 1e-4 * rng.normal(size=x.shape)
    # Deviation of the best estimate: noise / (slope a sample · √samples) = 1e-4 / (0.02 · 30) = 2e-4.
    assert periodic_delay(x, noisy) == pytest.approx(delay, abs=1e-3)


def test_the_delay_of_something_that_stands_still_is_none():
    assert periodic_delay(np.ones((50, 1)), np.ones((50, 1))) == 0.0


def test_shifting_there_and_back_gives_the_signal_again():
    x = np.random.default_rng(8).normal(size=(101, 2))
    np.testing.assert_allclose(periodic_shift(periodic_shift(x, 0.37), -0.37), x, atol=1e-13)
    np.testing.assert_allclose(periodic_shift(x, 5.0), np.roll(x, 5, axis=0), atol=1e-13)
