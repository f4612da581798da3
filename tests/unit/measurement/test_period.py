"""The period of a motion: found wherever it was repeated, and nowhere else."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from armid.checked_array import Array
from armid.errors import RecordingError
from armid.estimation.uncertainty.covariance_choice_thresholds import FEWEST_PERIODS
from armid.estimation.uncertainty.cross_products_by_frequency import find_periods
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.period import FEWEST_COMPARED, SHORTEST, repetition
from armid.measurement.processing.pipeline import ProcessingOptions, process_recording
from armid.study.remedy_translation import OPTIONS, at_the_prompt
from motions import codes, recording

NEAR = 0.1  # samples


def series(period: float, n: int, seed: int, harmonics: int = 5) -> Callable[[Array], Array]:
    """A motion of a period, from times (N,) to positions (N, n)."""
    a, b = np.random.default_rng(seed).normal(size=(2, harmonics, n))
    order = 2.0 * np.pi / period * np.arange(1, harmonics + 1)
    return lambda t: (
        np.sin(np.outer(t, order)) @ (a / order[:, None]) + np.cos(np.outer(t, order)) @ (b / order[:, None])
    )


def with_ways(period: float, count: int, lead: float, out: float, rate: float, seed: int) -> tuple[Array, Array]:
    """Times and positions of a motion run through some times, with smooth ways to it and from it."""
    along = series(period, 4, seed)
    t = np.arange(round((lead + count * period + out) * rate)) / rate
    q = along(np.clip(t - lead, 0.0, count * period))
    for part, share in ((t < lead, 1.0 - t / max(lead, 1e-9)), (t > t[-1] - out, (t - t[-1] + out) / max(out, 1e-9))):
        s = share[part, None]
        q[part] += s**3 * (10.0 - 15.0 * s + 6.0 * s**2) * np.array([0.5, -0.7, 0.3, 0.9])
    return t, q


@pytest.mark.parametrize("count", [2, 3, 7])
@pytest.mark.parametrize(
    ("period", "rate"), [(10.0, 1000.0), (7.3, 250.0), (6.0 + 1.0 / 3.0, 100.0), (2.0 * np.pi, 62.5)]
)
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_repeated_motion_is_found_to_a_part_of_a_sample(count: int, period: float, rate: float, noise: float):
    t = np.arange(round(count * period * rate)) / rate
    q = series(period, 5, count)(t) + noise * np.random.default_rng(1).normal(size=(len(t), 5))
    found = repetition(t, q, rate)
    assert found is not None and found.count == count
    assert abs(found.period - period) * rate < NEAR
    assert abs(found.start) <= 1.5 / rate


@pytest.mark.parametrize(("lead", "out"), [(1.5, 0.0), (0.0, 1.5), (1.5, 1.0)])
@pytest.mark.parametrize("count", [2, 4])
def test_ways_to_and_from_the_motion_are_no_part_of_it(lead: float, out: float, count: int):
    t, q = with_ways(8.0, count, lead, out, 200.0, seed=3)
    found = repetition(t, q, 200.0)
    assert found is not None and found.count == count
    assert abs(found.period - 8.0) < 0.01
    assert abs(found.start - lead) < 0.8  # within a tenth of the period


def test_encoder_quanta_and_a_clock_that_runs_slow_do_not_hide_it():
    t = np.arange(9000) / 300.0
    q = series(10.0, 4, 5)(t)
    found = repetition(1.0002 * t, 0.002 * np.round(q / 0.002), 300.0)
    assert found is not None and found.count == 3
    assert abs(found.period - 10.002) * 300.0 < NEAR


@pytest.mark.parametrize("seed", range(12))
def test_a_motion_that_is_not_repeated_has_no_period(seed: int):
    """A series over one period, a random path, slow and fast, joints with frequencies of their own."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    once = np.arange(2000) / 100.0
    assert repetition(once, series(20.0, n, seed)(once), 100.0) is None
    knots = int(rng.integers(4, 60))
    path = CubicSpline(np.linspace(0.0, 20.0, knots), rng.normal(size=(knots, n)).cumsum(axis=0))(once)
    assert repetition(once, path, 100.0) is None
    assert repetition(once, np.outer(once, np.ones(n)) + 1e-5 * rng.normal(size=(2000, n)), 100.0) is None
    tones = np.sin(np.outer(once, np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0])) + rng.uniform(0.0, 6.0, 5))
    assert repetition(once, tones, 100.0) is None


def test_an_arm_at_rest_repeats_nothing():
    t = np.arange(6000) / 100.0
    held = 1e-5 * np.random.default_rng(1).normal(size=(6000, 3))
    assert repetition(t, held, 100.0) is None
    held[2500:3500] += np.sin(2.0 * np.pi * np.arange(1000) / 1000.0)[:, None]
    assert repetition(t, held, 100.0) is None


def test_the_period_is_the_shortest_after_which_all_joints_are_back():
    """Even harmonics alone are back after half of the base period; a joint with an odd one is not."""
    t = np.arange(4000) / 100.0
    even = np.column_stack([np.sin(2.0 * np.pi * t * k / 20.0) for k in (2, 4, 6)])
    found = repetition(t, even, 100.0)
    assert found is not None and abs(found.period - 10.0) < 1e-3
    odd = np.column_stack([even, np.sin(2.0 * np.pi * t / 20.0)])
    found = repetition(t, odd, 100.0)
    assert found is not None and abs(found.period - 20.0) < 1e-3
    quick = repetition(t, np.column_stack([np.sin(2.0 * np.pi * t), np.cos(4.0 * np.pi * t)]), 100.0)
    assert quick is not None and SHORTEST <= quick.period < SHORTEST + 1.01


