"""Peaks over a threshold: clusters, tails that are known, and rates that are kept on other data."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from armid.checked_array import Array
from armid.maths.peaks_over_threshold import SHAPE_LIMITS, Tail, cluster_peaks, fit_tail

RATE, GAP = 100.0, 0.25


def coloured(rng: np.random.Generator, seconds: float, decay: float = 0.9) -> Array:
    """Square of AR(1) noise of unit variance, which has an exponential tail."""
    white = rng.standard_normal(int(seconds * RATE))
    return lfilter([np.sqrt(1.0 - decay**2)], [1.0, -decay], white) ** 2


def test_a_cluster_ends_after_a_gap():
    signal = np.array([0.0, 2.0, 3.0, 0.0, 2.5, 0.0, 0.0, 0.0, 5.0, 0.0])
    assert cluster_peaks(signal, 1.0, 3).tolist() == [3.0, 5.0]
    assert cluster_peaks(signal, 1.0, 2).tolist() == [3.0, 2.5, 5.0]
    assert not len(cluster_peaks(signal, 9.0, 3))


def test_the_level_of_an_exponential_tail_is_known():
    """N clusters in T above u and the scale σ: the rate falls by e for each σ."""
    tail = Tail(1.0, 100, 1000.0, 0.5, 0.0)
    assert tail.exceeded_with(0.1) == 1.0
    assert tail.exceeded_with(0.1 / np.e) == pytest.approx(1.5)
    heavy = Tail(1.0, 100, 1000.0, 0.5, 0.2)
    assert heavy.exceeded_with(1e-4) > tail.exceeded_with(1e-4)


def test_the_error_of_a_rate_grows_beyond_the_data():
    tail = Tail(1.0, 100, 1000.0, 0.5, 0.0)
    deviations = [tail.log_deviation(rate) for rate in (0.1, 0.01, 0.001)]
    assert deviations[0] == pytest.approx(0.1)
    assert deviations == sorted(deviations)


def test_rates_are_kept_on_other_noise():
    """Mean over seven joints of the ratio of seen to asked, within the factor that a monitor promises."""
    rng = np.random.default_rng(5)
    asked, ratios = 20.0 / 3600.0, []
    for _ in range(7):
        tail = fit_tail([(coloured(rng, 600.0), RATE)], GAP)
        assert tail is not None and SHAPE_LIMITS[0] <= tail.shape <= SHAPE_LIMITS[1]
        other = coloured(rng, 7200.0)
        seen = len(cluster_peaks(other, tail.exceeded_with(asked), round(GAP * RATE)))
        ratios.append(seen / (7200.0 * asked))
    assert 1.0 / 1.5 < np.mean(ratios) < 1.5


def test_parts_that_differ_count_less():
    """Every second of ten parts is three times as loud: the clusters are all in five of them."""
    rng = np.random.default_rng(6)
    alike, unlike = ([(coloured(rng, 60.0) * (k % 2 * loud + 1.0), RATE) for k in range(20)] for loud in (0.0, 2.0))
    even, uneven = fit_tail(alike, GAP), fit_tail(unlike, GAP)
    assert even is not None and uneven is not None
    assert even.dispersion < 2.5 < uneven.dispersion  # 19 degrees of freedom: above 2.5 by chance in 1e-4
    assert uneven.log_deviation(1e-3) > even.log_deviation(1e-3)


def test_a_short_signal_has_no_tail():
    assert fit_tail([(coloured(np.random.default_rng(1), 10.0), RATE)], GAP) is None


def test_samples_that_were_not_observed_do_not_count():
    rng = np.random.default_rng(2)
    signal = coloured(rng, 600.0)
    with_hole = np.concatenate([signal, np.full(len(signal), np.nan)])
    whole, holed = (fit_tail([(x, RATE)], GAP) for x in (signal, with_hole))
    assert whole is not None and holed is not None
    assert holed.seconds == pytest.approx(whole.seconds) and holed.level == pytest.approx(whole.level)
