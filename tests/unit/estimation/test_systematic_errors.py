"""Systematic errors in intervals: delay, zeros of encoders, noise in the regressor, and priors that are too sure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.checked_array import Array
from armid.estimation.fit_result import Fit
from armid.estimation.problem import ZERO_ANGLE, build_problem
from armid.estimation.run_estimator import estimate
from armid.estimation.standard_parameter_resolution import ConeShift
from armid.estimation.uncertainty.covariance import estimate_covariance
from armid.estimation.uncertainty.prior_scale import prior_scales
from armid.estimation.uncertainty.systematic.regressor_noise import SHARE, regressor_noise_bias
from armid.estimation.uncertainty.systematic.systematic_error_effect import (
    ConeEffect,
    ErrorEffect,
    effect_of_errors,
    effect_with_cone,
)
from armid.estimation.uncertainty.systematic.systematic_errors import ErrorKind, ErrorProducts
from armid.excitation.fourier import Excitation
from armid.measurement.log_format import LogFormat
from armid.measurement.observations import Observations
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.pipeline import differenced_noise, process_recordings
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms.ripple import Ripple
from armid.study.config import RecordingChoice
from armid.study.recordings.reading import position_zero_deviation
from noisy import RATE, WLS, arm

SECONDS = 20.0
NOISE = 0.2
"""Noise of the torque [N·m]: small enough that half a sample of delay shifts most parameters by more than it."""

LATE = 0.5 / RATE
"""Half a sample [s]."""

RUNS = 30
"""Recordings of a coverage; with seven parameters each a share is then known to about 3 %."""


WAVES, RIPPLE = 20.0, 1.0
"""Waves in a turn and amplitude [N·m] of a ripple of joint 2."""

ZEROS = LogFormat(position_zero_deviation=[2e-4, 3e-3])


def plan(slow: float = 1.0) -> Excitation:
    """A motion of two joints; `slow` times slower."""
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 2, 4)) / slow
    return Excitation(2.0 * np.pi / 10.0 / slow, a, b, np.array([0.3, -0.5]))


def recorded(
    seed: int,
    *,
    late: float = 0.0,
    zero: Array | float = 0.0,
    noise: float = NOISE,
    q_noise: float = 0.0,
    slow: float = 1.0,
    ripple: float = 0.0,
) -> Observations:
    """Observations of the small arm with noise, delay, zero errors, noise of the positions, and ripple of joint 2."""
    model, base, truth = arm()
    rng = np.random.default_rng(seed)
    time = np.arange(round(SECONDS * RATE)) / RATE
    torque = model.regressor(plan(slow).at(time - late))[:, :, base.kept] @ truth
    torque = torque + noise * rng.normal(size=torque.shape)
    torque[:, 1] += ripple * np.sin(WAVES * plan(slow).at(time).q[:, 1] + 0.7)
    q = plan(slow).at(time).q + zero + q_noise * rng.normal(size=torque.shape)
    log = Recording(time, q, effort=torque, joint_names=model.robot.joint_names, consecutive=True)
    return process_recordings([log], ProcessingOptions(), periods=[None])[0]


def identified(observations: Observations, *, zero_deviation: float | None = None) -> Fit:
    model, base, _ = arm()
    deviation = None if zero_deviation is None else np.full(2, zero_deviation)
    return estimate(build_problem(model, observations, base=base, position_zero_deviation=deviation), WLS)


def textbook(observations: Observations) -> Fit:
    """The same estimate without systematic errors in its intervals."""
    model, base, _ = arm()
    given = build_problem(model, observations, base=base)
    return estimate_covariance(WLS.solve(given), given, systematic_errors=False)


def share_inside(fits: list[Fit]) -> float:
    ends, truth = np.array([fit.intervals for fit in fits]), arm()[2]
    return float(np.mean((ends[..., 0] <= truth) & (truth <= ends[..., 1])))


def test_intervals_hold_where_the_torque_is_late_and_a_finding_says_so():
    given = [recorded(seed, late=LATE) for seed in range(RUNS)]
    fits = [identified(each) for each in given]
    assert share_inside([textbook(each) for each in given]) < 0.75
    assert share_inside(fits) >= 0.92
    for fit, each in zip(fits, given, strict=True):
        np.testing.assert_array_equal(fit.values, textbook(each).values)  # intervals alone change
        (finding,) = [finding for finding in fit.findings if finding.code == "timing-error"]
        said = [float(part.split(" ± ")[0].split()[-1]) for part in finding.evidence.split(". ")[0].split(", ")]
        np.testing.assert_allclose(said, 1e3 * LATE, rtol=0.2)  # four standard deviations of the weaker joint
        assert "`delay`" in finding.remedy


def test_intervals_are_hardly_wider_where_nothing_is_wrong():
    given = [recorded(seed) for seed in range(10)]
    fits = [identified(each, zero_deviation=0.0) for each in given]
    wider = [np.median(fit.deviation / textbook(each).deviation) for fit, each in zip(fits, given, strict=True)]
    assert np.median(wider) < 1.1
    assert not [finding for fit in fits for finding in fit.findings]


def test_intervals_hold_with_zero_errors_of_the_stated_size():
    """The default is a milliradian; noise is so small that this error is several times larger."""
    rng = np.random.default_rng(1)
    deviation = 5e-3
    given = [recorded(seed, zero=deviation * rng.normal(size=2), noise=0.02) for seed in range(RUNS)]
    assert share_inside([textbook(each) for each in given]) < 0.8
    assert share_inside([identified(each, zero_deviation=deviation) for each in given]) >= 0.9


def test_recordings_state_how_far_zeros_may_be_off():
    robot = arm()[0].robot
    stated, silent = (RecordingChoice("a.csv", reading=reading) for reading in (ZEROS, LogFormat()))
    np.testing.assert_array_equal(position_zero_deviation([stated], robot), [2e-4, 3e-3])
    np.testing.assert_array_equal(position_zero_deviation([stated, silent], robot), [ZERO_ANGLE, 3e-3])


def test_the_bias_by_noise_of_the_positions_is_predicted_and_reported():
    """In slow motion; the mean error of many recordings is the bias."""
    model, base, truth = arm()
    errors, predicted, codes = [], [], []
    for seed in range(RUNS):
        observations = recorded(seed, noise=0.05, q_noise=1e-3, slow=4.0)
        given = build_problem(model, observations, base=base)
        fit = WLS.solve(given)
        errors.append(fit.values - truth)
        predicted.append(regressor_noise_bias(given, fit.values, fit.weights, fit.covariance) / SHARE)
        codes.append({finding.code for finding in estimate_covariance(fit, given).findings})
    scatter = np.std(errors, axis=0)
    mean, expected = np.mean(errors, axis=0), np.mean(predicted, axis=0)
    most = int(np.argmax(np.abs(expected) / scatter))
    assert np.abs(expected[most]) > scatter[most]
    np.testing.assert_allclose(mean[most], expected[most], rtol=0.35)  # scatter of a mean of 30, and second order
    assert all("regressor-noise" in each for each in codes)
    assert "regressor-noise" not in {f.code for f in identified(recorded(0)).findings}


def test_intervals_hold_with_ripple_that_the_model_lacks_and_a_finding_says_so():
    given = [recorded(seed, ripple=RIPPLE) for seed in range(RUNS)]
    fits = [identified(each) for each in given]
    ends, truth = np.array([fit.intervals for fit in fits]), arm()[2]
    inside = np.mean((ends[..., 0] <= truth) & (truth <= ends[..., 1]), axis=0)
    assert inside.min() >= 0.9  # without the ripple in the intervals, that of two parameters was 0.8
    for fit, each in zip(fits, given, strict=True):
        np.testing.assert_array_equal(fit.values, textbook(each).values)  # intervals alone change
        (finding,) = [finding for finding in fit.findings if finding.code == "torque-ripple"]
        assert arm()[0].robot.joint_names[1] in finding.evidence
        assert f"harmonics = [{WAVES}]" in finding.remedy


def test_the_term_that_the_finding_about_ripple_names_explains_the_residual():
    given = recorded(0, ripple=RIPPLE)
    model = DynamicsModel(arm()[0].robot, (*arm()[0].terms, Ripple((WAVES,))))
    fit = estimate(build_problem(model, given), WLS)
    assert "torque-ripple" not in {finding.code for finding in fit.findings}
    values = dict(zip(fit.names, fit.values, strict=True))
    found = np.hypot(values["RS20_2"], values["RC20_2"])
    np.testing.assert_allclose(found, RIPPLE, rtol=0.2)  # four standard deviations


def test_recorded_velocities_leave_no_noise_of_positions():
    log = Recording(np.arange(400) / RATE, np.tile(np.sin(np.arange(400) / 20.0)[:, None], 2), consecutive=True)
    assert (differenced_noise(log, ProcessingOptions()) > 0.0).all()
    assert not differenced_noise(replace(log, dq=np.zeros_like(log.q)), ProcessingOptions()).any()


@pytest.mark.parametrize("far", [1.0, 5.0])
def test_a_prior_is_as_wide_as_its_misfit_says(far: float):
    """Links that are five standard deviations of the prior away are found so; others are left as they are."""
    rng = np.random.default_rng(2)
    parts = np.zeros((2, 40, 40))
    parts[0, range(20), range(20)] = parts[1, range(20, 40), range(20, 40)] = 1.0
    difference = rng.normal(size=40) * np.repeat([far, 1.0], 20)
    scales = prior_scales(10.0 * np.eye(40), difference, parts, np.zeros((40, 40)), 1.0)
    np.testing.assert_allclose(
        scales, np.maximum([np.mean(difference[:20] ** 2), np.mean(difference[20:] ** 2)], 1.0), rtol=0.1
    )


def cone_at_zero(error: float) -> tuple[Array, ErrorEffect, float]:
    """Two parameters of which the first cannot be negative, with an error of the data that pushes it below zero.

    Returns:
        Errors of the estimate, effect of the error on it, and share by which the cone contradicts the data.
    """
    rng = np.random.default_rng(3)
    X = rng.normal(size=(400, 2)) @ np.array([[1.0, 0.8], [0.0, 0.6]])
    V = (X @ [-1.0, 0.3] + rng.normal(size=400))[:, None]
    truth = np.array([0.1, 1.0])
    y = X @ truth + error * V[:, 0] + rng.normal(size=400)
    H = X.T @ X
    free = np.linalg.solve(H, X.T @ y)
    held = free if free[0] >= 0.0 else np.array([0.0, free[1] + H[1, 0] / H[1, 1] * free[0]])
    barrier = np.diag([1e4 if free[0] < 0.0 else 0.0, 0.0])
    r, parts = y - X @ held, np.arange(400).reshape(8, 50)
    products = ErrorProducts(
        (ErrorKind("rise", 0, 1.0),),
        *(np.array(each) for each in zip(*(
            (X[p].T @ X[p], X[p].T @ V[p], V[p].T @ V[p], X[p].T @ r[p], V[p].T @ r[p]) for p in parts
        ), strict=True)),
    )  # fmt: skip
    with_cone, without = np.linalg.inv(H + barrier), np.linalg.inv(H)
    cone = ConeEffect(barrier, ConeShift(np.zeros((2, 2)), held - free), without, 1.0)
    effect = effect_with_cone(effect_of_errors(products, with_cone, barrier), products, cone)
    return held - truth, effect, cone.contradicted


def test_a_cone_that_the_data_contradict_does_not_hide_an_error():
    """The error pushes the data out of the cone, and the cone moves another parameter by ten deviations."""
    error, effect, contradicted = cone_at_zero(2.0)
    assert contradicted > 0.9
    assert (np.abs(error) <= 1.96 * np.sqrt(np.diag(effect.covariance))).all()


def test_a_cone_that_the_data_do_not_contradict_leaves_the_effect_of_errors_as_it_is():
    _, effect, contradicted = cone_at_zero(0.0)
    assert contradicted == 0.0
    assert np.sqrt(np.diag(effect.covariance)).max() < 0.2  # the error is known to 1 / √400
