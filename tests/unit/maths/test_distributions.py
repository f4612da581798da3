"""Medians, quantiles and probabilities, against NumPy and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.special

from armid.maths.distributions import chi_squared_survival, student_quantile
from armid.maths.median import median

ROUNDING = 1e-12
"""Relative difference of two ways to the same number in double precision."""


@pytest.mark.parametrize("shape", [(1,), (2,), (7,), (10, 3), (11, 2, 2)])
def test_medians_are_those_of_numpy(shape: tuple[int, ...]):
    x = np.random.default_rng(0).normal(size=shape)
    assert (median(x) == np.median(x, axis=0)).all()
    x[0] = np.nan
    assert np.isnan(median(x)).all()


def test_the_median_of_nothing_and_of_infinite_samples():
    assert np.isnan(median([]))
    assert median([np.inf, np.inf, 1.0, np.inf]) == np.inf
    assert median([3, 1, 2]) == 2.0


def test_quantiles_of_student_are_those_of_scipy():
    draws = np.random.default_rng(0).uniform(1.0, 300.0, (500, 2))
    freedom = np.vstack([draws, [[1.0, 1.001], [2.0, 1e3], [1e6, 1e12], [1e40, np.inf]]])
    np.testing.assert_allclose(student_quantile(freedom), scipy.special.stdtrit(freedom, 0.975), rtol=ROUNDING)


def test_quantiles_below_one_degree_of_freedom():
    assert student_quantile(0.5) == pytest.approx(scipy.special.stdtrit(0.5, 0.975), rel=ROUNDING)


@pytest.mark.parametrize("freedom", [1, 2, 3, 10, 33, 300, 2001])
def test_chi_squared_is_that_of_scipy(freedom: int):
    for share in (0.0, 0.01, 0.5, 1.0, 1.2, 2.0):
        found = chi_squared_survival(freedom, share * freedom)
        assert found == pytest.approx(scipy.special.chdtrc(freedom, share * freedom), rel=ROUNDING)