def test_only_of_enough_repetitions_intervals_from_their_differences_are_announced():
    t, q = with_ways(4.0, FEWEST_PERIODS, 1.0, 0.0, 200.0, seed=4)
    _, findings = process_recording(recording(t, q=q[:, :2]), ProcessingOptions(), period="find")
    (told,) = [each for each in findings if each.code == "period-found"]
    assert f"{FEWEST_PERIODS} times" in told.evidence and "can be computed from the differences" in told.remedy
    assert FEWEST_COMPARED == FEWEST_PERIODS


def test_a_found_period_is_told_and_makes_repetitions_of_short_blocks():
    t, q = with_ways(8.0, 3, 1.0, 0.0, 200.0, seed=4)
    log = recording(t, q=q[:, :2])
    (run,), findings = process_recording(log, ProcessingOptions(), period="find")
    (told,) = [each for each in findings if each.code == "period-found"]
    assert told.severity == "info" and "8 s, 3 times" in told.evidence and "are not used" in told.evidence
    assert f"only if there are {FEWEST_PERIODS} or more" in told.remedy
    assert "--period none (in a study: " in at_the_prompt(told.remedy, OPTIONS)
    assert run.repetition is not None
    counted = run.mask.any(axis=1)
    assert set(run.repetition[counted]) == {0, 1, 2}
    assert not counted[run.motion.time[run.rows] < 0.2].any()
    periods = find_periods(run)
    assert periods is not None and len(periods) == 4
    assert np.ptp(np.bincount(run.block[counted])) <= 50  # of about a second
    assert len(np.unique(run.block[counted])) == 24


def test_a_stated_period_overrides_and_none_looks_for_nothing():
    t, q = with_ways(8.0, 3, 0.0, 0.0, 200.0, seed=4)
    log = recording(t, q=q[:, :2])
    assert (
        LogFormat().repeats == "find"
        and LogFormat(period=4.0).repeats == 4.0
        and LogFormat(period="none").repeats is None
    )
    for reading, blocks in ((LogFormat(period=12.0), 2), (LogFormat(period="none"), 24)):
        (run,), findings = process_recording(log, ProcessingOptions(), period=reading.repeats)
        assert "period-found" not in codes(findings) and run.repetition is None
        assert len(np.unique(run.block[run.mask.any(axis=1)])) == blocks
    for wrong in ("never", -1.0, True):
        with pytest.raises(RecordingError, match="period"):
            LogFormat(period=wrong)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(("stated", "told"), [(7.0, True), (12.5, True), (8.0, False), (16.0, False), (4.0, False)])
def test_a_stated_period_that_is_not_the_motions_is_told_with_the_one_that_is(stated: float, told: bool):
    t, q = with_ways(8.0, 4, 0.0, 0.0, 200.0, seed=4)
    q = (
        np.column_stack([q[:, 0], q[:, 0]])
        if stated != 4.0
        else np.column_stack([np.sin(np.pi * t), np.cos(np.pi * t)])
    )
    _, findings = process_recording(recording(t, q=q), ProcessingOptions(), period=stated)
    found = [each for each in findings if each.code == "period-misaligned"]
    assert [each.severity for each in found] == ["warning"] * told
    if told:
        assert f"every 8 s, not every {stated:g} s" in found[0].evidence and found[0].remedy == "period = 8.0"


def test_a_motion_that_does_not_repeat_is_told_where_a_period_is_stated():
    t = np.arange(6000) / 200.0
    q = np.column_stack([series(30.0, 1, seed, harmonics=9)(t)[:, 0] for seed in (1, 2)])
    _, findings = process_recording(recording(t, q=q), ProcessingOptions(), period=7.0)
    (found,) = [each for each in findings if each.code == "period-misaligned"]
    assert "do not repeat every 7 s" in found.evidence and found.remedy.startswith('period = "none"')
    _, findings = process_recording(recording(t, q=q), ProcessingOptions(), period=30.0)  # it is run once
    assert "period-misaligned" not in {each.code for each in findings}


@pytest.mark.parametrize(("lead", "out"), [(0.0, 0.0), (4.0, 3.0)])
def test_repetitions_of_a_long_recording_are_found(lead: float, out: float):
    """A lag is examined by some of the samples first, which must not refuse a period: 400 s of four joints."""
    period, count = 9.7, 40
    t, q = with_ways(period, count, lead, out, 100.0, 3)
    q += 1e-4 * np.random.default_rng(0).normal(size=q.shape)
    found = repetition(t, q, 100.0)
    assert found is not None and found.count == count
    assert abs(found.period - period) * 100.0 < NEAR and abs(found.start - lead) < 0.1 * period


def test_a_long_motion_of_several_frequencies_does_not_repeat():
    t = np.arange(40_000) / 100.0
    joint = np.arange(4)
    frequency = 2.0 * np.pi * (0.1 * np.arange(1, 6)[:, None] + 0.013 * joint + 0.0071 * joint * joint)
    q = sum(np.sin(np.outer(t, w)) for w in frequency[:, :1]) + np.sin(t[:, None] * frequency[1])
    assert repetition(t, q, 100.0) is None
