"""The rate of false alarms on motion from which no threshold was made."""

from __future__ import annotations

import numpy as np
import pytest

from armid.runs.monitoring.cross_validated_rate import count_alarms, rate_excess, validated_thresholds
from armid.runs.monitoring.observer import Observed
from armid.runs.monitoring.thresholds import find_thresholds

RATE = 50.0


def parts(seed: int, *, spread: float, count: int = 30, seconds: float = 20.0) -> list[Observed]:
    """Residuals of one joint, white above the declustering time, whose size differs from part to part."""
    rng = np.random.default_rng(seed)
    n = round(seconds * RATE)
    zero, usable = np.zeros((n, 1)), np.ones((n, 1), dtype=bool)
    sizes = np.exp(spread * rng.normal(size=count))
    time = np.arange(n) / RATE
    return [Observed(time, RATE, zero, zero + 1.0, s * rng.normal(size=(n, 1)), zero, usable) for s in sizes]


def hours(unseen: list[Observed]) -> float:
    return sum(len(each.time) for each in unseen) / RATE / 3600.0


@pytest.mark.parametrize("count", [1, 30])
def test_residuals_of_one_size_need_no_correction(count: int):
    excess = [
        rate_excess(parts(seed, spread=0.0, count=count, seconds=600.0 / count), np.zeros(1), 300.0)
        for seed in range(6)
    ]
    # 50 alarms are expected, so a ratio has a standard deviation of 0.14; the mean of its upper half is 1.06.
    assert min(excess) == 1.0 and np.mean(excess) < 1.15


def test_a_promised_rate_holds_on_other_motion_where_the_size_changes_from_part_to_part():
    friction, per_hour = np.zeros(1), 300.0
    plain, validated = [], []
    for seed in range(20):
        unseen, other = parts(seed, spread=0.15), parts(100 + seed, spread=0.15, count=60)
        excess = rate_excess(unseen, friction, per_hour)
        for ratios, made in (
            (plain, find_thresholds(unseen, friction, per_hour)[0]),
            (validated, validated_thresholds(unseen, friction, per_hour, excess)[0]),
        ):
            ratios.append(sum(count_alarms(made, each) for each in other) / (per_hour * hours(other)))
    # The logarithms of the ratios of single sets have a standard deviation of 0.45, so that of 20 has one of 0.10.
    assert np.mean(validated) < np.mean(plain)
    assert abs(np.mean(np.log(validated))) < 0.2


def test_rates_of_validated_thresholds_are_those_of_other_motion():
    unseen, friction = parts(3, spread=0.3), np.zeros(1)
    made, _ = validated_thresholds(unseen, friction, 300.0, 1.5)
    inside, _ = find_thresholds(unseen, friction, 200.0)
    assert made.factor == pytest.approx(inside.factor) and made.rate == 300.0
    assert made.smallest == pytest.approx(1.5 * inside.smallest)
