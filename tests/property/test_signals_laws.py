"""Laws of filters, derivatives and resampling on random signals, filters and clocks."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from armid.maths.signals.decimation import decimate, decimation_filter
from armid.maths.signals.delay import periodic_delay, periodic_shift
from armid.maths.signals.derivatives import periodic_derivative
from armid.maths.signals.resampling import resample
from armid.maths.signals.zero_phase_filters import (
    butterworth,
    filtered_derivatives,
    fir,
    gain,
    periodic_filter,
    zero_phase,
)

LINEAR = 1e-11
"""Relative to the largest sample: rounding of transforms over at most 10⁵ continued samples, and of the line through
the ends, which is as large as the signal."""

MEMORY = 1e-8
"""Largest effect of the past on a settled filter: 1e-9, times jumps of a few times the signal."""

EXACT = 1e-10
"""Of derivatives of a Fourier series of order one; ω² is at most 40."""

RATE = 100.0

quick = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**32 - 1)
lengths = st.integers(2, 400)


@st.composite
def filters(draw: st.DrawFn):
    cutoff = draw(st.floats(1.0, 20.0))
    if draw(st.booleans()):
        return butterworth(draw(st.integers(1, 20)), cutoff, RATE)
    return fir(draw(st.integers(1, 8)), cutoff, RATE)


def signals(seed: int, samples: int, columns: int = 3):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(samples, columns)).cumsum(axis=0) + 10 * rng.normal(size=columns)


def close(have: np.ndarray, want: np.ndarray, scale: float, tolerance: float = LINEAR) -> bool:
    return have.shape == want.shape and bool(np.abs(have - want).max(initial=0.0) <= tolerance * max(scale, 1.0))


@quick
@given(filters(), seeds, lengths)
def test_zero_phase_does_not_know_the_direction_of_time(low, seed, samples):
    x = signals(seed, samples)
    for apply in (zero_phase, periodic_filter):
        assert close(apply(low, x[::-1])[::-1], apply(low, x), np.abs(x).max(), MEMORY)


@quick
@given(filters(), seeds, lengths, st.integers(1, 12), st.integers(0, 20))
def test_a_step_picks_samples_of_the_filtered_signal(low, seed, samples, step, first):
    x = signals(seed, samples)
    assert close(zero_phase(low, x, first=first, step=step), zero_phase(low, x)[first::step], np.abs(x).max(), MEMORY)


@quick
@given(filters(), seeds, lengths)
def test_the_same_filter_on_columns_and_torque_keeps_their_equation(low, seed, samples):
    # If torque = columns · parameters, then so after filtering both: the reason to filter both sides.
    columns = signals(seed, samples, 5)
    parameters = np.random.default_rng(seed).normal(size=5)
    for apply in (zero_phase, periodic_filter):
        assert close(apply(low, columns @ parameters), apply(low, columns) @ parameters, np.abs(columns).max() * 10)


@quick
@given(seeds, st.integers(2, 12), st.integers(0, 5), lengths, st.booleans())
def test_decimation_keeps_the_equation_too(seed, step, offset, samples, periodic):
    columns = signals(seed, samples, 5)
    parameters = np.random.default_rng(seed).normal(size=5)
    taps = decimation_filter(step)
    one = decimate(columns @ parameters, taps, step, offset, periodic=periodic)
    other = decimate(columns, taps, step, offset, periodic=periodic) @ parameters
    assert one.shape == (len(range(offset, samples, step)),)
    assert not one.size or close(one, other, np.abs(columns).max() * 100)


@quick
@given(filters(), seeds, lengths)
def test_straight_lines_and_end_samples_pass(low, seed, samples):
    x = signals(seed, samples)
    scale = np.abs(x).max()
    y = zero_phase(low, x)
    assert close(y[[0, -1]], x[[0, -1]], scale, MEMORY)
    line = np.linspace(x[0], x[-1], samples)
    assert close(zero_phase(low, line), line, scale)


@quick
@given(filters(), seeds, lengths, st.integers(0, 400))
def test_a_periodic_filter_commutes_with_turning_the_circle(low, seed, samples, turn):
    x = signals(seed, samples)
    turned = periodic_filter(low, np.roll(x, turn, axis=0))
    assert close(turned, np.roll(periodic_filter(low, x), turn, axis=0), np.abs(x).max())


@quick
@given(filters(), seeds, st.integers(2, 150), st.integers(2, 4))
def test_a_periodic_filter_does_not_know_how_many_periods_it_sees(low, seed, samples, periods):
    x = signals(seed, samples)
    many = periodic_filter(low, np.tile(x, (periods, 1)))
    assert close(many, np.tile(periodic_filter(low, x), (periods, 1)), np.abs(x).max(), 1e-8)  # sections' rounding


@quick
@given(filters(), st.integers(1, 40), st.floats(0.0, 6.0))
def test_a_sine_comes_out_times_the_gain_at_its_frequency(low, cycles, phase):
    samples = 200
    x = np.sin(2 * np.pi * cycles * np.arange(samples) / samples + phase)
    assert close(periodic_filter(low, x), gain(low, np.array([cycles / samples]))[0] * x, 1.0)


@quick
@given(seeds, st.integers(20, 300), st.integers(1, 9))
def test_periodic_derivatives_are_exact_on_fourier_series(seed, samples, harmonics):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, harmonics)) / harmonics
    w = 2 * np.pi / 10.0 * np.arange(1, harmonics + 1)
    t = np.arange(samples) * 10.0 / samples
    s, c = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    x = s @ a + c @ b
    assert close(periodic_derivative(x, samples / 10.0, 1), (c * w) @ a - (s * w) @ b, 10.0, EXACT)
    assert close(periodic_derivative(x, samples / 10.0, 2), -(s * w**2) @ a - (c * w**2) @ b, 40.0, EXACT)


@quick
@given(filters(), seeds, st.integers(10, 300), st.booleans())
def test_filtering_and_differentiating_commute(low, seed, samples, periodic):
    x = signals(seed, samples)
    value, first, _ = filtered_derivatives(low, x, RATE, periodic=periodic)
    assert close(value, periodic_filter(low, x) if periodic else zero_phase(low, x), np.abs(x).max())
    if periodic:
        other = periodic_filter(low, periodic_derivative(x, RATE, 1))
        assert close(first, other, np.abs(x).max() * RATE * np.pi)


@quick
@given(seeds, st.integers(8, 200))
def test_resampling_is_exact_on_cubics_at_any_clock(seed, samples):
    rng = np.random.default_rng(seed)
    t = rng.uniform(0.2, 1.8, samples).cumsum() / samples
    grid = np.linspace(t[0], t[-1], 3 * samples)
    c = rng.normal(size=4)
    x = np.column_stack([np.polyval(c, t), np.polyval(c[1:], t)])
    want = np.column_stack([np.polyval(c, grid), np.polyval(c[1:], grid)])
    # Steps differ by a factor of nine, which the spline's equations see squared.
    assert close(resample(t, x, grid), want, np.abs(x).max(), 1e-9)


@quick
@given(seeds, st.integers(60, 300), st.floats(-25.0, 25.0))
def test_any_delay_is_recovered(seed, samples, delay):
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * np.arange(samples) / samples
    # The first harmonic dominates, so that the correlation has one top.
    x = np.column_stack([np.sin(angle + k) + 0.2 * np.sin(3 * angle + rng.uniform(0, 6)) for k in range(3)])
    found = periodic_delay(x, periodic_shift(x, delay))
    assert abs(found - delay) < 1e-6  # of a sample; where Newton's method stops
