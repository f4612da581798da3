"""Loads and drive gains from simulated recordings of which everything is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.checked_array import Array
from armid.estimation.update.payload import LOAD_NAMES, PayloadEstimate, _Region, estimate_gains, estimate_payload
from armid.estimation.update.stacked_problem import StackedProblem, stack_problems
from armid.estimation.update.stacked_solution import solve_stacked
from armid.information.information import stack, total
from armid.maths.inertia import about_com, com_inertia_to_vector, pseudo_inertia
from carried import LOAD, Carrying, arm, carrying, changing, known, load_columns

EXACT = 1e-7
"""Noise-free, over the size of the load: rounding times a condition number of thousands, and unequal weights."""

CONE = 1e-4
"""The same after the conic program, which leaves 1e-9 of its largest number in units of tiny deviations."""

CORRECTION = np.array([0.05, -0.08, 0.1, 0.03, -0.04, 0.06])

DRAWS = 12

COVERED = 0.90
"""Share of 95 % intervals that must hold the truth in so few draws: two binomial deviations of 120 intervals that
depend on each other in groups of about three."""

POINT = com_inertia_to_vector(2.0, np.array([0.03, -0.02, 0.08]), np.diag([1e-5, 1e-5, 2e-5]))
"""Next to a point mass: at the border of what is real."""


def beside(unloaded: Carrying, loaded: Carrying, *, same_friction: bool = False) -> StackedProblem:
    own = changing() & (not same_friction)
    return stack_problems(unloaded.information, known(unloaded.information), loaded.information, own, load_columns())


def uncertain(carried: Carrying, deviation: float) -> Carrying:
    information = replace(carried.information, scale_deviation=np.full(6, deviation))
    return carried._replace(information=information)


def is_real(load: PayloadEstimate) -> bool:
    return bool(np.linalg.eigvalsh(pseudo_inertia(load.values))[0] >= 0.0)


def holds(ends: Array, truth: Array) -> Array:
    return (ends[:, 0] <= truth) & (truth <= ends[:, 1])


def test_noise_free_the_load_is_exact_although_friction_has_changed():
    load = estimate_payload(beside(carrying(1, None), carrying(2, None, LOAD, friction=1.5)))
    np.testing.assert_allclose(load.unconstrained, LOAD, atol=EXACT * LOAD[0])
    np.testing.assert_allclose(load.values, LOAD, atol=CONE * LOAD[0])
    np.testing.assert_allclose(load.com, LOAD[1:4] / LOAD[0], atol=CONE)
    assert load.status == ("identified",) * 10


def test_friction_that_must_not_change_is_taken_for_a_load():
    rng = np.random.default_rng(0)
    unloaded, loaded = carrying(1, rng), carrying(2, rng, LOAD, friction=1.5)
    free, held = (
        estimate_payload(beside(unloaded, loaded)),
        estimate_payload(beside(unloaded, loaded, same_friction=True)),
    )
    assert np.linalg.norm(free.unconstrained - LOAD) < 0.5 * np.linalg.norm(held.unconstrained - LOAD)
    assert held.solution.fit.residual_rms.sum() > 1.2 * free.solution.fit.residual_rms.sum()


@pytest.mark.parametrize("load", [LOAD, POINT], ids=["box", "point"])
def test_intervals_hold_the_truth_and_bodies_are_real(load: Array):
    inside, about = [], []
    for seed in range(DRAWS):
        rng = np.random.default_rng(seed)
        found = estimate_payload(beside(carrying(1, rng), carrying(2, rng, load, friction=1.2)))
        inside.append(holds(found.intervals, load))
        about.append(holds(np.vstack([found.com_intervals, found.inertia_intervals]), about_com(load)[1:]))
        assert holds(found.inertia_intervals, about_com(found.values)[4:]).all()
        assert is_real(found)
        assert holds(found.intervals, found.values).all() and holds(found.statistical, found.values).all()
    assert np.mean(inside) >= COVERED and np.mean(about) >= COVERED
    assert np.mean(inside, axis=0).min() >= 0.7


def test_uncertain_gains_widen_the_intervals_until_they_hold_the_truth():
    inside, narrow = [], []
    for seed in range(DRAWS):
        rng = np.random.default_rng(seed)
        correction = 0.1 * rng.normal(size=6)
        pair = (carrying(1, rng, correction=correction), carrying(2, rng, LOAD, correction=correction))
        found = estimate_payload(beside(*(uncertain(each, 0.1) for each in pair)))
        inside.append(holds(found.intervals, LOAD)[0])
        narrow.append(holds(found.statistical, LOAD)[0])
    assert np.mean(inside) >= COVERED
    assert np.mean(narrow) <= 0.75  # by noise alone the mass is missed, so the test can fail


def test_the_load_scales_with_all_torques_together():
    """Torques that all are a tenth larger, in both recordings, mean a load a tenth heavier."""
    rng = np.random.default_rng(1)
    joined = beside(uncertain(carrying(1, rng), 0.1), uncertain(carrying(2, rng, LOAD), 0.1))
    solved = solve_stacked(joined)
    tied = 1e-4  # the ties of friction, all but weightless, do not scale
    load = solved.values[joined.load]
    np.testing.assert_allclose(solved.scale_effect[joined.load].sum(axis=1), 0.1 * load, atol=tied * abs(load).max())


def test_noise_free_the_gains_are_exact():
    pair = carrying(1, None, correction=CORRECTION), carrying(2, None, LOAD, friction=1.5, correction=CORRECTION)
    mass = np.array([LOAD[0], *[np.nan] * 9])
    load, gains = estimate_gains(beside(*pair), mass, np.full(6, np.inf))
    np.testing.assert_allclose(gains.correction, CORRECTION, atol=EXACT)
    np.testing.assert_allclose(load.unconstrained, LOAD, atol=10 * EXACT * LOAD[0])
    assert load.values[0] == load.intervals[0, 0] == load.intervals[0, 1] == LOAD[0]


def test_noisy_gains_lie_in_their_intervals_and_are_not_drawn_to_one_side():
    mass = np.array([LOAD[0], *[np.nan] * 9])
    inside, missed = [], []
    for seed in range(DRAWS):
        rng = np.random.default_rng(seed)
        pair = carrying(1, rng, correction=CORRECTION), carrying(2, rng, LOAD, friction=1.2, correction=CORRECTION)
        _, gains = estimate_gains(beside(*pair), mass, np.full(6, np.inf))
        inside.append(holds(gains.intervals, CORRECTION))
        missed.append((gains.correction - CORRECTION) / (gains.intervals[:, 1] - gains.correction))
    assert np.mean(inside) >= COVERED
    assert abs(np.mean(missed)) <= 0.2  # mean of 120 in half widths of intervals, each some 0.5 wide


def test_gains_that_are_known_beforehand_stay_near_what_is_known():
    rng = np.random.default_rng(3)
    pair = carrying(1, rng, correction=CORRECTION), carrying(2, rng, LOAD, correction=CORRECTION)
    mass = np.array([LOAD[0], *[np.nan] * 9])
    _, tight = estimate_gains(beside(*pair), mass, np.full(6, 1e-6))
    assert np.abs(tight.correction).max() <= 1e-4
    _, loose = estimate_gains(beside(*pair), mass, np.full(6, 10.0))
    _, free = estimate_gains(beside(*pair), mass, np.full(6, np.inf))
    np.testing.assert_allclose(loose.correction, free.correction, atol=1e-3)


def test_a_whole_load_may_be_known():
    rng = np.random.default_rng(4)
    pair = carrying(1, rng, correction=CORRECTION), carrying(2, rng, LOAD, correction=CORRECTION)
    load, gains = estimate_gains(beside(*pair), LOAD, np.full(6, np.inf))
    np.testing.assert_array_equal(load.values, LOAD)
    np.testing.assert_allclose(load.inertia_intervals.T, [about_com(LOAD)[4:]] * 2)
    assert holds(gains.intervals, CORRECTION).all()


def test_where_only_one_joint_moves_bodies_are_real_and_what_is_unknown_is_said():
    rng = np.random.default_rng(5)
    loaded = carrying(2, rng, LOAD, still=(0, 2, 3, 4, 5), seconds=8.0)
    load = estimate_payload(beside(carrying(1, rng), loaded))
    assert is_real(load)
    assert 1 <= load.status.count("identified") < 10
    assert load.status.count("not identifiable") >= 5
    assert np.isnan(load.inertia_intervals).any()


def test_without_any_motion_nothing_of_a_small_load_is_identified():
    """Its mass is bounded by the torque that holds the arm; what is not identified is said."""
    rng = np.random.default_rng(6)
    loaded = carrying(2, rng, 1e-3 * LOAD, still=(0, 1, 2, 3, 4, 5), seconds=4.0)
    load = estimate_payload(beside(carrying(1, rng), loaded))
    assert "identified" not in load.status
    low, high = load.intervals[0]
    assert low <= 1e-3 * LOAD[0] <= high


def test_constraints_on_the_arm_count_as_part_of_its_estimate():
    """An estimate that is not the optimum of its factors, as constraints make it, is what the load is beside."""
    rng = np.random.default_rng(7)
    unloaded, loaded = carrying(1, rng), carrying(2, None, LOAD)
    fit = replace(known(unloaded.information), values=unloaded.base_values)  # the truth, by whatever means
    joined = stack_problems(unloaded.information, fit, loaded.information, changing(), load_columns())
    assert joined.information.blocks == unloaded.information.blocks + loaded.information.blocks
    found = estimate_payload(joined)
    np.testing.assert_allclose(found.unconstrained, LOAD, atol=1e-3)
    plain = estimate_payload(beside(unloaded, loaded))
    assert np.linalg.norm(plain.unconstrained - LOAD) > 10.0 * np.linalg.norm(found.unconstrained - LOAD)


def test_a_prior_of_the_arm_counts_as_it_did():
    """The prior that the arm was estimated with makes the load better known, as more of the arm's data would."""
    rng = np.random.default_rng(8)
    unloaded, loaded = carrying(1, rng), carrying(2, rng, LOAD)
    fit = known(unloaded.information)
    A, y = stack(total(unloaded.information), fit.weights)
    precision = 10.0 * A.T @ A  # knows ten times what the recording does, and is right
    values = np.linalg.solve(A.T @ A + precision, A.T @ y + precision @ unloaded.base_values)
    ridge = replace(fit, values=values, prior_precision=precision)
    found = estimate_payload(
        stack_problems(unloaded.information, ridge, loaded.information, changing(), load_columns())
    )
    plain = estimate_payload(beside(unloaded, loaded))
    assert (np.ptp(found.intervals, axis=1) < np.ptp(plain.intervals, axis=1)).all()
    assert np.mean(holds(found.intervals, LOAD)) >= 0.8


