"""Covariances that cover: which kind is chosen, what each of them is, and laws that all of them keep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtrit

from armid.checked_array import Array
from armid.estimation.fit_result import POORLY_IDENTIFIED, Fit
from armid.estimation.friction_per_recording import separate_by_recording
from armid.estimation.problem import EstimationProblem
from armid.estimation.run_estimator import estimate
from armid.estimation.uncertainty.bootstrap import bootstrap
from armid.estimation.uncertainty.covariance import choose_covariance_kind, estimate_covariance
from armid.estimation.uncertainty.covariance_choice_thresholds import FEWEST_PERIODS
from armid.estimation.uncertainty.cross_products_by_frequency import (
    band_edges,
    band_products,
    find_periods,
    residual_moments,
)
from armid.estimation.uncertainty.jackknife import group_blocks, periods
from armid.estimation.uncertainty.noise_spectrum import NoiseModel, level_basis
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, JointFactors, select, stack
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from noisy import OLS, RATE, WLS, arm, coloured, covered, dense, inside, moved, once, problem, repeated, seconds_of
from problems import lively_motion

SAME = 1e-9
"""Relative difference of two ways to compute one number."""

KNOWN = 1e-3
"""Relative difference that a prior 1e8 times surer than the data leaves, 1e-4 of a deviation by correlations."""


# What is chosen -------------------------------------------------------------------------------------------------


def test_white_residuals_keep_the_textbook_covariance_and_the_report_says_why():
    given = once(3, memory=0.0)
    fit = WLS.solve(given)
    found = estimate_covariance(fit, given, systematic_errors=False)
    assert found.covariance_kind == "white" and "uncorrelated in time" in found.report.why
    assert found.report.whiteness is not None and found.report.whiteness > 0.05
    np.testing.assert_array_equal(found.covariance, fit.covariance)


def test_coloured_residuals_of_one_motion_get_a_spectrum():
    found = covered(once(1))
    assert found.covariance_kind == "spectral" and "residuals are correlated in time" in found.report.why
    assert found.report.whiteness is not None and found.report.whiteness < 1e-6
    assert found.report.parts > 3
    assert np.median(np.sqrt(np.diag(found.covariance)) / found.white_deviation) > 1.5


def test_deviations_marks_and_intervals_tell_one_size():
    """Widened by colour and reversals, as the intervals are; the textbook's deviation stands beside it."""
    found = covered(once(1))
    assert not found.intervals.flags.writeable  # computed once
    half = 0.5 * np.diff(found.intervals, axis=1)[:, 0]
    deviation = half / stdtrit(found.freedom, 0.975)
    np.testing.assert_allclose(found.deviation, deviation, rtol=SAME)
    relative = 100.0 * deviation / np.abs(found.values)
    np.testing.assert_allclose(found.relative_deviation, relative, rtol=SAME)
    np.testing.assert_array_equal(found.poorly_identified, relative > POORLY_IDENTIFIED)
    np.testing.assert_array_equal(found.white_deviation, WLS.solve(once(1)).deviation)


def test_enough_periods_are_compared_with_each_other():
    found = without_errors(repeated(1, FEWEST_PERIODS))
    assert found.covariance_kind == "period" and "repeats" in found.report.why
    assert found.report.parts == FEWEST_PERIODS
    np.testing.assert_array_equal(found.freedom, FEWEST_PERIODS - 1)
    few = covered(repeated(1, FEWEST_PERIODS - 1))
    assert few.covariance_kind == "spectral" and f"fewer than {FEWEST_PERIODS} periods" in few.report.why


