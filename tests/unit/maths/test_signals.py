"""Filters and derivatives of `armid.maths.signals.zero_phase_filters` on signals whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from armid.errors import ArmidError
from armid.maths.signals.decimation import decimate, decimation_filter, decimation_step, interpolate
from armid.maths.signals.derivatives import central_difference, periodic_derivative
from armid.maths.signals.zero_phase_filters import (
    butterworth,
    edge_samples,
    filtered_derivatives,
    fir,
    gain,
    low_pass,
    periodic_filter,
    settling_samples,
    zero_phase,
)

ROUNDING = 1e-12
"""Sums of a few thousand products of order one in double precision."""

PRECISION_OF_SECTIONS = 1e-8
"""A section at 3 Hz of 8 kHz cancels to 6e-6 of its coefficients, which leaves 1e-10 each, ten of them in a row; the
recursion loses as much."""


def closed_motion(samples: int, harmonics: int = 8, period: float = 20.0, seed: int = 0):
    """One period of a Fourier series with its first two derivatives, shapes (N, 3)."""
    rng = np.random.default_rng(seed)
    w = 2 * np.pi / period * np.arange(1, harmonics + 1)
    t = np.arange(samples) * period / samples
    a, b = rng.normal(size=(2, 3, harmonics)) / np.arange(1, harmonics + 1)
    s, c = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    return s @ a.T + c @ b.T, (c * w) @ a.T - (s * w) @ b.T, -(s * w**2) @ a.T - (c * w**2) @ b.T


def test_order_20_at_3_hz_of_8_khz_works_where_the_transfer_function_is_nan():
    b, a = scipy.signal.butter(20, 3.0, fs=8000.0)
    x = closed_motion(16000)[0]
    direct = scipy.signal.lfilter(b, a, x, axis=0)
    assert not np.isfinite(direct).all()
    sections = butterworth(20, 3.0, 8000.0)
    assert sections.shape == (10, 6)
    y = zero_phase(sections, x)
    assert np.isfinite(y).all() and np.abs(y).max() < 1.1 * np.abs(x).max()


def test_gain_is_a_half_at_the_cutoff_and_one_at_rest():
    for order in (1, 4, 20):
        sections = butterworth(order, 3.0, 8000.0)
        g = gain(sections, np.array([0.0, 3.0 / 8000.0]))
        # Both passes together: |H|² = 1/2 at the cut-off.
        np.testing.assert_allclose(g, [1.0, 0.5], atol=PRECISION_OF_SECTIONS)


def test_gain_is_that_of_the_analytic_butterworth():
    sections = butterworth(20, 3.0, 8000.0)
    f = np.linspace(0.0, 12.0, 50)
    warped = np.tan(np.pi * f / 8000.0) / np.tan(np.pi * 3.0 / 8000.0)  # bilinear transform
    np.testing.assert_allclose(gain(sections, f / 8000.0), 1 / (1 + warped**40), atol=PRECISION_OF_SECTIONS)


@pytest.mark.parametrize(("order", "cutoff", "rate"), [(4, 5.0, 100.0), (4, 5.0, 8000.0), (20, 3.0, 500.0)])
def test_zero_phase_equals_the_recursion_run_both_ways(order: int, cutoff: float, rate: float):
    x = np.random.default_rng(1).normal(size=(int(40 * rate), 2)).cumsum(axis=0)
    sections = butterworth(order, cutoff, rate)
    pad = settling_samples(sections)
    recursion = scipy.signal.sosfiltfilt(sections, x, axis=0, padtype="odd", padlen=pad)
    assert np.abs(zero_phase(sections, x) - recursion).max() < PRECISION_OF_SECTIONS * np.abs(x).max()


def test_a_short_run_is_filtered_without_a_start_up_transient():
    # Ten samples of a straight line, far fewer than the filter remembers: it must come out as it went in.
    sections = butterworth(4, 5.0, 1000.0)
    line = np.linspace(1.0, 3.0, 10)
    assert settling_samples(sections) > 100 * len(line)
    assert np.abs(zero_phase(sections, line) - line).max() < ROUNDING
    assert np.abs(zero_phase(sections, line[:1]) - line[:1]).max() == 0.0


def test_scipys_default_padding_ruins_the_ends_where_periodic_edges_are_exact():
    # The motion of the thesis' experiment: 27 s, order 20 at 3 Hz, ten harmonics up to 0.37 Hz, at rest at both ends.
    rate, period = 1000.0, 27.0
    t = np.arange(int(rate * period)) / rate
    w = 2 * np.pi / period
    q = 1.2 * (np.cos(w * t) - np.cos(9 * w * t))[:, None]
    sections = butterworth(20, 3.0, rate)
    default = np.abs(scipy.signal.sosfiltfilt(sections, q, axis=0) - q).max()
    settled = np.abs(zero_phase(sections, q) - q).max()
    periodic = np.abs(periodic_filter(sections, q) - q).max()
    assert default > 0.05  # rad, the order of the 0.13 that the thesis' tables give
    assert settled < 0.01 * default  # the odd reflection misses only the curvature
    assert periodic < 1e-6


def test_settling_follows_the_slowest_pole():
    sections = butterworth(4, 5.0, 1000.0)
    _, p, _ = scipy.signal.butter(4, 5.0, fs=1000.0, output="zpk")
    assert np.abs(p).max() ** settling_samples(sections) <= 1e-9 < np.abs(p).max() ** (settling_samples(sections) - 1)
    impulse = np.zeros(20001)
    impulse[10000] = 1.0
    kernel = np.abs(periodic_filter(sections, impulse))
    # Residues of a fourth-order filter are of order one: a decade of room.
    assert kernel[10000 + settling_samples(sections) :].max() < 1e-8 * kernel.max()


@pytest.mark.parametrize("order", [2, 4, 20])
def test_beyond_the_edge_a_hundredth_of_the_kernel_is_left(order: int):
    sections = butterworth(order, 3.0, 500.0)
    impulse = np.zeros(20001)
    impulse[10000] = 1.0
    kernel = np.abs(periodic_filter(sections, impulse))
    edge = edge_samples(sections)
    assert kernel[10000 + edge :].sum() <= 0.01 * kernel.sum() < kernel[10000 + edge - 1 :].sum()


def test_edge_and_settling_of_taps_end_with_them():
    taps = fir(4, 5.0, 100.0)
    assert settling_samples(taps) == len(taps) // 2 == 40
    assert 0 < edge_samples(taps) <= 40


def test_fir_is_symmetric_flat_at_rest_and_half_at_the_cutoff():
    taps = fir(4, 5.0, 1000.0)
    assert len(taps) == 801 and np.array_equal(taps, taps[::-1])
    # The window's own ripple moves the -6 dB point by its stop band, 60 dB.
    np.testing.assert_allclose(gain(taps, np.array([0.0, 0.005])), [1.0, 0.5], atol=1e-3)
    assert np.abs(gain(taps, np.linspace(0.010, 0.5, 400))).max() < 1e-3


def test_low_pass_names_its_families():
    assert low_pass("none", 4, 0.0, 100.0) is None
    assert np.array_equal(low_pass("butterworth", 4, 5.0, 100.0), butterworth(4, 5.0, 100.0))
    assert np.array_equal(low_pass("fir", 4, 5.0, 100.0), fir(4, 5.0, 100.0))


@pytest.mark.parametrize("cutoff", [0.0, 50.0, 60.0, -1.0])
def test_a_cutoff_outside_the_band_is_refused_with_the_bounds(cutoff: float):
    for family in ("butterworth", "fir"):
        with pytest.raises(ArmidError, match="between 0 and 50 Hz"):
            low_pass(family, 4, cutoff, 100.0)


@pytest.mark.parametrize("step", [2, 5, 8, 40, 320])
def test_decimation_attenuates_100_db_and_is_flat_up_to_half_the_new_nyquist(step: int):
    taps = decimation_filter(step)
    nyquist = 0.5 / step
    stop = np.linspace(1.5 * nyquist, 0.5, 3001)
    flat = np.linspace(0.0, 0.5 * nyquist, 301)
    assert np.abs(gain(taps, stop)).max() < 1e-5
    assert np.abs(gain(taps, flat) - 1).max() < 2e-5
    assert len(taps) % 2 == 1 and len(taps) < 15 * step


def test_decimation_by_one_changes_nothing_and_nonsense_is_refused():
    x = np.arange(6.0)
    assert np.array_equal(decimate(x, decimation_filter(1), 1), x)
    with pytest.raises(ArmidError, match="impossible"):
        decimation_filter(0)
    with pytest.raises(ArmidError, match="impossible"):
        decimation_filter(4, pass_band=1.0)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize(("step", "offset"), [(2, 0), (5, 3), (8, 7), (40, 39)])
def test_decimate_gives_the_rows_of_the_filtered_signal(step: int, offset: int, periodic: bool):
    x = np.random.default_rng(2).normal(size=(400, 2)).cumsum(axis=0)
    taps = decimation_filter(step)
    whole = periodic_filter(taps, x) if periodic else zero_phase(taps, x)
    rows = decimate(x, taps, step, offset, periodic=periodic)
    assert rows.shape == whole[offset::step].shape
    assert np.abs(rows - whole[offset::step]).max() < ROUNDING * np.abs(x).max() * len(taps)


def test_decimation_step_divides_and_leaves_room_for_the_cutoff():
    assert decimation_step(8000.0, 5.0, 320) == 160  # 50 Hz, ten times the cut-off
    assert decimation_step(100.0, 5.0, 4) == 2
    assert decimation_step(100.0, 40.0, 4) == 1
    assert decimation_step(1000.0, 1.0, 7) == 7


def test_central_differences_are_exact_on_parabolas_to_the_ends():
    t = np.arange(12) / 10.0
    x = (2.0 - 3.0 * t + 0.5 * t**2)[:, None]
    np.testing.assert_allclose(central_difference(x, 10.0, 1)[:, 0], -3.0 + t, atol=1e-11)
    # Differences of numbers of order one, times rate² = 100.
    np.testing.assert_allclose(central_difference(x, 10.0, 2)[:, 0], 1.0, atol=1e-10)


def test_the_three_point_second_difference_errs_a_quarter_of_the_first_applied_twice():
    x, _, second = closed_motion(400)
    rate = 400 / 20.0
    once = np.abs(central_difference(x, rate, 2, periodic=True) - second).max()
    first = central_difference(x, rate, 1, periodic=True)
    twice = np.abs(central_difference(first, rate, 1, periodic=True) - second).max()
    assert twice / once == pytest.approx(4.0, rel=0.1)  # leading terms; 8 harmonics at 50 samples a period


def test_central_differences_refuse_three_samples_and_third_derivatives():
    with pytest.raises(ArmidError, match="at least 4 samples"):
        central_difference(np.zeros((3, 1)), 1.0)
    with pytest.raises(ArmidError, match="must be 1 or 2; found 3"):
        central_difference(np.zeros((9, 1)), 1.0, 3)


@pytest.mark.parametrize("samples", [400, 401])
def test_periodic_derivatives_are_exact_on_a_fourier_series(samples: int):
    x, first, second = closed_motion(samples)
    rate = samples / 20.0
    assert np.abs(periodic_derivative(x, rate, 1) - first).max() < 1e-10
    assert np.abs(periodic_derivative(x, rate, 2) - second).max() < 1e-10


def test_filtered_derivatives_of_a_run_in_the_band_are_those_of_the_motion():
    x, first, second = closed_motion(2000)
    rate = 100.0
    sections = butterworth(4, 10.0, rate)
    value, dx, ddx = filtered_derivatives(sections, x, rate, periodic=True)
    # The gain at the eighth harmonic, 0.4 Hz, is 1 - (0.4/10)^8 = 1 - 7e-12.
    assert np.abs(value - x).max() < 1e-9
    assert np.abs(dx - first).max() < 1e-9
    assert np.abs(ddx - second).max() < 1e-8
    inner = slice(edge_samples(sections), -edge_samples(sections))
    value, dx, ddx = filtered_derivatives(sections, x, rate)
    assert np.array_equal(value, zero_phase(sections, x))
    # A hundredth of the kernel leans on the reflected end, whose acceleration has the wrong sign.
    assert np.abs(dx - first)[inner].max() < 1e-3 * np.abs(first).max()
    assert np.abs(ddx - second)[inner].max() < 0.02 * np.abs(second).max()
    assert np.abs(dx - first)[500:-500].max() < 1e-8  # five seconds in, nothing of the ends is left


def test_filtered_derivatives_of_a_line_are_its_slope():
    line = np.multiply.outer(np.arange(50.0), [1.0, -2.0])
    value, dx, ddx = filtered_derivatives(butterworth(4, 5.0, 100.0), line, 100.0)
    assert np.abs(value - line).max() < ROUNDING * 100
    assert np.abs(dx - [100.0, -200.0]).max() < 1e-10
    assert np.abs(ddx).max() < 1e-8


def test_time_may_run_along_another_axis():
    x = np.random.default_rng(3).normal(size=(2, 60))
    sections = butterworth(2, 5.0, 50.0)
    assert np.array_equal(zero_phase(sections, x, axis=1), zero_phase(sections, x.T).T)
    assert np.array_equal(periodic_filter(sections, x, axis=1), periodic_filter(sections, x.T).T)


def test_a_kernel_longer_than_the_period_wraps_around():
    x = np.random.default_rng(4).normal(size=(30, 1))
    taps = fir(4, 5.0, 100.0)  # 81 taps over 30 samples
    long = periodic_filter(taps, np.tile(x, (5, 1)))
    assert np.abs(long[:30] - periodic_filter(taps, x)).max() < ROUNDING * 10


@pytest.mark.parametrize("factor", [1, 2, 7, 40])
@pytest.mark.parametrize("periodic", [True, False])
def test_interpolation_fills_in_what_decimation_left_out(factor: int, periodic: bool):
    samples = 200
    fine = np.arange(samples * factor) / factor
    phases = np.array([0.0, 1.0])[:, None]
    frequency = 20 / samples  # whole periods, at a fifth of the Nyquist frequency: inside the flat pass band
    x = np.cos(2 * np.pi * frequency * fine + phases)
    made = interpolate(x[:, ::factor], factor, periodic=periodic)
    kept = slice(None) if periodic else slice(10 * factor, -10 * factor)  # reflected ends are a guess
    assert made.shape == x.shape
    assert np.abs(made - x)[:, kept].max() < INTERPOLATION_RIPPLE


INTERPOLATION_RIPPLE = 1e-4
"""A hundred decibels are 1e-5 for each of the images that fold into the gaps, and there are a few of them."""
