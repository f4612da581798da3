"""The test of whiteness: as often wrong as it says, and quick to see what is not white."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from armid.checked_array import Array
from armid.estimation.uncertainty.cross_products_by_frequency import BandProducts, band_products, residual_moments
from armid.estimation.uncertainty.noise_spectrum import NoiseModel
from armid.estimation.uncertainty.whiteness import spectrum_test, variance_test, whiteness
from noisy import OLS, RATE, coloured, dense, once

RECORDINGS = 400


@cache
def setting() -> tuple[BandProducts, NoiseModel, Array, Array]:
    """Products and equations of a recording of 12 s, and its dense rows."""
    given = once(0, 12.0, memory=0.0)
    fit = OLS.solve(given)
    bands = band_products(given, fit.values)
    X, _ = dense(given)
    A = X.reshape(-1, X.shape[2])
    return bands, NoiseModel(bands, np.ones(2), np.linalg.inv(A.T @ A)), X, np.linalg.pinv(A)


def probabilities(noise: Array) -> tuple[float, float, float]:
    """Probabilities of the whole test, of its spectrum and of its variances."""
    bands, model, X, inverse = setting()
    residual = noise - X @ (inverse @ noise.ravel())
    moments, squares = residual_moments(residual.T, RATE, bands), (residual**2).sum(axis=0)
    cut = np.arange(10) * len(X) // 10
    counts = np.diff([*cut, len(X)])[:, None] * np.ones(2)
    pieces = np.stack([np.add.reduceat(residual**2, cut, axis=0), counts], axis=1)
    rows = np.full(2, len(X))
    return (
        whiteness(model, moments, squares, pieces, rows),
        spectrum_test(model, moments, squares, rows),
        variance_test(pieces, model.weights, False),
    )


def shares(memory: float = 0.0, change: Array | float = 1.0, level: float = 0.05) -> Array:
    """Shares of recordings that are called coloured, by each of the three."""
    samples = len(setting()[2])
    found = [probabilities(coloured(np.random.default_rng(k), samples, memory) * change) for k in range(RECORDINGS)]
    return np.mean(np.array(found) < level, axis=0)


def test_white_noise_is_called_coloured_as_often_as_the_level_says():
    # 5 % of 400 is known to one in a hundred; squares of few normal numbers have longer tails than chi-squared's.
    found = shares()
    assert (found < 0.09).all() and (found > 0.01).all()


def test_levels_of_torque_do_not_matter():
    samples = len(setting()[2])
    noise = np.random.default_rng(1).normal(size=(samples, 2))
    np.testing.assert_allclose(probabilities(noise), probabilities(1e-3 * noise))


@pytest.mark.parametrize(("memory", "power"), [(0.02, 0.5), (0.1, 1.0)])
def test_correlation_in_time_is_seen(memory: float, power: float):
    """A memory of one row, and of five."""
    assert shares(memory)[1] >= power


def test_correlation_between_joints_is_seen():
    mixing = np.array([[1.0, 0.2], [0.0, np.sqrt(0.96)]])
    samples = len(setting()[2])
    found = [probabilities(np.random.default_rng(k).normal(size=(samples, 2)) @ mixing)[1] for k in range(100)]
    assert np.mean(np.array(found) < 0.05) > 0.5


def test_variance_that_changes_is_seen():
    """Half as loud in one half of the time, or in one of the joints."""
    samples = len(setting()[2])
    half = np.where(np.arange(samples) < samples // 2, 1.0, 0.5)[:, None]
    assert shares(change=half)[2] == 1.0
    assert shares(change=np.array([1.0, 0.5]))[2] == 1.0