def test_what_the_model_lacks_repeats_and_is_not_taken_for_precision():
    """A torque that the model cannot explain, the same in every period: the periods agree on a wrong answer."""
    motion = moved(8.0, 8)
    missing = 2.0 * np.sin(3.0 * motion.q) * np.sign(motion.dq)
    noise = 0.2 * coloured(np.random.default_rng(5), motion.samples, 0.1)
    given = problem(motion, missing + noise, np.repeat(np.arange(8), motion.samples // 8))
    found = covered(given)
    assert found.covariance_kind == "spectral" and "repeats with the motion" in found.report.why
    between = estimate_covariance(WLS.solve(given), given.information)
    assert between.covariance_kind == "period"
    assert np.median(np.diag(found.covariance) / np.diag(between.covariance)) > 4.0


def test_seconds_of_a_motion_of_unknown_period_are_no_periods():
    """A second looks like the same second of other repetitions; a residual that repeats cannot be told there."""
    motion = moved(8.0, 8)
    noise = coloured(np.random.default_rng(5), motion.samples, 0.1)
    found = covered(problem(motion, noise, seconds_of(motion)))
    assert found.covariance_kind == "spectral" and "repeats" not in found.report.why


def test_without_samples_the_blocks_of_the_factors_have_to_do():
    given = once(1)
    fit = WLS.solve(given)
    found = estimate_covariance(fit, given.information)
    assert found.covariance_kind == "block" and "no samples" in found.report.why
    assert found.report.whiteness is None
    weighted = estimate_covariance(replace(fit, information=given.information), given)
    assert weighted.covariance_kind == "block" and "individual weights" in weighted.report.why


def test_samples_of_other_rows_are_not_used():
    given = once(1)
    some = replace(given, information=select(given.information, np.arange(15)))
    found = covered(some)
    assert found.covariance_kind == "block" and "available samples are not those" in found.report.why


def test_friction_of_each_recording_has_a_spectrum_too():
    """Two recordings whose friction is their own: as many rows in the same bands, other columns."""
    model, base, _ = arm()
    parts = [once(1), once(2, 30.0)]
    runs = [replace(part.observations.runs[0], recording=k) for k, part in enumerate(parts) if part.observations]
    observations = Observations(tuple(runs), Band())
    information = accumulate_information(model, base, observations)
    own = np.array([name.startswith("FV") for name in base.names])
    given = EstimationProblem(separate_by_recording(information, own), None, model, base, observations)
    fit = WLS.solve(given)
    found, blocks = estimate_covariance(fit, given), estimate_covariance(fit, given.information)
    assert found.covariance_kind == "spectral" and blocks.covariance_kind == "block"
    assert len(found.names) == base.count + own.sum()
    ratio = np.sqrt(np.diag(found.covariance) / np.diag(blocks.covariance))
    assert (ratio > 0.5).all() and (ratio < 2.0).all()  # fifty blocks know a deviation to a tenth
    bands = band_products(given, fit.values)
    A, y = stack(given.information)
    np.testing.assert_allclose(np.einsum("ejj->", bands.moments), np.sum((y - A @ fit.values) ** 2))


def test_rows_out_of_order_have_no_spectrum():
    given = once(1)
    assert given.observations is not None
    runs = tuple(replace(run, consecutive=False) for run in given.observations.runs)
    loose = replace(given, observations=Observations(runs, Band()))
    assert covered(loose).covariance_kind == "block"


def test_neighbouring_blocks_that_pull_alike_are_merged():
    """Noise that remembers a second: a block of a second has not seen enough of it."""
    slow = covered_by_factors(once(2, 40.0, memory=1.0))
    fast = covered_by_factors(once(2, 40.0, memory=0.0))
    assert fast.report.parts == 40 and slow.report.parts < 40


def without_errors(given: EstimationProblem) -> Fit:
    """Fit with its covariance by the noise alone, without systematic errors of measurement and friction."""
    return estimate_covariance(WLS.solve(given), given, systematic_errors=False)


def covered_by_factors(given: EstimationProblem) -> Fit:
    return estimate_covariance(WLS.solve(given), given.information)


@pytest.mark.parametrize(
    ("white", "free", "repeats", "kind"),
    [(0.5, 9, 1.0, "white"), (0.01, None, 1.0, "spectral"), (0.01, 9, 1.0, "period"), (0.01, 9, 3.0, "spectral")],
)
def test_the_choice(white: float, free: int | None, repeats: float, kind: str):
    assert choose_covariance_kind(white, free, repeats)[0] == kind


# What each of them is --------------------------------------------------------------------------------------------


def test_period_covariance_is_the_textbook_t_interval_of_the_periods_own_estimates():
    given = repeated(2, 8)
    found = without_errors(given)
    own = []
    for k in range(8):
        part = select(given.information, np.array([k]))
        A = np.concatenate([w * _rows(part, j) for j, w in enumerate(found.weights)])
        own.append(np.linalg.lstsq(A[:, :-1], A[:, -1], rcond=None)[0])
    expected = np.cov(np.array(own).T) / 8
    np.testing.assert_allclose(found.covariance, expected, rtol=0, atol=1e-7 * np.abs(expected).max())
    np.testing.assert_allclose(np.mean(own, axis=0), found.values, rtol=1e-9)


def _rows(information: Information, joint: int) -> Array:
    factors = information.joints[joint]
    rows = np.zeros((len(factors.R[0]), information.count + 1))
    rows[:, factors.parameters], rows[:, -1] = factors.R[0][:, :-1], factors.R[0][:, -1]
    return rows


def test_products_of_all_bands_are_those_of_all_rows():
    given = once(1)
    fit = WLS.solve(given)
    bands = band_products(given, fit.values)
    X, y = dense(given)
    residual = y - X @ fit.values
    np.testing.assert_allclose(bands.moments.sum(axis=0), residual.T @ residual, rtol=SAME)
    for j, own in enumerate(bands.parameters):
        a, b = bands.offset[j : j + 2]
        expected = X[:, j, own].T @ X[:, j, own]
        np.testing.assert_allclose(
            bands.products[:, a:b, a:b].sum(axis=0), expected, rtol=0, atol=SAME * expected.max()
        )
    np.testing.assert_allclose(bands.count.sum(axis=0), len(X))
    np.testing.assert_allclose(residual_moments(residual.T, RATE, bands), bands.moments)


def test_folded_periods_keep_all_products_and_say_what_periods_differ_by():
    given = repeated(1, 5)
    fit = WLS.solve(given)
    bands = band_products(given, fit.values)
    X, y = dense(given)
    residual = (y - X @ fit.values).reshape(5, -1, 2)
    a, b = bands.offset[:2]
    own = bands.parameters[0]
    expected = X[:, 0, own].T @ X[:, 0, own]
    np.testing.assert_allclose(bands.products[:, a:b, a:b].sum(axis=0), expected, rtol=0, atol=SAME * expected.max())
    np.testing.assert_allclose(np.einsum("ejj->j", bands.moments), 5 * (residual.mean(axis=0) ** 2).sum(axis=0))
    np.testing.assert_allclose(bands.within[0], ((residual - residual.mean(axis=0)) ** 2).sum(axis=(0, 1)))
    assert (bands.within[1] == 4 * residual.shape[1]).all()


def test_levels_are_unbiased_where_the_estimate_has_taken_much_of_the_noise():
    """The mean over many recordings of what is found of white noise is its level at every frequency, although the
    estimate takes a third of the slowest residuals away."""
    given = once(0, 6.0, memory=0.0)
    fit = OLS.solve(given)
    bands = band_products(given, fit.values)
    X, _ = dense(given)
    A = X.reshape(-1, X.shape[2])
    model = NoiseModel(bands, np.ones(2), np.linalg.inv(A.T @ A))
    rng = np.random.default_rng(1)
    sums = 0.0
    for _ in range(400):
        noise = rng.normal(size=(len(X), 2))
        residual = noise - X @ np.linalg.lstsq(A, noise.ravel(), rcond=None)[0]
        sums = sums + np.linalg.solve(model.equations, model.measured(residual_moments(residual.T, RATE, bands)))
    mean = np.asarray(sums) / 400
    spread = np.sqrt(2.0 * np.diag(np.linalg.inv(model.equations)) / 400)
    white = np.tile([1.0, 0.0, 1.0], len(model.basis))
    assert (np.abs(mean - white) < 4.0 * spread).all()
    raw = np.einsum("ejj->ej", bands.count - model.leverage) / np.einsum("ejj->ej", bands.count)
    assert raw.min() < 0.8  # what a residual alone would have made of it


def test_what_joints_have_in_common_is_seen_where_a_filter_left_noise():
    """Above the band there is nothing but rounding, and no correlation must be read from it."""
    given = once(6, 60.0, memory=0.05, band=Band("butterworth", 3.0, 4, "drop"), step=2)
    fit = WLS.solve(given)
    bands = band_products(given, fit.values)
    levels = NoiseModel(bands, fit.weights, fit.covariance).levels(bands.moments)
    correlation = levels[:, 0, 1] / np.sqrt(levels[:, 0, 0] * levels[:, 1, 1])
    assert (correlation > 0.4).all() and (correlation < 0.8).all()  # it is 0.6


def test_hats_share_every_band_out():
    basis = level_basis(band_products(once(1), WLS.solve(once(1)).values))
    np.testing.assert_allclose(basis.sum(axis=0), 1.0)
    assert (basis >= 0.0).all()


def test_bands_get_wider_and_cover_all_frequencies():
    edges = band_edges([(2000, 100.0), (500, 100.0)])
    assert edges[0] == 0.0 and edges[-1] < 50.0 and (np.diff(edges[1:]) > 0).all()
    assert edges[1] >= 1.0 / 20.0 / 2.0  # no band between two frequencies of the longest segment


def test_the_bootstrap_is_a_witness_of_the_jackknife():
    given = once(4, 40.0, memory=0.05)
    found = covered_by_factors(given)
    draws = bootstrap(found, given.information, draws=600, seed=3, per_group=1)
    ratio = draws.std(axis=0) / np.sqrt(np.diag(found.covariance))
    # 600 draws know a deviation to 3 %; blocks drawn with replacement scatter a little less than left out ones.
    assert (ratio > 0.75).all() and (ratio < 1.25).all()
    np.testing.assert_array_equal(draws, bootstrap(found, given.information, draws=600, seed=3))
    assert not np.array_equal(draws, bootstrap(found, given.information, draws=600, seed=4))


# Laws ----------------------------------------------------------------------------------------------------------


def test_the_order_of_joints_does_not_matter():
    """The same factors with the joints the other way round."""
    given = once(1)
    fit = WLS.solve(given)
    turned = replace(given.information, joints=given.information.joints[::-1], rows=given.information.rows[:, ::-1])
    other = estimate(EstimationProblem(turned), WLS)
    assert_same(other.covariance, estimate_covariance(fit, given.information).covariance)


def test_chunks_of_one_block_merge_to_the_block():
    """Periods cut in half and put together again as factors give the same covariance."""
    given = repeated(3, 8)
    halves = np.arange(given.information.rows.sum(axis=0)[0]) // (8 * int(RATE) // 2)
    assert given.observations is not None
    run = replace(given.observations.runs[0], block=halves)
    model, base, _ = arm()
    fine = accumulate_information(model, base, Observations((run,), Band()))
    joints = tuple(
        JointFactors(joint.parameters, np.stack([np.linalg.qr(np.vstack(pair))[1] for pair in _pairs(joint.R)]))
        for joint in fine.joints
    )
    rows = fine.rows.reshape(8, 2, -1).sum(axis=1)
    merged = replace(fine, joints=joints, rows=rows, run=fine.run[::2], recording=fine.recording[::2])
    expected = covered_by_factors(given)
    found = estimate(EstimationProblem(merged), WLS)
    assert found.covariance_kind == expected.covariance_kind == "period"
    assert_same(found.covariance, expected.covariance)


def _pairs(R: Array) -> Array:
    return R.reshape(-1, 2, *R.shape[1:])


def assert_same(found: Array, expected: Array) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


def test_units_of_torque_scale_the_covariance():
    motion = moved(20.0)
    noise = coloured(np.random.default_rng(2), motion.samples, 0.1)
    one = problem(motion, noise, seconds_of(motion))
    assert one.observations is not None
    run = replace(one.observations.runs[0], torque=1000.0 * one.observations.runs[0].torque)
    model, base, _ = arm()
    observations = Observations((run,), Band())
    other = EstimationProblem(accumulate_information(model, base, observations), None, model, base, observations)
    assert_same(covered(other).covariance, 1e6 * covered(one).covariance)


def test_a_strong_prior_leaves_its_own_uncertainty_and_little_else():
    given = once(1)
    fit = WLS.solve(given)
    precision = np.zeros_like(fit.covariance)
    precision[2, 2] = 1e8 / fit.covariance[2, 2]
    found = estimate_covariance(replace(fit, prior_precision=precision), given)
    assert np.sqrt(found.covariance[2, 2]) == pytest.approx(np.sqrt(1.0 / precision[2, 2]), rel=0.01)
    assert found.freedom[2] > 1e3  # nothing of it had to be learned from the residual
    free = estimate_covariance(fit, given)
    assert (np.diag(found.covariance) <= np.diag(free.covariance) * 1.5).all()


def test_a_prior_of_one_parameter_however_strong_tells_the_others_nothing_more():
    """From some strength on the parameter is known, and those of others do not change with it any further."""
    given = once(1)
    fit = WLS.solve(given)

    def found(strength: float) -> Fit:
        precision = np.zeros_like(fit.covariance)
        precision[2, 2] = strength / fit.covariance[2, 2]
        return estimate_covariance(replace(fit, prior_precision=precision), given)

    known, certain = found(1e8).deviation, found(1e24).deviation
    others = np.arange(len(known)) != 2
    np.testing.assert_allclose(certain[others], known[others], rtol=KNOWN)
    assert certain[2] == pytest.approx(1e-8 * known[2], rel=KNOWN)


def test_a_joint_of_which_no_row_counts_is_no_hindrance():
    given = once(1)
    assert given.observations is not None
    mask = np.ones((len(given.observations.runs[0].rows), 2), dtype=bool)
    mask[:700, 0] = False
    run = replace(given.observations.runs[0], mask=mask)
    model, base, _ = arm()
    observations = Observations((run,), Band())
    found = covered(
        EstimationProblem(accumulate_information(model, base, observations), None, model, base, observations)
    )
    assert found.covariance_kind == "spectral" and np.isfinite(found.intervals).all()


def test_dense_rows_are_averaged_and_say_the_same():
    """The same noise, as slow as before, sampled eight times as often."""
    slow = covered(once(5, 20.0, memory=0.1))
    motion = lively_motion(np.random.default_rng(4), 2, 8 * RATE, 20.0)
    model, base, truth = arm()
    noise = np.repeat(coloured(np.random.default_rng(5), 1000, 0.1), 8, axis=0)
    torque = model.regressor(motion)[:, :, base.kept] @ truth + noise
    mask, block = np.ones((motion.samples, 2), dtype=bool), np.arange(motion.samples) // int(8 * RATE)
    observations = Observations((ObservedRun(motion, torque, 8 * RATE, 1, 0, mask, block),), Band())
    found = covered(
        EstimationProblem(accumulate_information(model, base, observations), None, model, base, observations)
    )
    assert found.covariance_kind == "spectral"
    ratio = np.sqrt(np.diag(found.covariance) / np.diag(slow.covariance))
    assert (ratio > 0.9).all() and (ratio < 1.1).all()


def test_periods_are_known_by_their_products_and_motions_by_their_positions():
    given = repeated(1, 5)
    other = once(1)
    assert given.observations is not None and other.observations is not None
    np.testing.assert_array_equal(periods(given.information), 0)
    assert periods(other.information) is None
    found = find_periods(given.observations.runs[0])
    assert found is not None
    np.testing.assert_array_equal(found, [0, 400, 800, 1200, 1600, 400])
    assert find_periods(other.observations.runs[0]) is None


def test_groups_stay_within_runs():
    given = once(1).information
    two = replace(given, run=np.repeat([0, 1], [13, 7]))
    np.testing.assert_array_equal(np.bincount(group_blocks(two, 4)), [5, 4, 4, 7])


# Coverage, small: the benchmark has the thousands -----------------------------------------------------------------

CASES = {
    "white": {"memory": 0.0},
    "coloured": {"memory": 0.1},
    "slow": {"memory": 0.3},
    "filtered": {"memory": 0.05, "band": Band("butterworth", 5.0, 4, "drop"), "step": 2},
}


@pytest.mark.parametrize("name", CASES)
def test_intervals_cover_one_recording(name: str):
    """60 recordings of 20 s with 7 parameters."""
    share = np.mean([inside(covered(once(seed, **CASES[name]))) for seed in range(60)])  # pyright: ignore[reportArgumentType]
    # Of 420 intervals, parameters of one recording alike by and large: 95 % is known to two in a hundred.
    assert 0.89 < share < 0.99


def test_intervals_cover_periods():
    share = np.mean([inside(covered(repeated(seed, 6))) for seed in range(60)])
    assert 0.89 < share < 0.99


def test_noise_is_that_of_the_torque_not_of_the_residual():
    """Slow noise, of which the estimate takes a part: the level found is the noise's own."""
    found = np.mean([covered(once(seed, 10.0, memory=0.3)).noise for seed in range(60)], axis=0)
    plain = np.mean([WLS.solve(once(seed, 10.0, memory=0.3)).residual_rms for seed in range(60)], axis=0)
    assert (np.abs(found - 1.0) < 0.06).all()
    assert (plain < found - 0.02).all()


def test_intervals_cover_with_a_prior_that_is_right():
    """True values drawn from the prior, weak data, coloured noise: the posterior's intervals cover."""
    given = once(0, 6.0)
    X, _ = dense(given)
    model, base, _ = arm()
    assert given.observations is not None
    rng, shares = np.random.default_rng(3), []
    for _ in range(60):
        spread = 0.3 * np.ones(base.count)
        truth = spread * rng.normal(size=base.count)
        torque = X @ truth + coloured(rng, len(X), 0.2)
        run = replace(given.observations.runs[0], torque=torque)
        observations = Observations((run,), Band())
        one = EstimationProblem(accumulate_information(model, base, observations), None, model, base, observations)
        fit = WLS.solve(one)
        # What the prior is worth beside weights that take rows for independent, ten of which say as much as one.
        weights, precision = fit.weights / np.sqrt(10.0), np.diag(1.0 / spread**2)
        A, y = (x.reshape(-1, *x.shape[2:]) for x in (X * weights[:, None], torque * weights))
        values = np.linalg.solve(A.T @ A + precision, A.T @ y)
        found = estimate_covariance(replace(fit, values=values, weights=weights, prior_precision=precision), one)
        assert found.covariance_kind == "spectral"
        ends = found.intervals
        shares.append((ends[:, 0] <= truth) & (truth <= ends[:, 1]))
    assert 0.90 < np.mean(shares) < 0.99
    assert np.mean(shares, axis=0).min() > 0.8
