"""Passes over the channels of a recording: every build is the twin, whatever the pieces, tiles and threads are."""

from __future__ import annotations

import numpy as np
import pytest

from armid.kernel.channels import passes
from armid.kernel.channels.passes import (
    decimate,
    filter_columns,
    heights,
    speeds,
    third_differences,
    trapezoidal_sections,
    zero_phase,
)
from armid.maths.signals.zero_phase_filters import butterworth, gain, settling_samples
from problems import COMPILED, TWIN

RATE = 1000.0

CANCELS = 20.0
"""Factor on the rounding of the twin's gain, which loses digits by the square of the ratio of rate to cut-off."""

DIFFERENCES = 1e-12
"""Largest difference of sums in another order, divided by the largest value."""


def signals(rng: np.random.Generator, samples: int, channels: int) -> np.ndarray:
    """Slow motion with a drift, and noise."""
    t = np.arange(samples)[:, None] / RATE
    return np.sin(2.0 * np.pi * 0.7 * t + np.arange(channels)) + 0.3 * t + 1e-4 * rng.normal(size=(samples, channels))


def lost(cutoff: float) -> float:
    return CANCELS * np.finfo(float).eps * (RATE / cutoff) ** 2


@pytest.mark.parametrize("order", [1, 2, 3, 4, 7, 8])
def test_trapezoidal_sections_are_the_filter(order: int):
    """The squared response of the state-space form to sines is the gain of both directions."""
    filter = butterworth(order, 40.0, RATE)
    frequency = np.array([0.001, 0.02, 0.04, 0.1, 0.3])
    z, response = np.exp(2j * np.pi * frequency), np.ones(5, dtype=complex)
    for c1, c2, c3 in trapezoidal_sections(filter):
        A = np.array([[c1, -c2], [c2, 1.0 - c3]])
        B = np.array([c2, c3])
        states = np.array([np.linalg.solve(each * np.eye(2) - A, B) for each in z])
        response *= 0.5 * (z + 1.0) * states[:, 1]
    assert np.allclose(np.abs(response) ** 2, gain(filter, frequency), rtol=lost(40.0), atol=1e-15)


@pytest.mark.parametrize("channels", [1, 3, 7, 8, 9, 17])
@pytest.mark.parametrize("order", [1, 4, 5])
def test_every_build_filters_as_the_twin(channels: int, order: int):
    """Channels that fill a part of a register, all of it, and more than two."""
    cutoff, samples = 20.0, 3001
    x = signals(np.random.default_rng(channels), samples, channels)
    filter = butterworth(order, cutoff, RATE)
    twin = zero_phase(filter, x, RATE, 2, chosen=TWIN)
    # A difference quotient multiplies the rounding of the values by the rate.
    largest = np.abs(x).max() * RATE ** np.arange(3.0)
    for build in COMPILED:
        for k, (found, known) in enumerate(zip(zero_phase(filter, x, RATE, 2, chosen=build), twin, strict=True)):
            assert np.abs(found - known).max() <= lost(cutoff) * largest[k]
        assert np.array_equal(
            zero_phase(filter, x, RATE, 0, chosen=build)[0], zero_phase(filter, x, RATE, 1, chosen=build)[0]
        )


@pytest.mark.parametrize("build", COMPILED)
def test_neither_pieces_nor_threads_change_the_result(build: str, monkeypatch: pytest.MonkeyPatch):
    cutoff = 60.0
    filter = butterworth(4, cutoff, RATE)
    x = signals(np.random.default_rng(0), 7000, 7)
    whole = zero_phase(filter, x, RATE, 2, chosen=build)
    monkeypatch.setattr(passes, "PIECE", 1)  # eight times the settling time
    assert 8 * settling_samples(filter, passes.SETTLED) < len(x) / 3
    parts = zero_phase(filter, x, RATE, 2, chosen=build)
    for k, (found, known) in enumerate(zip(parts, whole, strict=True)):
        assert np.abs(found - known).max() <= lost(cutoff) * RATE**k
    for threads in (2, 3, 50):
        for found, known in zip(zero_phase(filter, x, RATE, 2, threads=threads, chosen=build), parts, strict=True):
            assert np.array_equal(found, known)


@pytest.mark.parametrize("build", (*COMPILED, TWIN))
def test_straight_lines_pass_and_small_values_are_zero(build: str):
    filter = butterworth(4, 20.0, RATE)
    line = np.arange(2000.0)[:, None] * np.array([0.01, -3.0]) + np.array([5.0, -1.0])
    value, first, second = zero_phase(filter, line, RATE, 2, chosen=build)
    assert np.allclose(value, line, rtol=1e-12, atol=1e-9)
    assert np.allclose(first, np.array([10.0, -3000.0]), rtol=1e-8)
    assert np.abs(second).max() < 1e-4  # rounding of the values, times the square of the rate
    moved = np.concatenate([np.zeros((1500, 1)), np.sin(np.arange(1500.0) / 50.0)[:, None], np.zeros((1500, 1))])
    value, first = zero_phase(filter, moved, RATE, 1, least=(1e-9, 1e-6), chosen=build)
    for each, least in ((value, 1e-9), (first, 1e-6)):
        inner = np.abs(each[3:-3])
        assert (inner[:100] == 0.0).all() and (inner[-100:] == 0.0).all() and (inner[1600:2800] > 0.0).any()
        assert not ((inner > 0.0) & (inner < least)).any()


