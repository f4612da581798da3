"""The Birge ratio: one for values that scatter as they should, larger for others."""

from __future__ import annotations

import numpy as np
import pytest

from armid.maths.birge_ratio import birge_ratio


def test_two_values_that_differ_have_the_ratio_of_their_distance_to_its_deviation():
    assert birge_ratio(np.array([0.0, 6.0]), np.array([1.0, 1.0])) == pytest.approx(6.0 / np.sqrt(2.0))


def test_values_that_agree_have_a_ratio_of_one():
    assert birge_ratio(np.array([1.0, 1.1, 0.9]), np.ones(3)) == 1.0


def test_values_without_a_deviation_say_nothing():
    assert birge_ratio(np.array([0.0, 6.0, 3.0]), np.array([0.0, 1.0, 0.0])) == 1.0


def test_the_ratio_estimates_by_how_much_deviations_are_too_small():
    values = 3.0 * np.random.default_rng(5).standard_normal(4000)
    ratio = birge_ratio(values, np.ones(4000))
    assert ratio == pytest.approx(3.0, rel=0.05)  # standard error of a scatter of 4000 values is 1.1 %
