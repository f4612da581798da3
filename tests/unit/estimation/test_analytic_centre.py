"""Intervals of consistent estimates: what the cone makes of weak data, and standard beside base parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from armid.checked_array import Array
from armid.estimation.estimators import PhysicallyConsistent, WeightedLeastSquares
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem, standard_of
from armid.estimation.run_estimator import estimate
from armid.estimation.standard_parameter_resolution import map_to_standard
from armid.information.accumulate import accumulate_information
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.base_parameters import find_base_parameters
from armid.study.storage.records import certificate_record
from labs import small_model_with_rotors as model
from labs import small_truth_with_rotors as truth
from problems import lively_motion

RATE, NOISE, MEMORY = 50.0, 0.3, 0.1
DRAWS = 30

COVERED = (0.90, 0.995)
"""Share of 95 % intervals that contain the truth: thirty draws, whose parameters go wrong together, know it to two or
three in a hundred."""

SAME = 1e-6
"""Relative difference of two ways to one interval."""


def recorded(seed: int, seconds: float = 20.0, scale: float = 0.0, noise: float = NOISE) -> EstimationProblem:
    """The small arm with noise that remembers a tenth of a second."""
    base = find_base_parameters(model())
    motion = lively_motion(np.random.default_rng(1), 3, RATE, seconds)
    a = np.exp(-1.0 / (RATE * MEMORY))
    white = np.random.default_rng(seed).normal(size=(motion.samples + 500, 3))
    coloured = np.asarray(lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], white, axis=0), dtype=np.float64)[500:]
    torque = model().torque(motion, truth()) + noise * coloured
    block = np.arange(motion.samples, dtype=np.int64) // int(RATE)
    run = ObservedRun(motion, torque, RATE, 1, 0, np.ones(motion.q.shape, dtype=bool), block)
    observations = Observations((run,), Band())
    information = accumulate_information(model(), base, observations)
    information = replace(information, scale_deviation=np.full(3, scale))
    return EstimationProblem(information, standard_of(model(), base), model(), base, observations)


def found(problem: EstimationProblem, **options: object) -> Fit:
    method = PhysicallyConsistent(**options)  # pyright: ignore[reportArgumentType]
    return estimate(problem, method)


@pytest.mark.parametrize("prior", ["mass", "log-det"])
def test_intervals_of_identified_standard_parameters_cover(prior: str):
    shares: list[float] = []
    bases: list[float] = []
    for seed in range(DRAWS):
        problem = recorded(seed)
        fit = found(problem, prior=prior, weight=1.0)
        assert fit.standard is not None and problem.base is not None and fit.covariance_kind == "spectral"
        identified = np.array(fit.standard.status) == "identified"
        assert identified.sum() >= 8
        shares.append(inside(fit.standard.intervals, truth())[identified].mean())
        bases.append(inside(fit.intervals, problem.base.regrouping @ truth()).mean())
    assert COVERED[0] < np.mean(shares) < COVERED[1]
    assert COVERED[0] < np.mean(bases) < COVERED[1]


def inside(ends: Array, values: Array) -> Array:
    return ((ends[:, 0] <= values) & (values <= ends[:, 1])).astype(np.float64)


@pytest.mark.parametrize("prior", ["mass", "log-det", "euclidean", "none"])
@pytest.mark.parametrize("scale", [0.0, 0.1])
def test_a_parameter_that_stands_alone_has_one_interval(prior: str, scale: float):
    """Uncertain drive gains, correlated rows and the cone are in both or in neither."""
    problem = recorded(3, scale=scale)
    fit = found(problem, prior=prior, weight=1.0)
    base, standard = problem.base, fit.standard
    assert base is not None and standard is not None and standard.lift is None
    alone = np.flatnonzero(np.count_nonzero(base.regrouping, axis=1) == 1)
    own = base.kept[alone]
    free = standard.intervals[own, 0] > 0.0  # an interval that is cut at zero differs by that
    assert free.sum() >= 5
    np.testing.assert_allclose(standard.intervals[own, 1], fit.intervals[alone, 1], rtol=SAME)
    np.testing.assert_allclose(standard.intervals[own][free, 0], fit.intervals[alone][free, 0], rtol=SAME)


def test_the_cone_narrows_what_weak_data_leave_open():
    """Noise of the size of the torque: least squares leaves much open that no body has."""
    ratios: list[Array] = []
    shares: list[float] = []
    for seed in range(DRAWS):
        problem = recorded(seed, seconds=8.0, noise=6.0)
        weak, plain = found(problem), estimate(problem)
        assert problem.base is not None
        ratios.append(np.sqrt(np.diag(weak.covariance) / np.diag(plain.covariance)))
        shares.append(inside(weak.intervals, problem.base.regrouping @ truth()).mean())
    assert np.median(ratios, axis=0).min() < 0.4
    assert COVERED[0] < np.mean(shares) < COVERED[1]


def test_a_lift_splits_the_posterior_into_what_base_parameters_say_and_the_rest():
    rng = np.random.default_rng(0)
    L = rng.normal(size=(3, 6))
    X, Y = rng.normal(size=(6, 6)), rng.normal(size=(3, 3))
    P, H = X @ X.T + np.eye(6), Y @ Y.T + np.eye(3)
    split = map_to_standard(P, L, np.eye(6), 1.0, np.zeros(6), np.zeros(6))
    base = np.linalg.inv(H + np.linalg.inv(L @ np.linalg.inv(P) @ L.T))
    np.testing.assert_allclose(L @ split.share, np.eye(3), atol=1e-9)
    whole = split.share @ base @ split.share.T + split.rest
    np.testing.assert_allclose(whole, np.linalg.inv(L.T @ H @ L + P), rtol=1e-9, atol=1e-12)


def test_the_record_has_the_proof_and_the_prior_of_bodies_and_of_nothing_else():
    problem = recorded(0)
    fit = found(problem, prior="log-det", weight=2.0)
    assert fit.standard is not None
    record = certificate_record(fit.standard)
    assert record is not None and record["prior"] == {"kind": "log-det", "weight": 2.0, "how": "given"}
    assert record["price"] >= 0.0 and record["smallest_eigenvalue"] > 0.0 and record["gap"] < 1e-6
    assert certificate_record(WeightedLeastSquares().solve(problem).standard) is None
