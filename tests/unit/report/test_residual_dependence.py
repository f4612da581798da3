"""Dependence of a residual on the velocity that repeats in both halves of a motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from armid.report.data.residual_dependence import REPEATED_SHARE, classes, repeated_share

ROWS = 1400
"""Rows of a recording of one minute at 25 Hz."""


def velocity() -> np.ndarray:
    t = np.arange(ROWS) / 25.0
    return np.sin(0.7 * t) + 0.5 * np.sin(1.9 * t + 1.0) + 0.3 * np.cos(4.1 * t)


@pytest.mark.parametrize("seconds", [0.0, 0.1, 0.3])
def test_noise_does_not_depend_on_the_velocity(seconds: float):
    """Correlated over so many seconds; a class of a half has 60 rows, so that chance alone gives a negative share."""
    pole = np.exp(-0.04 / seconds) if seconds else 0.0
    rng = np.random.default_rng(2)
    label = classes(velocity())
    shares = [repeated_share(lfilter([1.0], [1.0, -pole], rng.normal(size=ROWS)), label) for _ in range(100)]
    assert np.mean(np.array(shares) > REPEATED_SHARE) <= 0.01  # at most one recording in a hundred


def test_friction_of_another_form_is_found_and_a_law_of_one_half_is_not():
    rng, dq = np.random.default_rng(3), velocity()
    law = np.exp(-((dq / 0.3) ** 2)) * np.sign(dq)
    noise = rng.normal(size=ROWS) * np.std(law)
    found = repeated_share(noise + 0.5 * law, classes(dq))
    assert found == pytest.approx(0.2, abs=0.08)  # a fifth of the variance, but for noise and the width of classes
    once = np.where(np.arange(ROWS) < ROWS // 2, law, 0.0)
    assert repeated_share(noise + 0.5 * once, classes(dq)) < REPEATED_SHARE
    assert np.isnan(repeated_share(np.full(ROWS, np.nan), classes(dq)))