def test_an_arm_that_its_factors_do_not_determine_is_known_by_its_estimate():
    rng = np.random.default_rng(9)
    elsewhere = known(carrying(1, rng).information)
    weak = uncertain(carrying(3, rng, still=(0, 2, 3, 4, 5)), 0.0).information
    loaded = carrying(2, rng, LOAD, friction=1.2)
    joined = stack_problems(weak, elsewhere, loaded.information, changing(), load_columns())
    assert joined.information.blocks == loaded.information.blocks
    found, plain = estimate_payload(joined), estimate_payload(beside(carrying(1, np.random.default_rng(9)), loaded))
    assert (np.abs(found.unconstrained - plain.unconstrained) <= np.ptp(plain.intervals, axis=1)).all()
    ratio = np.ptp(found.intervals, axis=1) / np.ptp(plain.intervals, axis=1)
    assert ratio.min() > 0.5 and ratio.max() < 2.0
    mass = np.array([LOAD[0], *[np.nan] * 9])
    _, gains = estimate_gains(joined, mass, np.full(6, 0.1))
    assert np.mean(holds(gains.intervals, np.zeros(6))) >= 0.5


def test_names_stand_in_the_order_of_the_parameters():
    model, _ = arm()
    symbols = tuple(model.parameters[k].symbol for k in model.inertial_columns[-10:])
    assert symbols == LOAD_NAMES


