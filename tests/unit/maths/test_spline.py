"""Cubic splines and mean spectra of `armid.maths` beside SciPy's, whose import they spare."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.interpolate
import scipy.signal

from armid.maths.signals.fourier_transform import power_spectrum
from armid.maths.spline import spline, spline_slopes

ROUNDING = 1e-11
"""Of the largest value: two eliminations of one system, whose condition grows with the ratio of steps, to 100."""


@pytest.mark.parametrize("samples", [2, 3, 4, 5, 6, 50, 2000])
@pytest.mark.parametrize("shape", [(), (3,), (2, 2)])
def test_splines_are_those_of_scipy(samples: int, shape: tuple[int, ...]):
    rng = np.random.default_rng(samples)
    time = rng.uniform(0.01, 1.0, samples).cumsum()
    x = rng.normal(size=(samples, *shape))
    at = np.concatenate([time, rng.uniform(time[0] - 0.1, time[-1] + 0.1, 100)])
    peer = scipy.interpolate.CubicSpline(time, x, axis=0)
    for found, known in ((spline(time, x, at), peer(at)), (spline_slopes(time, x), peer(time, 1))):
        np.testing.assert_allclose(found, known, rtol=0, atol=ROUNDING * np.abs(known).max())


def test_cubics_are_met_exactly():
    time = np.random.default_rng(1).uniform(0.1, 1.0, 20).cumsum()
    x, slope = 1 - time + 0.5 * time**3, -1 + 1.5 * time**2
    np.testing.assert_allclose(spline_slopes(time, x), slope, atol=ROUNDING * slope.max())


@pytest.mark.parametrize(("samples", "segment"), [(512, 512), (5000, 512), (1301, 101)])
def test_mean_spectra_are_those_of_scipy(samples: int, segment: int):
    x = np.random.default_rng(2).normal(size=(samples, 2)).cumsum(axis=0)
    options = {"window": "blackmanharris", "nperseg": segment, "noverlap": segment - segment // 2, "axis": 0}
    frequency, power = power_spectrum(x, 100.0, segment)
    known_frequency, known = scipy.signal.welch(x, 100.0, **options)
    np.testing.assert_allclose(frequency, known_frequency, rtol=ROUNDING)
    np.testing.assert_allclose(power, known, rtol=0, atol=ROUNDING * known.max())
