"""Statistics of channels tile by tile: those of NumPy, whatever the number of rows is."""

from __future__ import annotations

import numpy as np
import pytest

from armid.kernel.channels.passes import third_differences
from armid.maths.median import LARGE, median
from armid.measurement.processing.channels import position_noise as noise_module
from armid.measurement.processing.channels.position_noise import position_noise
from armid.measurement.processing.channels.speed_tiles import SpeedTiles
from armid.measurement.processing.channels.statistics import (
    TILE,
    extremes,
    interpolated,
    outside,
    standard_deviation,
)

SIZES = (1, 5, 511, 512, 513, TILE, TILE + 1, 2 * TILE + 700)


@pytest.mark.parametrize("samples", SIZES)
def test_reductions_are_those_of_numpy(samples: int):
    rng = np.random.default_rng(samples)
    x = rng.normal(size=(samples, 7)) + np.array([0.0, 1e6, -3.0, 5.0, 0.0, 1.0, 2.0])
    low, high = extremes(x)
    assert np.array_equal(low, x.min(axis=0)) and np.array_equal(high, x.max(axis=0))
    a, b = np.quantile(x, 0.05, axis=0), np.quantile(x, 0.8, axis=0)
    assert np.array_equal(outside(x, a, b), ((x <= a) | (x >= b)).sum(axis=0))
    assert np.allclose(standard_deviation(x), x.std(axis=0), rtol=1e-9, atol=1e-12)  # rounding of the values at 1e6


def test_a_few_values_are_interpolated_as_by_numpy():
    rng = np.random.default_rng(0)
    time, x = np.cumsum(rng.uniform(0.5, 1.5, 300)), rng.normal(size=(300, 3))
    wanted = np.linspace(time[0], time[-1], 77)
    assert np.allclose(interpolated(wanted, time, x), np.column_stack([np.interp(wanted, time, c) for c in x.T]))


@pytest.mark.parametrize("samples", [LARGE + 1, LARGE + 2])
@pytest.mark.parametrize("kind", ["normal", "ties", "sorted", "rounded", "late", "nan"])
def test_the_median_of_many_is_that_of_all(samples: int, kind: str):
    """Also where the samples that give the interval say nothing about the others, or where many are equal."""
    x = np.random.default_rng(1).normal(size=samples)
    if kind == "ties":
        x = np.round(x)
    if kind == "sorted":
        x.sort()
    if kind == "rounded":
        x = 1e-3 + 1e-19 * np.round(10.0 * x)
    if kind == "late":
        x[:: samples // 4096] = 100.0
    if kind == "nan":
        x[7] = np.nan
    known = np.sort(x)
    middle = (known[(samples - 1) // 2] + known[samples // 2]) / 2.0
    assert np.array_equal(median(x), np.nan if kind == "nan" else middle, equal_nan=True)


@pytest.mark.parametrize("kind", ["even", "changing", "at rest", "outside"])
def test_the_noise_of_many_positions_is_the_median_of_all(kind: str, monkeypatch: pytest.MonkeyPatch):
    """Noise everywhere; little noise at first; more rest than motion; a median outside of the interval."""
    rng = np.random.default_rng(2)
    samples = 2 * noise_module.SAMPLED * noise_module.PIECE + 40_000
    time = np.arange(samples) / 1000.0
    size = np.full(samples, 1e-5)
    if kind == "changing":
        size[: samples // 2] = 1e-7
    q = np.sin(time)[:, None] * np.array([1.0, 0.2]) + size[:, None] * rng.normal(size=(samples, 2))
    if kind == "at rest":
        q[: 2 * samples // 3, 1] = 0.25
    if kind == "outside":
        monkeypatch.setattr(noise_module, "AROUND", (0.8, 0.9))
    third, smallest = third_differences(q, time, 0, samples - 3)
    known = np.maximum(1.4826 * np.median(third, axis=1), smallest / np.sqrt(12.0))
    assert np.array_equal(position_noise(q, time), known)


def test_speeds_tile_by_tile_are_those_of_the_whole():
    rng = np.random.default_rng(3)
    q = np.cumsum(rng.normal(size=(40_000, 3)), axis=0) * 1e-3
    for held in (0, 9):
        tiles = SpeedTiles(q, 9, 1000.0, held)
        whole = tiles.between(0, len(q))
        parts = list(tiles.tiles())
        assert [part.start for part, _ in parts[1:]] == [part.stop for part, _ in parts[:-1]]
        assert np.allclose(np.concatenate([v for _, v in parts], axis=1), whole, rtol=0.0, atol=1e-9)
        if held:
            assert (whole[:, :held] == whole[:, [held]]).all() and (whole[:, -held:] == whole[:, [-held - 1]]).all()
        assert np.allclose(tiles.rms(), np.sqrt(np.mean(whole**2, axis=1)))
        limit = np.quantile(whole, 0.3, axis=1)
        single, (together,) = tiles.below(limit, [0, 2], [2.0 * limit])
        sure = np.abs(whole - limit[:, None]) > 1e-9  # tiles sum in another order
        assert np.array_equal(single[sure], (whole < limit[:, None])[sure])
        assert together.sum() == pytest.approx((whole[[0, 2]] < 2.0 * limit[[0, 2], None]).all(axis=0).sum(), abs=2)
