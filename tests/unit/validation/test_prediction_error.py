"""Laws of the prediction intervals of another recording: factor, distance from training, left-out recordings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from armid.estimation.estimators.physical import PhysicallyConsistent
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem, build_problem
from armid.estimation.run_estimator import estimate
from armid.estimation.uncertainty import recording_change as changes
from armid.estimation.uncertainty.left_out_recordings import leave_out_recordings
from armid.estimation.uncertainty.prediction_error import (
    BETWEEN_ARMS,
    PredictionError,
    expected_error,
    prediction_error,
    updated,
    with_model_error,
)
from armid.estimation.uncertainty.recording_change import (
    FRICTION,
    OFFSET,
    RecordingChange,
    mean_parameter_variance,
    recording_change,
)
from armid.estimation.uncertainty.recording_scatter import with_recording_scatter
from armid.information.kept_rows import kept_rows
from armid.maths.distributions import NORMAL, scale_mixture_quantile
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from labs import small_model, small_plan, small_truth
from problems import one_run

RATE, NOISE = 50.0, 0.05

ROUNDING = 1e-10
"""Relative error of sums over some thousand rows."""


def run_of(seed: int, recording: int = 0, *, friction: float = 1.0) -> ObservedRun:
    """24 s of the small arm with white noise; all friction is multiplied by a factor."""
    model, truth = small_model(), small_truth()
    changing = np.array([p.name.startswith(("FV", "FS")) for p in model.parameters])
    motion = small_plan(seed).sample(RATE, 3)
    torque = model.torque(motion, np.where(changing, friction, 1.0) * truth)
    torque = torque + NOISE * np.random.default_rng(seed).normal(size=torque.shape)
    return replace(one_run(motion, torque, RATE), recording=recording)


def observed(*runs: ObservedRun) -> Observations:
    return Observations(runs, Band())


def test_the_quantile_of_a_scale_mixture_holds_its_share():
    """By simulation; 2 000 000 draws give the share to 0.0002, one standard deviation."""
    rng = np.random.default_rng(0)
    assert scale_mixture_quantile(0.0) == pytest.approx(NORMAL, rel=1e-6)
    for deviation in (0.2, 0.5, 0.7):
        draws = np.exp(deviation * rng.normal(size=2_000_000)) * rng.normal(size=2_000_000)
        inside = np.mean(np.abs(draws) <= scale_mixture_quantile(deviation))
        assert abs(inside - 0.95) < 5 * 0.0002


def test_the_mean_variance_is_that_of_the_rows():
    problem = build_problem(small_model(), observed(run_of(1)))
    fit = estimate(problem)
    found = mean_parameter_variance(problem.information, fit.covariance)
    for j, joint in enumerate(problem.information.joints):
        own = fit.covariance[np.ix_(joint.parameters, joint.parameters)]
        squares = sum(np.trace(R[:, :-1] @ own @ R[:, :-1].T) for R in joint.R)
        assert found[j] == pytest.approx(squares / problem.information.rows[:, j].sum(), rel=ROUNDING)


def test_the_variance_grows_with_the_distance_from_the_training_motion():
    error = PredictionError(1, np.full(2, 0.01), np.array([[-1.0, 1.0], [0.0, 0.5]]))
    inside, outside, far = np.zeros((1, 2)), np.array([[1.5, 0.0]]), np.array([[3.0, 0.0]])
    usual = with_model_error(error, np.full((1, 2), 0.01), np.full(2, 0.1), inside)
    assert (usual == with_model_error(error, np.full((1, 2), 0.01), np.full(2, 0.1), np.array([[0.9, 0.4]]))).all()
    away = [with_model_error(error, np.full((1, 2), 0.01), np.full(2, 0.1), each) for each in (outside, far)]
    assert (usual < away[0]).all() and (
        away[0] < away[1]
    ).all()  # of every joint: its torque depends on all positions
    unlike = with_model_error(error, np.full((1, 2), 0.16), np.full(2, 0.1), inside)
    assert (unlike > 0.01 + 2.0 * 0.16).all()


NO_CHANGE = RecordingChange()


def change_of(problem: EstimationProblem, fit: Fit) -> RecordingChange:
    """Usual change of friction and offsets of a problem with samples."""
    model, base, observations = problem.require_samples("the test")
    return recording_change(model, base, fit.values, problem.information, observations)


def test_left_out_recordings_determine_the_factor():
    error = PredictionError(3, np.full(2, 0.01), np.zeros((2, 2)))
    assert updated(error, []) == error
    alike = updated(error, [np.full(2, 0.4)] * 3)
    assert 0.2 < alike.log_factor < 0.4 and alike.log_deviation < error.log_deviation
    many = updated(error, [np.full(2, 0.4)] * 1000)
    assert many.log_factor == pytest.approx(0.4, abs=1e-3)
    assert abs(updated(error, [np.full(2, BETWEEN_ARMS)]).log_factor) < BETWEEN_ARMS


def test_left_out_recordings_determine_the_deviation_between_joints():
    """One new recording has the deviations between recordings and joints that many left-out recordings have."""
    rng = np.random.default_rng(1)
    error = PredictionError(3, np.full(7, 0.01), np.zeros((7, 2)))
    for deviation in (0.1, 0.8):
        drawn = rng.normal(0.0, 0.1, (2000, 1)) + rng.normal(0.0, deviation, (2000, 7))
        # The mean over seven joints contains their scatter: its variance is 1/7 of that between the joints.
        expected = math.sqrt(0.1**2 + deviation**2 * (1.0 + 1.0 / 7.0))
        assert updated(error, list(drawn)).log_deviation == pytest.approx(expected, rel=0.02)
    assert updated(error, [np.zeros(0)]) == error


def test_what_has_no_effect_on_predictions_does_not_widen_them():
    """Misfit of the prior never, systematic errors only where no recording shows their effect."""
    problem = build_problem(small_model(), observed(run_of(1)))
    fit = estimate(problem)
    some = 0.3 * fit.covariance
    none = np.zeros((0, 0))
    wider = replace(fit, covariance=fit.covariance + some)
    misfit = replace(wider, report=replace(fit.report, by_misfit=some, by_systematic=none))
    systematic = replace(wider, report=replace(fit.report, by_misfit=none, by_systematic=some))
    only = replace(fit, report=replace(fit.report, by_misfit=none, by_systematic=none))
    alone = prediction_error(problem.information, only, observed(run_of(1)), NO_CHANGE)

    def ratio(of: Fit, *, left_out: bool) -> float:
        error = prediction_error(problem.information, of, observed(run_of(1)), NO_CHANGE, left_out=left_out)
        np.testing.assert_allclose(
            error.parameter_variance,
            mean_parameter_variance(problem.information, error.effective(of.covariance)),
            rtol=ROUNDING,
        )
        return float(np.max(error.parameter_variance / alone.parameter_variance))

    assert ratio(misfit, left_out=False) == pytest.approx(1.0, rel=ROUNDING)
    assert ratio(systematic, left_out=True) == pytest.approx(1.0, rel=ROUNDING)
    assert ratio(systematic, left_out=False) == pytest.approx(1.3, rel=ROUNDING)


def test_recordings_alike_are_predicted_as_noise_explains(monkeypatch: pytest.MonkeyPatch):
    """Without the assumed change, the mean logarithm is 0; of twelve joints of recordings, its deviation is 0.05."""
    monkeypatch.setattr(changes, "FRICTION", 0.0)
    monkeypatch.setattr(changes, "OFFSET", 0.0)
    model, both = small_model(), observed(*(run_of(k, k) for k in range(4)))
    problem = build_problem(model, both)
    left_out = leave_out_recordings(problem, estimate)
    assert [each.recordings for each in left_out] == [(0,), (1,), (2,), (3,)]
    assert abs(np.mean([each.log_factors.mean() for each in left_out])) < 0.15
    fit = estimate(problem)
    none = np.zeros_like(fit.covariance)
    wider = with_recording_scatter(fit, left_out, 4, none, none)
    ratio = wider.deviation / fit.deviation
    assert (ratio >= 1.0).all() and np.median(ratio) < 1.3  # by chance, single parameters differ by two deviations
    assert leave_out_recordings(build_problem(model, observed(run_of(1))), estimate) == ()


def test_the_problem_without_a_recording_is_that_of_the_others():
    """Factors and rows that are taken from those of all recordings, against those of the other recordings alone."""
    model, runs = small_model(), [run_of(k, k) for k in range(3)]
    seen: list[EstimationProblem] = []

    def solve(part: EstimationProblem) -> Fit:
        seen.append(part)
        return estimate(part)

    whole = build_problem(model, observed(*runs), scale_deviation=np.full(model.n, 0.1))
    list(kept_rows(model, whole.require_samples("the test")[1], whole.require_samples("the test")[2]))
    leave_out_recordings(whole, solve)
    for k, part in enumerate(seen):
        alone = build_problem(model, observed(*(run for run in runs if run.recording != k)))
        base, rows = part.require_samples("the test")[1:]
        for found, known in zip(part.information.joints, alone.information.joints, strict=True):
            np.testing.assert_array_equal(found.R, known.R)
        for name in ("rows", "run", "recording", "scale_deviation"):
            np.testing.assert_array_equal(getattr(part.information, name), getattr(alone.information, name))
        both = zip(kept_rows(model, base, rows), kept_rows(model, base, alone.require_samples("")[2]), strict=True)
        for batch, other in both:
            assert (batch.run, batch.begin) == (other.run, other.begin)
            np.testing.assert_array_equal(batch.x, other.x)


def test_friction_that_changes_between_recordings_widens_intervals_and_bands():
    """Friction x 1, 1.3, 0.8, 1.1: intervals of noise alone would hold hardly any of the values."""
    factors = (1.0, 1.3, 0.8, 1.1)
    problem = build_problem(small_model(), observed(*(run_of(k, k, friction=f) for k, f in enumerate(factors))))
    fit = estimate(problem)
    left_out = leave_out_recordings(problem, estimate)
    factor = updated(
        prediction_error(problem.information, fit, problem.observations, NO_CHANGE),
        [x.log_factors for x in left_out],
    )
    assert factor.log_deviation > 0.7  # the factors differ by 0.8
    none = np.zeros_like(fit.covariance)
    wider = with_recording_scatter(fit, left_out, 4, none, none)
    friction = [k for k, name in enumerate(fit.names) if name.symbol in ("FV", "FS")]
    ratio = wider.deviation / fit.deviation
    assert np.median(ratio[friction]) > 1.5
    np.testing.assert_allclose(wider.values, fit.values)


def test_the_expected_error_is_an_interval_about_the_explained_error():
    problem = build_problem(small_model(), observed(run_of(1)))
    fit = estimate(problem)
    expected = expected_error(prediction_error(problem.information, fit, observed(run_of(1)), NO_CHANGE), fit.noise)
    assert (expected.low < expected.rms).all() and (expected.rms < expected.high).all()
    assert (expected.rms >= fit.noise).all() and math.isclose(
        expected.rms[0] ** 2, expected.low[0] * expected.high[0]
    )


def test_the_change_between_recordings_is_that_of_friction_and_offsets():
    """Friction that is larger or smaller by its deviation changes the torque by so much in the mean of the rows."""
    run = run_of(1)
    problem = build_problem(small_model(), observed(run))
    fit = estimate(problem)
    change = change_of(problem, fit)
    model, base = small_model(), problem.require_samples("the test")[1]
    theta = np.zeros(len(model.parameters))
    laws = np.isin(base.kept, model.law_columns)
    theta[base.kept[laws]] = fit.values[laws]
    friction = model.torque(run.motion, theta)[run.rows]
    offset = OFFSET * np.ptp(run.torque[run.rows], axis=0)
    np.testing.assert_allclose(change.variance, np.mean((FRICTION * friction) ** 2, axis=0) + offset**2, rtol=1e-6)
    np.testing.assert_allclose(change.offset, offset)  # the model has no offset
    error = prediction_error(problem.information, fit, observed(run), change)
    without = prediction_error(problem.information, fit, observed(run), NO_CHANGE)
    assert (expected_error(error, fit.noise).rms > expected_error(without, fit.noise).rms).all()


def test_an_assumed_change_explains_scatter_and_widens_intervals_by_its_share():
    """C / R is added, and what is assumed is not multiplied a second time."""
    factors = (1.0, 1.0 + FRICTION, 1.0 - FRICTION)
    problem = build_problem(small_model(), observed(*(run_of(k, k, friction=f) for k, f in enumerate(factors))))
    fit = estimate(problem)
    left_out = leave_out_recordings(problem, estimate)
    none, change = np.zeros_like(fit.covariance), change_of(problem, fit).covariance
    plain, aware = (with_recording_scatter(fit, left_out, 3, none, each) for each in (none, change))
    friction = [k for k, name in enumerate(fit.names) if name.symbol in ("FV", "FS")]
    least = np.sqrt(np.diag(fit.covariance + change / 3.0))
    assert (aware.deviation[friction] >= least[friction] * (1.0 - ROUNDING)).all()
    assert (aware.deviation[friction] > fit.deviation[friction]).all()
    assert ((aware.deviation / least)[friction] < (plain.deviation / fit.deviation)[friction]).all()


def test_standard_parameters_have_the_change_of_their_friction():
    """The share C / R is added to the variance of noise, whatever the kind of the parameter."""
    factors = (1.0, 1.0 + FRICTION, 1.0 - FRICTION)
    problem = build_problem(small_model(), observed(*(run_of(k, k, friction=f) for k, f in enumerate(factors))))
    method = PhysicallyConsistent()
    fit = estimate(problem, method)
    assert fit.standard is not None
    left_out = leave_out_recordings(problem, lambda part: estimate(part, method))
    none, change = np.zeros_like(fit.covariance), change_of(problem, fit).covariance
    aware = with_recording_scatter(fit, left_out, 3, none, change).standard
    assert aware is not None
    for k, name in enumerate(fit.standard.names):
        if name.symbol in ("FV", "FS"):
            added = change[fit.names.index(name), fit.names.index(name)] / 3.0
            assert aware.covariance[k, k] >= (fit.standard.covariance[k, k] + added) * (1.0 - ROUNDING)
            assert np.ptp(aware.intervals[k]) > np.ptp(fit.standard.intervals[k])