def test_parameters_that_nothing_shows_leave_rounding_for_a_covariance():
    """As on an arm of parallel axes, which shows a load's mass, its centre across the axes and one moment."""
    free, seen = np.ones(10, dtype=np.bool_), [0, 1, 2, 9]
    free[0] = False
    rng = np.random.default_rng(1)
    for rounding in (1e-16, 1e-30):
        half = rounding * rng.normal(size=(10, 10))
        half[seen] += rng.normal(size=(4, 10)) * 1e-4
        half[0] = 0.0
        unseen = np.linalg.qr(np.eye(9)[:, [2, 3, 4, 5, 6, 7]] + rounding * rng.normal(size=(9, 6)))[0].T
        estimate = np.where(np.isin(np.arange(10), seen), LOAD, 0.0)
        values, moved = _Region(estimate, free, unseen, half @ half.T).nearest()
        assert moved < 1e-3 and np.linalg.eigvalsh(pseudo_inertia(values))[0] > 0.0
        np.testing.assert_allclose(values[seen], LOAD[seen], atol=1e-6)


def test_intervals_of_a_load_below_zero_are_cut_off():
    """Another arm's log gives a negative mass: the interval then holds masses of real bodies near it."""
    free, none = np.ones(10, dtype=np.bool_), np.zeros(10, dtype=np.bool_)
    estimate = np.zeros(10)
    estimate[0] = -2.0
    region = _Region(estimate, free, np.zeros((0, 10)), np.diag(np.full(10, 0.1)) ** 2)
    nearest, _ = region.nearest()
    ends = region.intervals(nearest, 50.0, none)
    assert (ends[:, 0] <= nearest).all() and (nearest <= ends[:, 1]).all()
    assert -1e-6 <= ends[0, 0] <= ends[0, 1] < 1.0
