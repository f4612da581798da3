"""The robust estimate: as good as least squares on normal noise, hardly moved by contact, and its intervals cover."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.estimators import RobustLeastSquares, WeightedLeastSquares
from armid.estimation.estimators.robust import HUBER, TUKEY
from armid.estimation.fit_result import Fit
from armid.estimation.friction_per_recording import separate_by_recording
from armid.estimation.least_squares import Solution
from armid.estimation.problem import EstimationProblem, standard_of
from armid.estimation.run_estimator import estimate
from armid.estimation.uncertainty.covariance import estimate_covariance
from armid.information.accumulate import accumulate_information
from armid.information.information import stack, total
from informed import NOISE, RATE, Arm, branching_arm, dense, recorded
from problems import one_run, raw

WLS = WeightedLeastSquares()
LOSSES = pytest.mark.parametrize("loss", ["huber", "tukey"])

CONTACT = 40.0
"""Torque of a contact [N·m]: two hundred deviations of the noise."""

TOUCHED = 0.05
LASTING = 10
"""Share of rows during contact, and rows that one lasts."""

EFFICIENCY = 0.95
"""Of both losses at their constants, on normal noise."""


@cache
def arm() -> Arm:
    return branching_arm()


def problem(seed: int, *, touched: float = 0.0, noise: float = NOISE, recordings: int = 1) -> EstimationProblem:
    """Recordings with noise, during a share of which something touches the arm."""
    model, base, _ = arm()
    runs = []
    for k in range(recordings):
        motion, torque = recorded(arm(), 50 * seed + k, noise=0.0)
        rng = np.random.default_rng(seed + 1000 * k)
        torque = torque + noise * rng.normal(size=torque.shape)
        for start in rng.choice(len(torque) - LASTING, int(touched * len(torque) / LASTING), replace=False):
            torque[start : start + LASTING] += CONTACT * rng.normal(size=model.n)
        runs.append(replace(one_run(motion, torque, RATE), recording=k))
    observations = raw(*runs)
    return EstimationProblem(
        accumulate_information(model, base, observations), standard_of(model, base), model, base, observations
    )


def error(fit: Fit) -> float:
    """Of the values, in the deviations that least squares has without contact."""
    A, _ = stack(total(problem(1).information))
    return float(np.sqrt(np.mean(((fit.values - arm()[2]) ** 2) * np.diag(A.T @ A)))) / NOISE


@LOSSES
def test_on_normal_noise_it_agrees_with_least_squares_within_its_efficiency(loss: str):
    given = problem(1)
    fit, plain = RobustLeastSquares(loss).solve(given), WLS.solve(given)  # pyright: ignore[reportArgumentType]
    # The difference of two estimates of which one is efficient has the difference of their variances.
    spread = np.sqrt(1.0 / EFFICIENCY - 1.0) * plain.deviation
    assert np.sqrt(np.mean(((fit.values - plain.values) / spread) ** 2)) < 1.5
    np.testing.assert_allclose(fit.deviation, plain.deviation / np.sqrt(EFFICIENCY), rtol=0.05)
    np.testing.assert_allclose(1.0 / fit.weights, NOISE, rtol=0.1)
    np.testing.assert_array_equal(fit.rows, plain.rows)


def test_contact_hardly_moves_it_and_ruins_least_squares():
    touched, clean = ([problem(seed, touched=share) for seed in range(6)] for share in (TOUCHED, 0.0))

    def size(fits: list[Fit]) -> float:
        return float(np.sqrt(np.mean([error(fit) ** 2 for fit in fits])))

    without = size([WLS.solve(given) for given in clean])
    assert size([WLS.solve(given) for given in touched]) > 10 * without
    assert size([RobustLeastSquares().solve(given) for given in touched]) < 1.2 * without
    assert size([RobustLeastSquares("huber").solve(given) for given in touched]) < 2.5 * without


@LOSSES
def test_rows_in_contact_are_counted_and_named(loss: str):
    clean, touched = (
        RobustLeastSquares(loss).solve(problem(1, touched=share))  # pyright: ignore[reportArgumentType]
        for share in (0.0, TOUCHED)
    )
    for fit, low, high in ((clean, 0, 30), (touched, 50, 90)):
        (finding,) = fit.findings
        assert finding.code == "rows-down-weighted"
        counts = [int(part.split()[-3]) for part in finding.evidence.rstrip(".").split(",")]
        assert len(counts) == 4 and all(low <= count <= high for count in counts)


@LOSSES
@pytest.mark.parametrize("share", [0.0, TOUCHED])
def test_intervals_cover_the_truth(loss: str, share: float):
    """From the scatter of blocks, whose scores are ψ; contact lasts, so residuals are anything but white."""
    off: list[Array] = []
    inside: list[NDArray[np.bool_]] = []
    for seed in range(20):
        given = problem(seed, touched=share)
        covered = estimate(given, RobustLeastSquares(loss))  # pyright: ignore[reportArgumentType]
        ends = covered.intervals
        inside.append((ends[:, 0] <= arm()[2]) & (arm()[2] <= ends[:, 1]))
        off.append((covered.values - arm()[2]) / np.sqrt(np.diag(covered.covariance)))
    assert np.mean(inside) >= 0.92  # of 660 intervals, those of one recording hanging together
    assert 0.7 <= np.sqrt(np.mean(np.square(off))) <= 1.15  # intervals hold systematic errors, too; here are none


@LOSSES
def test_the_factors_it_hands_on_have_it_as_their_solution_and_its_slope(loss: str):
    """Rows beyond the bend answer no more to a change of torque: the normal equations are those of ψ' on the mean."""
    given = problem(2, touched=TOUCHED)
    fit = RobustLeastSquares(loss).solve(given)  # pyright: ignore[reportArgumentType]
    assert fit.information is not None and given.observations is not None
    A, y = stack(total(fit.information), fit.weights)
    own = np.linalg.lstsq(A, y, rcond=None)[0]
    assert (np.abs(own - fit.values) < 0.02 * fit.deviation).all()
    rows = dense(arm(), given.observations.runs[0])
    u = (rows[:, :, -1] - rows[:, :, :-1] @ fit.values) * fit.weights
    constant = HUBER if loss == "huber" else TUKEY
    if loss == "huber":
        slope = (np.abs(u) < constant).astype(float)
    else:
        slope = np.where(np.abs(u) < constant, (1 - (u / constant) ** 2) * (1 - 5 * (u / constant) ** 2), 0.0)
    x = rows[:, :, :-1] * fit.weights[:, None]
    H = np.einsum("mj,mja,mjb->ab", slope, x, x)
    np.testing.assert_allclose(np.diag(A.T @ A), np.diag(H), rtol=0.1)


