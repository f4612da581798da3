"""The unknowns of a design: all of them at rest, none of them missing."""

from __future__ import annotations

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.excitation.plan import Plan, seconds_for
from armid.excitation.rest_to_rest_basis import SeriesBasis
from armid.excitation.thesis_plans import builtin_plan

START = np.array([0.3, -0.2, 1.0])
ROUNDING = 1e-12


def basis(**more):
    return SeriesBasis(0.7, 6, START, **more)


@pytest.mark.parametrize(("free", "literal", "size"), [(0, 1, 9), (0, 0, 10), (1, 1, 10), (1, 0, 11)])
def test_every_unknown_is_at_rest(free, literal, size):
    made = basis(free=bool(free), literal=bool(literal))
    assert (made.size, made.unknowns) == (size, 3 * size)
    x = np.random.default_rng(0).normal(size=made.unknowns)
    series = made.excitation(x)
    begin = series.at([0.0])
    assert np.abs(begin.dq).max() < ROUNDING and np.abs(begin.ddq).max() < ROUNDING
    if not free:
        assert begin.q[0] == pytest.approx(START, abs=ROUNDING)
    if literal:
        assert np.abs((series.b / np.arange(1, 7)).sum(axis=1)).max() < ROUNDING
    assert made.unknowns_of(series) == pytest.approx(x, abs=ROUNDING)


def test_matrices_are_the_series():
    made = basis(free=True)
    x = np.random.default_rng(1).normal(size=made.unknowns)
    t = np.linspace(0.0, 8.0, 31)
    motion = made.excitation(x).at(t)
    unknowns = x.reshape(3, -1).T
    q, dq, ddq, jerk = (matrix @ unknowns for matrix in made.matrices(t))
    for mine, other in ((q + START, motion.q), (dq, motion.dq), (ddq, motion.ddq)):
        assert mine == pytest.approx(other, abs=1e-11)
    up, down = (made.excitation(x).at(t + h).ddq for h in (1e-5, -1e-5))
    assert jerk == pytest.approx((up - down) / 2e-5, abs=1e-6)
    for order, values in enumerate((dq, ddq, jerk), 1):
        assert (np.abs(values).max(axis=0) <= made.peaks_between(x, order)).all()


def test_what_cannot_be_at_rest():
    with pytest.raises(ArmidError, match="cannot start and end at rest"):
        SeriesBasis(1.0, 1, START)
    with pytest.raises(ArmidError, match="base frequency must be positive"):
        SeriesBasis(0.0, 5, START)


def whole_plan():
    begin, end = 0.2 * np.ones(7), -0.1 * np.ones(7)
    made = SeriesBasis(0.5, 4, np.zeros(7))
    series = made.excitation(np.random.default_rng(2).normal(size=made.unknowns))
    return Plan(series, 2, begin, end, 1.5, 2.0)


def test_a_plan_joins_its_parts_smoothly():
    plan = whole_plan()
    assert plan.duration == pytest.approx(1.5 + 2 * plan.excitation.period + 2.0)
    for border in (1.5, 1.5 + plan.excitation.period, plan.duration - 2.0):
        before, after = plan.at([border - 1e-9]), plan.at([border + 1e-9])
        for name in ("q", "dq", "ddq"):
            assert getattr(before, name) == pytest.approx(getattr(after, name), abs=1e-6)
    ends = plan.at([0.0, plan.duration])
    assert ends.q[0] == pytest.approx(plan.begin) and ends.q[1] == pytest.approx(plan.end)
    assert np.abs(ends.dq).max() < ROUNDING and np.abs(ends.ddq).max() < ROUNDING
    t = np.linspace(0.0, plan.duration, 4001)[1:-1]
    up, down = plan.at(t + 1e-6), plan.at(t - 1e-6)
    assert (up.q - down.q) / 2e-6 == pytest.approx(plan.at(t).dq, abs=1e-6)


def test_a_rehearsal_is_the_same_path_slowly():
    plan = whole_plan()
    slow = plan.rehearsal(0.2)
    t = np.linspace(0.0, 1.5 + plan.excitation.period, 300)
    assert slow.at(t / 0.2).q == pytest.approx(plan.at(t).q, abs=1e-9)
    assert slow.at(t / 0.2).dq == pytest.approx(0.2 * plan.at(t).dq, abs=1e-9)
    assert slow.repetitions == 1
    with pytest.raises(ArmidError, match="speed of a rehearsal"):
        plan.rehearsal(1.5)


def test_time_of_a_way_is_the_shortest():
    way, limits = np.array([1.0, -2.0]), (np.array([1.0, 1.0]), np.array([4.0, 4.0]), np.array([30.0, 30.0]))
    seconds = seconds_for(way, *limits)
    made = SeriesBasis(0.5, 4, way)
    plan = Plan(made.excitation(np.zeros(made.unknowns)), begin=np.zeros(2), lead_in=seconds)
    motion = plan.at(np.linspace(0.0, seconds, 20001))
    jerk = np.gradient(motion.ddq, motion.time, axis=0)
    shares = [np.abs(x).max(axis=0) / limit for x, limit in zip((motion.dq, motion.ddq, jerk), limits, strict=True)]
    assert np.max(shares) == pytest.approx(1.0, abs=1e-3)


def test_a_way_needs_its_pose_and_its_time():
    with pytest.raises(ArmidError, match="needs a pose and a duration"):
        Plan(builtin_plan("thesis-a1"), lead_in=1.0)
    with pytest.raises(ArmidError, match="at least one repetition"):
        Plan(builtin_plan("thesis-a1"), 0)
