"""Essential parameters: elimination by small updates is elimination by fitting again, and says its price."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.estimators import EssentialParameters, WeightedLeastSquares
from armid.estimation.estimators import essential as module
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.covariance import estimate_covariance
from armid.information.accumulate import accumulate_information
from armid.information.information import stack, total
from informed import NOISE, RATE, Arm, branching_arm, recorded
from problems import one_run, raw

WLS = WeightedLeastSquares()

SAME = 1e-8
"""Relative difference of updates and of a new fit: rounding times the square of a condition number of hundreds."""

IDLE = ("FV_1", "FO_2", "FS_3")
"""Parameters that are zero in truth."""


@cache
def arm() -> Arm:
    model, base, truth = branching_arm()
    truth = truth.copy()
    truth[[base.names.index(name) for name in IDLE]] = 0.0
    return model, base, np.sign(truth) * (0.3 + np.abs(truth)) * (truth != 0.0)


@cache
def problem(seed: int = 1, noise: float = NOISE) -> EstimationProblem:
    motion, torque = recorded(arm(), seed, noise=noise)
    return EstimationProblem(accumulate_information(arm()[0], arm()[1], raw(one_run(motion, torque, RATE))))


def uncorrelated(*given: object) -> float:
    """Every row counts."""
    del given
    return 1.0


def refitted(given: EstimationProblem, choose: Callable[[Array, Array, float], int | None]) -> list[int]:
    """Parameters left when after each one the others are fitted anew; told values, deviations and cost."""
    weights = WLS.solve(given).weights
    A, y = stack(total(given.information), weights)
    left = list(range(A.shape[1]))
    while True:
        own = A[:, left]
        values: Array = np.asarray(np.linalg.lstsq(own, y, rcond=None)[0], dtype=np.float64)
        deviation: Array = np.asarray(np.sqrt(np.diag(np.linalg.inv(own.T @ own))), dtype=np.float64)
        k = choose(values, deviation, float(np.sum((y - own @ values) ** 2)))
        if k is None:
            return left
        del left[k]


@pytest.mark.parametrize("ratio", [10.0, 30.0, 100.0])
def test_the_ratio_rule_is_that_of_fits_made_anew(ratio: float):
    def choose(values: Array, deviation: Array, cost: float) -> int | None:
        del cost
        relative = deviation / np.abs(values)
        return int(np.argmax(relative)) if relative.max() > ratio * relative.min() else None

    fit = EssentialParameters(ratio=ratio, price=np.inf).solve(problem())
    left = refitted(problem(), choose)
    assert fit.dropped == tuple(name for k, name in enumerate(fit.names) if k not in left)
    assert len(fit.dropped) > 0


def test_the_criterion_is_that_of_fits_made_anew(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "_correlation", uncorrelated)
    rows = float(problem().information.rows.sum())

    def choose(values: Array, deviation: Array, cost: float) -> int | None:
        del cost
        rise = (values / deviation) ** 2
        return int(np.argmin(rise)) if rise.min() < np.log(rows) else None

    fit = EssentialParameters("bic").solve(problem())
    left = refitted(problem(), choose)
    assert fit.dropped == tuple(name for k, name in enumerate(fit.names) if k not in left)


def test_what_is_left_is_fitted_and_what_is_dropped_is_zero():
    given = problem()
    fit = EssentialParameters().solve(given)
    left = [k for k, name in enumerate(fit.names) if name not in fit.dropped]
    A, y = stack(total(given.information), fit.weights)
    expected = np.zeros(len(fit.names))
    expected[left] = np.linalg.lstsq(A[:, left], y, rcond=None)[0]
    np.testing.assert_allclose(fit.values, expected, rtol=0, atol=SAME * np.abs(expected).max())
    assert fit.names == arm()[1].names and not fit.values[[fit.names.index(name) for name in fit.dropped]].any()
    assert fit.scaled_condition <= WLS.solve(given).scaled_condition


@pytest.mark.parametrize("criterion", ["pham-gautier", "bic"])
def test_parameters_that_are_zero_are_dropped_and_large_ones_are_not(criterion: str):
    fit = EssentialParameters(criterion).solve(problem())  # pyright: ignore[reportArgumentType]
    assert set(IDLE) <= set(fit.dropped)
    sure = np.abs(arm()[2]) > 20.0 * fit.deviation
    assert sure.sum() > 10 and not set(np.array(fit.names)[sure]) & set(fit.dropped)


def test_the_price_is_kept_and_told():
    given, plain = problem(), WLS.solve(problem())

    def weighted(rms: Array) -> float:
        return float(np.sqrt(np.sum((plain.weights * rms) ** 2 * plain.rows)))

    for price in (0.0, 0.001, 0.02):
        fit = EssentialParameters(ratio=1.0, price=price).solve(given)
        rise = weighted(fit.residual_rms) / weighted(plain.residual_rms) - 1.0
        assert -SAME <= rise <= price + SAME
        (finding,) = fit.findings
        said = float(finding.evidence.split("weighted residual by ")[1].split(" %")[0])
        assert said == pytest.approx(100 * rise, rel=0.06, abs=1e-6)
        assert all(name in finding.evidence for name in fit.dropped)


def test_exact_data_lose_nothing_that_is_there():
    fit = EssentialParameters().solve(problem(noise=0.0))
    assert set(fit.dropped) <= set(IDLE)
    np.testing.assert_allclose(fit.values, arm()[2], rtol=0, atol=SAME * np.abs(arm()[2]).max())


def test_intervals_are_no_shorter_for_having_chosen():
    """Of what is held at zero too, so that it covers the truth."""
    given = problem()
    fit, plain = EssentialParameters().solve(given), WLS.solve(given)
    np.testing.assert_array_equal(fit.deviation, plain.deviation)
    ends = estimate_covariance(fit, given).intervals
    for name in fit.dropped:
        low, high = ends[fit.names.index(name)]
        assert low < 0.0 < high
    assert np.mean((ends[:, 0] <= arm()[2]) & (arm()[2] <= ends[:, 1])) >= 0.85


def test_correlated_residuals_are_worth_fewer_rows():
    """Noise that lasts: the criterion must not keep what it would on as many independent rows."""
    motion, torque = recorded(arm(), 1, seconds=60.0, noise=0.0)
    rng = np.random.default_rng(1)
    noise = NOISE * np.repeat(rng.normal(size=(len(torque) // 50 + 1, torque.shape[1])), 50, axis=0)[: len(torque)]
    white = NOISE * rng.normal(size=torque.shape)
    counts = []
    for added in (noise, white):
        given = EstimationProblem(
            accumulate_information(arm()[0], arm()[1], raw(one_run(motion, torque + added, RATE, block_rows=100)))
        )
        counts.append(len(EssentialParameters("bic").solve(given).dropped))
    assert counts[0] > counts[1] and counts[0] < arm()[1].count / 2


def test_a_whole_elimination_of_78_parameters_takes_milliseconds():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(300, 78))
    inverse, values = np.linalg.inv(A.T @ A), rng.normal(size=78)
    seconds: list[float] = []
    left = np.arange(78)
    for _ in range(5):
        began = time.process_time()
        left = module._eliminate(values, inverse, module._least_sure(1.0, np.inf))  # pyright: ignore
        seconds.append(time.process_time() - began)
    assert len(left) == 1 and min(seconds) < 0.05


@pytest.mark.parametrize("wrong", [{"criterion": "aic"}, {"ratio": 0.5}, {"price": -1.0}, {"ratio": np.nan}])
def test_wrong_options_are_refused(wrong: dict[str, object]):
    with pytest.raises(EstimationError) as caught:
        EssentialParameters(**wrong)  # pyright: ignore[reportArgumentType]
    assert caught.value.possible