def test_masked_rows_stay_out():
    given = problem(3)
    assert given.observations is not None and given.model is not None and given.base is not None
    run = given.observations.runs[0]
    mask = run.mask.copy()
    mask[300:400, 1] = False
    torque = run.torque.copy()
    torque[300:400, 1] = 1e6
    observations = raw(replace(run, mask=mask, torque=torque))
    masked = replace(
        given, information=accumulate_information(given.model, given.base, observations), observations=observations
    )
    fit = RobustLeastSquares().solve(masked)
    assert (np.abs(fit.values - arm()[2]) < 5.0 * fit.deviation).all()
    assert fit.rows[1] == fit.rows[0] - 100


def test_friction_of_each_recording_is_robust_too():
    given = problem(4, touched=TOUCHED, recordings=2)
    own = np.array([name.startswith(("FV", "FS", "FO")) for name in given.information.names])
    apart = replace(given, information=separate_by_recording(given.information, own))
    fit = RobustLeastSquares().solve(apart)
    assert fit.names == apart.information.names
    truth = dict(zip(arm()[1].names, arm()[2], strict=True))
    exact = np.array([truth[name.split("[", 1)[0]] for name in fit.names])
    assert (np.abs(fit.values - exact) < 5.0 * fit.deviation).all()
    assert np.isfinite(estimate_covariance(fit, apart).intervals).all()


def test_without_samples_it_says_what_it_lacks():
    with pytest.raises(EstimationError, match="needs the samples") as caught:
        RobustLeastSquares().solve(EstimationProblem(problem(1).information))
    assert "observations" in caught.value.remedy


def test_too_few_iterations_are_no_estimate():
    with pytest.raises(EstimationError, match="did not converge in 1 iterations") as caught:
        RobustLeastSquares(iterations=1).solve(problem(1, touched=TOUCHED))
    assert "huber" in caught.value.remedy


@pytest.mark.parametrize("wrong", [{"loss": "cauchy"}, {"constant": 0.0}, {"constant": np.inf}])
def test_wrong_options_are_refused(wrong: dict[str, object]):
    with pytest.raises(EstimationError) as caught:
        RobustLeastSquares(**wrong)  # pyright: ignore[reportArgumentType]
    assert caught.value.possible


def test_with_a_large_constant_it_is_least_squares():
    given = problem(1)
    fit = RobustLeastSquares("huber", 20.0).solve(given)
    plain = Solution(total(given.information), fit.weights)
    np.testing.assert_allclose(fit.values, plain.values, rtol=0, atol=1e-6)
    np.testing.assert_allclose(fit.deviation, np.sqrt(np.diag(plain.inverse)), rtol=0.03)  # scales by median and mean