@pytest.mark.parametrize("channels", [1, 7, 8, 17])
def test_speeds_and_third_differences_are_those_of_the_twin(channels: int):
    """Whole runs, tiles inside, tiles at the ends, and tiles shorter than a register."""
    rng = np.random.default_rng(channels)
    samples, half = 500, 12
    q, time = signals(rng, samples, channels), np.arange(samples) / RATE + 2e-4 * rng.uniform(size=samples)
    for begin, end in ((0, samples), (100, 299), (samples - 20, samples), (3, 4)):
        known = speeds(q, half, RATE, begin, end, chosen=TWIN)
        last = min(end, samples - 3)
        third, smallest = third_differences(q, time, begin, last, chosen=TWIN)
        for build in COMPILED:
            assert np.allclose(
                speeds(q, half, RATE, begin, end, chosen=build), known, rtol=0.0, atol=DIFFERENCES * RATE
            )
            found, least = third_differences(q, time, begin, last, chosen=build)
            assert np.allclose(found, third, rtol=0.0, atol=DIFFERENCES)
            assert np.array_equal(least, smallest)


@pytest.mark.parametrize("channels", [1, 7, 8, 17])
@pytest.mark.parametrize(("step", "length"), [(1, 1), (3, 7), (8, 105)])
def test_decimated_channels_are_those_of_the_twin(channels: int, step: int, length: int):
    """Numbers of rows that fill the kernel's groups and that do not, also up to the last sample."""
    rng = np.random.default_rng(channels)
    x, taps = rng.normal(size=(500, channels)), rng.normal(size=length)
    most = (500 - length) // step + 1
    for first, rows in ((0, most), (0, 1), (5, (495 - length) // step + 1), (2, 3)):
        known = decimate(x, taps, step, first, rows, chosen=TWIN)
        for build in COMPILED:
            found = decimate(x, taps, step, first, rows, chosen=build)
            assert np.allclose(found, known, rtol=0.0, atol=1e-13 * length)  # rounding of sums in another order


def test_a_value_that_is_no_number_spoils_the_filtered_values_of_its_channel_alone():
    x = np.ones((200, 3))
    x[100, 1] = np.nan
    for build in (TWIN, *COMPILED):
        found = decimate(x, np.full(11, 1.0 / 11.0), 5, 0, 38, chosen=build)
        spoilt = [r for r in range(38) if 5 * r <= 100 < 5 * r + 11]
        assert np.flatnonzero(np.isnan(found[:, 1])).tolist() == spoilt
        assert np.isfinite(found[:, [0, 2]]).all()


@pytest.mark.parametrize("length", [1, 2, 3, 10])
def test_heights_of_runs_are_those_of_the_twin(length: int):
    """Numbers of runs below and above the width of a register; maxima and minima are exact."""
    rng = np.random.default_rng(length)
    for runs in (1, 3, 8, 29, 1000):
        padded = np.where(rng.uniform(size=runs + length + 5) < 0.1, 9.0, 1.0) * rng.normal(size=runs + length + 5)
        known = heights(padded, length, chosen=TWIN)
        for build in COMPILED:
            for one, other in zip(heights(padded, length, chosen=build), known, strict=True):
                assert np.array_equal(one, other)


@pytest.mark.parametrize("columns", [1, 3, 8, 17, 33])
@pytest.mark.parametrize(("first", "step"), [(0, 1), (2, 3), (5, 700)])
def test_every_build_filters_columns_as_the_twin(columns: int, first: int, step: int):
    """Columns that fill a part of a register, all of it, and more than two, at all samples and at a few."""
    cutoff, samples = 20.0, 2003
    x = np.ascontiguousarray(signals(np.random.default_rng(columns), samples, columns).T)
    for order in (1, 4, 5):
        filter = butterworth(order, cutoff, RATE)
        twin = filter_columns(filter, x, first, step, chosen=TWIN)
        assert twin.shape == (columns, len(range(first, samples, step)))
        for build in COMPILED:
            found = filter_columns(filter, x, first, step, chosen=build)
            assert np.abs(found - twin).max() <= lost(cutoff) * np.abs(x).max()


def test_a_line_passes_the_filter_of_columns():
    x = np.array([np.linspace(-1.0, 5.0, 900), np.linspace(3.0, 2.0, 900)])
    for build in COMPILED:
        found = filter_columns(butterworth(4, 20.0, RATE), x, chosen=build)
        assert np.abs(found - x).max() <= DIFFERENCES * np.abs(x).max()
