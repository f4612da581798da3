"""Scores on recordings and the verdict made of them."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from armid.checked_array import Array
from armid.estimation.estimate_record import Estimate, torque_parameters
from armid.estimation.estimators import OrdinaryLeastSquares
from armid.estimation.fit_result import Fit
from armid.estimation.friction_per_recording import separate_by_recording
from armid.estimation.problem import EstimationProblem
from armid.information.accumulate import accumulate_information
from armid.information.hysteresis_states import with_hysteresis_states
from armid.information.residuals import compare
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.terms import Hysteresis, RigidBody
from armid.study.storage.records import to_json, validation_record
from armid.validation import prediction_interval, torque_validation
from armid.validation.torque_validation import Score, score, validate
from labs import small_model, small_plan, small_truth
from problems import one_run, raw

RATE, NOISE = 50.0, 0.05

BAND = Band("butterworth", 5.0, 4, "drop")


def run_of(seed: int, *, noise: float = NOISE, step: int = 1, parameters: Array | None = None) -> ObservedRun:
    """24 s of the small arm, the torque with white noise."""
    motion = small_plan(seed).sample(RATE, 3)
    torque = small_model().torque(motion, small_truth() if parameters is None else parameters)
    torque = torque + noise * np.random.default_rng(seed).normal(size=torque.shape)
    return one_run(motion, torque, RATE, step=step)


@cache
def small_base() -> BaseParameters:
    return find_base_parameters(small_model())


def estimate_from(*runs: ObservedRun, band: Band | None = None, own_friction: bool = False) -> Estimate:
    base = small_base()
    information = accumulate_information(small_model(), base, Observations(runs, band or Band()))
    if own_friction:
        kinds = np.array([small_model().parameters[k].kind != RigidBody.name for k in base.kept])
        information = separate_by_recording(information, kinds)
    return Estimate("small", "ols", (), base, OrdinaryLeastSquares().solve(EstimationProblem(information)))


@cache
def trained() -> Estimate:
    return estimate_from(run_of(1))


def true_estimate(noise: float = NOISE) -> Estimate:
    """The truth, known without error but for the noise of rows."""
    base = small_base()
    b = base.count
    fit = Fit(
        base.names, base.values_of(small_truth()), np.zeros(b), np.zeros((b, b)), "white", 9.0,
        np.full(3, noise), np.full(3, 1200), 1.0, 1.0,
    )  # fmt: skip
    return Estimate("small", "ols", (), base, fit)


# Scores --------------------------------------------------------------------------------------------------------


def test_errors_are_those_of_the_torque_on_rows_that_count():
    run = run_of(2)
    mask = np.random.default_rng(0).random(run.mask.shape) < 0.8
    torque = np.where(mask, run.torque, 1e3)  # nonsense where nothing counts
    found = score(small_model(), true_estimate(), raw(replace(run, mask=mask, torque=torque)), path="p", sha256="s")
    exact = small_model().torque(run.motion, small_truth())
    error = np.where(mask, torque - exact, np.nan)
    np.testing.assert_allclose(found.rms, np.sqrt(np.nanmean(error**2, axis=0)), rtol=1e-9)
    np.testing.assert_allclose(found.peak, np.nanmax(np.abs(error), axis=0), rtol=1e-9)
    np.testing.assert_allclose(found.spread, np.nanstd(np.where(mask, torque, np.nan), axis=0), rtol=1e-12)
    np.testing.assert_allclose(found.relative, found.rms / found.spread)
    np.testing.assert_array_equal(found.rms_raw, found.rms)  # nothing is filtered
    assert (found.path, found.sha256) == ("p", "s")


def test_the_description_is_judged_on_the_rows_in_which_hysteresis_is_known():
    """And the share of these rows is told."""
    run, width = run_of(2), 0.1
    model = replace(small_model(), terms=(*small_model().terms, Hysteresis((width,))))
    torque = run.torque.copy()
    torque[:5] = 1e3  # before any state is known
    base = find_base_parameters(model)
    information = accumulate_information(model, base, raw(run))
    estimate = Estimate("small", "ols", (), base, OrdinaryLeastSquares().solve(EstimationProblem(information)))
    found = score(model, estimate, raw(replace(run, torque=torque)))
    known = with_hysteresis_states(model, run, Band()).mask
    assert not known[:5].any() and found.share is not None and found.prior_rms is not None
    np.testing.assert_allclose(found.share, known.mean(axis=0))
    assert (found.prior_rms < 50.0).all()


def test_several_runs_count_by_their_rows():
    one, two = run_of(2), run_of(3, noise=3 * NOISE, step=2)
    parts = [score(small_model(), true_estimate(), raw(run)) for run in (one, two)]
    both = score(small_model(), true_estimate(), raw(one, two))
    squares = (1200 * parts[0].rms ** 2 + 600 * parts[1].rms ** 2) / 1800
    np.testing.assert_allclose(both.rms, np.sqrt(squares), rtol=1e-12)
    np.testing.assert_array_equal(both.peak, np.maximum(parts[0].peak, parts[1].peak))


def test_the_band_takes_the_noise_out_and_raw_errors_keep_it():
    found = score(small_model(), true_estimate(), Observations((run_of(2),), BAND))
    np.testing.assert_allclose(found.rms_raw, NOISE, rtol=0.1)
    assert (found.rms < 0.6 * NOISE).all()  # a fifth of the power lies below 5 of 25 Hz


def test_the_description_alone_knows_no_friction():
    found = score(small_model(), true_estimate(), raw(run_of(2)))
    nominal = small_model().nominal_parameters()
    assert nominal is not None and found.prior_rms is not None
    residual = compare(small_model(), nominal, run_of(2), Band()).residual
    np.testing.assert_allclose(found.prior_rms, np.sqrt(np.mean(residual**2, axis=0)))
    assert (found.prior_rms > 10 * found.rms).all()


def test_a_description_without_masses_says_nothing():
    robot = small_model().robot
    massless = replace(robot, links=[replace(link, inertial=None) for link in robot.links])
    model = replace(small_model(), robot=massless)
    assert score(model, true_estimate(), raw(run_of(2))).prior_rms is None


def test_a_joint_of_which_no_row_counts_has_no_error():
    run = run_of(2)
    blind = replace(run, mask=run.mask & (np.arange(3) != 1))
    found = score(small_model(), true_estimate(), raw(blind))
    seen = score(small_model(), true_estimate(), raw(run))
    for name in ("rms", "rms_raw", "spread", "peak", "coverage95", "prior_rms", "relative"):
        one, other = getattr(found, name), getattr(seen, name)
        assert np.isnan(one[1]), name
        np.testing.assert_array_equal(one[[0, 2]], other[[0, 2]])
    judged = validate("abc", [found], true_estimate())
    assert all(np.isfinite([check.value, check.bound]).all() for check in judged.checks)
    written = json.loads(to_json(validation_record(judged)))["recordings"][0]
    assert written["rms"][1] is None and written["prior_rms"][1] is None and written["rms"][0] == found.rms[0]


# Bands of 95 % ---------------------------------------------------------------------------------------------------


def test_bands_cover_white_noise():
    found = score(small_model(), trained(), raw(run_of(2)))
    np.testing.assert_allclose(found.coverage95, 0.95, atol=0.02)  # 1200 rows: 0.006


def test_bands_have_the_uncertainty_of_the_parameters_in_them():
    """Trained on a second of motion, the bands are wide where the parameters are unsure."""
    run = run_of(1)
    short = estimate_from(replace(run, mask=run.mask & (np.arange(1200) < 25)[:, None]))
    found = score(small_model(), short, raw(run_of(2)))
    certain = replace(short, fit=replace(short.fit, covariance=np.zeros_like(short.fit.covariance)))
    without = score(small_model(), certain, raw(run_of(2)))
    assert (found.coverage95 >= without.coverage95 + 0.2).all()


def test_a_wrong_model_is_not_covered():
    wrong = small_truth()
    wrong[[k for k, p in enumerate(small_model().parameters) if p.symbol == "FV"]] += 1.0
    found = score(small_model(), trained(), raw(run_of(2, parameters=wrong)))
    assert (found.coverage95 < 0.3).all()


@pytest.mark.parametrize("band", [Band(), BAND], ids=["raw", "filtered"])
def test_bands_of_long_recordings_are_looked_at_every_so_many_rows(monkeypatch: pytest.MonkeyPatch, band: Band):
    runs = (run_of(2), run_of(3))
    estimate = estimate_from(run_of(1), band=band)
    every_row = score(small_model(), estimate, Observations(runs, band)).coverage95
    monkeypatch.setattr(torque_validation, "COVERED_ROWS", 300)
    seen: list[int] = []
    columns = prediction_interval.all_rows

    def counted(source: object, run: ObservedRun, band: Band) -> Array:
        seen.append(len(run.rows))
        return columns(source, run, band)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(prediction_interval, "all_rows", counted)
    some = score(small_model(), estimate, Observations(runs, band)).coverage95
    np.testing.assert_allclose(some, every_row, atol=0.05)
    assert seen == [150, 150]  # columns of the other rows are never made


def test_the_band_along_a_motion_is_that_of_its_rows(monkeypatch: pytest.MonkeyPatch):
    """Sample by sample and in parts, whether torque was measured or not."""
    run, estimate = run_of(2), trained()
    expected = prediction_interval.band_of_rows(small_model(), estimate, raw(run))
    motion = run.motion[run.rows]
    monkeypatch.setattr(prediction_interval, "PART", 500)
    found = prediction_interval.torque_band(small_model(), estimate, motion)
    np.testing.assert_allclose(found, expected, rtol=1e-12)  # rounding of sums in another order
    error = run.torque[run.rows] - small_model().torque(motion, torque_parameters(estimate.base, estimate.fit))
    np.testing.assert_allclose((np.abs(error) <= found).mean(axis=0), 0.95, atol=0.02)  # 1200 rows: 0.006
    assert prediction_interval.torque_band(small_model(), estimate, motion[slice(0, 0)]).shape == (0, 3)


def test_with_friction_of_each_recording_bands_know_how_it_scatters():
    estimate = estimate_from(run_of(1), replace(run_of(4), recording=1), own_friction=True)
    assert "FV_1[2]" in estimate.fit.names
    found = score(small_model(), estimate, raw(run_of(2)))
    np.testing.assert_allclose(found.coverage95, 0.95, atol=0.03)


# The verdict ---------------------------------------------------------------------------------------------------


def a_score(rms: float, *, prior: float | None = 5.0, spread: float = 4.0, path: str = "unseen.csv") -> Score:
    same = np.ones(3)
    prior_rms = None if prior is None else prior * same
    return Score(path, "", rms * same, rms * same, spread * same, 3 * rms * same, 0.95 * same, prior_rms)


def verdict(*scores: Score, training: float = 0.1) -> tuple[str, dict[str, bool]]:
    judged = validate("abc", scores, true_estimate(training))
    return judged.verdict, {check.name: check.ok for check in judged.checks}


DESCRIPTION = "total error below the description's"
CLOSE = "total error within 3 x training or 2% of the torque"
MEAN = "relative RMS of every joint below 1"


def test_a_model_passes_that_is_good_by_every_check():
    assert verdict(a_score(0.2)) == ("pass", {DESCRIPTION: True, CLOSE: True, MEAN: True})


@pytest.mark.parametrize(
    ("scored", "failed"),
    [
        (a_score(0.2, prior=0.1), {DESCRIPTION}),
        (a_score(0.31), {CLOSE}),
        (a_score(0.2, spread=0.2), {MEAN}),
        (a_score(6.0), {DESCRIPTION, CLOSE, MEAN}),
    ],
)
def test_each_check_can_fail_by_itself(scored: Score, failed: set[str]):
    judged, checks = verdict(scored)
    assert judged == "fail" and {name for name, ok in checks.items() if not ok} == failed


def test_a_small_share_of_the_torque_is_small_after_any_training():
    assert verdict(a_score(0.079), training=1e-6)[0] == "pass"
    assert verdict(a_score(0.081), training=1e-6)[0] == "fail"


def test_a_description_without_masses_is_no_rival():
    assert verdict(a_score(0.2, prior=None)) == ("pass", {CLOSE: True, MEAN: True})


def test_one_joint_worse_than_its_mean_fails():
    scored = replace(a_score(0.1), spread=np.array([4.0, 4.0, 0.05]))
    judged, checks = verdict(scored)
    assert judged == "fail" and not checks[MEAN]


def test_a_joint_that_no_recording_compares_fails():
    unseen = replace(a_score(0.1), rms=np.array([0.1, np.nan, 0.1]))
    judged, checks = verdict(unseen)
    assert judged == "fail" and [name for name, ok in checks.items() if not ok] == [
        "joints without rows for validation (b)"
    ]
    assert verdict(unseen, a_score(0.1, path="another.csv"))[0] == "pass"


def test_without_unseen_motion_nothing_is_judged():
    assert verdict() == ("not judged", {})


def test_one_failure_among_several_recordings_is_named():
    judged, checks = verdict(a_score(0.2, path="good.csv"), a_score(0.5, path="bad.csv"))
    assert judged == "fail" and [name for name, ok in checks.items() if not ok] == [f"{CLOSE} on bad.csv"]


def test_checks_say_value_and_bound():
    judged = validate("abc", [a_score(0.2)], true_estimate(0.1))
    values = [(check.value, check.bound) for check in judged.checks]
    root = np.sqrt(3.0)
    np.testing.assert_allclose(values, [(0.2 * root, 5 * root), (0.2 * root, 0.3 * root), (0.05, 1.0)])
