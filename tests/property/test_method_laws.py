"""Laws of the robust, the reduced and the regularised estimate on random arms and motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armid.checked_array import Array
from armid.estimation.crossvalidation import folds, held_out_squares, split, training_information
from armid.estimation.estimators import EssentialParameters, Ridge, RobustLeastSquares, WeightedLeastSquares
from armid.estimation.problem import EstimationProblem, standard_of
from armid.information.accumulate import accumulate_information
from armid.information.information import select
from armid.measurement.observations import Observations
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, Offset, RigidBody, RotorInertia, Viscous
from informed import Arm, recorded
from problems import one_run, raw
from trees import random_tree, robot_of, structured_tree

RATE = 50.0

SEEDS = st.integers(0, 2**31)

EXACT = 1e-8
"""Relative error that noise-free data may leave: rounding times condition numbers of thousands, and what the robust
iteration calls the end."""

Method = RobustLeastSquares | EssentialParameters | Ridge

METHODS = pytest.mark.parametrize(
    "method",
    [
        RobustLeastSquares("huber"),
        RobustLeastSquares("tukey"),
        EssentialParameters(),
        EssentialParameters("bic"),
        Ridge(),
        Ridge("zero"),
    ],
    ids=["huber", "tukey", "pham-gautier", "bic", "nominal", "zero"],
)


def random_problem(seed: int, noise: float) -> tuple[Arm, EstimationProblem]:
    """Two to five joints, any or special geometry, all common terms."""
    rng = np.random.default_rng(seed)
    make = random_tree if rng.random() < 0.5 else structured_tree
    tree = make(rng, int(rng.integers(2, 6)), prismatic=0.2, branching=0.2)
    model = DynamicsModel(robot_of(tree), (RigidBody(), Viscous(), Coulomb(width=0.05), Offset(), RotorInertia()))
    base = find_base_parameters(model)
    arm = model, base, rng.normal(size=base.count)
    motion, torque = recorded(arm, int(rng.integers(2**31)), seconds=10.0, noise=noise, rate=RATE)
    return arm, problem_of(arm, raw(one_run(motion, torque, RATE)))


def problem_of(arm: Arm, observations: Observations) -> EstimationProblem:
    model, base, _ = arm
    return EstimationProblem(
        accumulate_information(model, base, observations), standard_of(model, base), model, base, observations
    )


def with_torque(problem: EstimationProblem, arm: Arm, change: Array) -> EstimationProblem:
    """The problem had the torque been larger by a change (N, n)."""
    assert problem.observations is not None
    (run,) = problem.observations.runs
    return problem_of(arm, raw(replace(run, torque=run.torque + change)))


@METHODS
@settings(max_examples=8)
@given(seed=SEEDS)
def test_noise_free_data_give_the_truth_back(method: Method, seed: int):
    (_, _, truth), problem = random_problem(seed, noise=0.0)
    fit = method.solve(problem)
    assert np.linalg.norm(fit.values - truth) <= EXACT * np.linalg.norm(truth)


@METHODS
@settings(max_examples=8)
@given(seed=SEEDS)
def test_nothing_fits_the_training_data_better_than_least_squares(method: Method, seed: int):
    """Each gives up some of the weighted residual for something else."""
    _, problem = random_problem(seed, noise=0.2)
    fit, plain = method.solve(problem), WeightedLeastSquares().solve(problem)
    cost = [float(np.sum((plain.weights * each.residual_rms) ** 2 * each.rows)) for each in (plain, fit)]
    assert cost[1] >= cost[0] * (1.0 - 1e-9)


@settings(max_examples=10)
@given(seed=SEEDS, far=st.floats(3.0, 6.0))
def test_how_far_off_a_row_is_does_not_matter(seed: int, far: float):
    """A row without a say may be anywhere, and the estimate does not move."""
    arm, problem = random_problem(seed, noise=0.2)
    rng = np.random.default_rng(seed)
    row, joint = int(rng.integers(500)), int(rng.integers(arm[0].n))
    estimates = []
    for size in (1.0, 10.0):
        change = np.zeros((500, arm[0].n))
        change[row, joint] = size * 10.0**far
        estimates.append(RobustLeastSquares().solve(with_torque(problem, arm, change)))
    one, other = estimates
    assert (np.abs(one.values - other.values) <= 0.02 * one.deviation).all()


@settings(max_examples=10)
@given(seed=SEEDS)
def test_what_huber_answers_to_an_outlier_is_bounded(seed: int):
    arm, problem = random_problem(seed, noise=0.2)
    plain = RobustLeastSquares("huber").solve(problem)
    change = np.zeros((500, arm[0].n))
    change[250] = 1e6
    touched = RobustLeastSquares("huber").solve(with_torque(problem, arm, change))
    assert (np.abs(touched.values - plain.values) <= 3.0 * plain.deviation).all()


@settings(max_examples=10)
@given(seed=SEEDS, ratio=st.floats(1.5, 100.0))
def test_a_laxer_ratio_drops_a_part_of_what_a_stricter_one_drops(seed: int, ratio: float):
    _, problem = random_problem(seed, noise=0.2)
    strict, lax = (EssentialParameters(ratio=r, price=np.inf).solve(problem) for r in (ratio, 2.0 * ratio))
    assert set(lax.dropped) <= set(strict.dropped)
    left = np.array([name not in strict.dropped for name in strict.names])
    if left.sum() > 1:
        again = EssentialParameters(ratio=ratio, price=0.0).solve(problem)
        assert set(again.dropped) <= set(strict.dropped)


@settings(max_examples=10)
@given(seed=SEEDS, count=st.integers(2, 12))
def test_folds_make_the_whole(seed: int, count: int):
    (_, _, truth), problem = random_problem(seed, noise=0.2)
    information = problem.information
    fold = folds(information, count)
    parts = split(information, fold)
    assert len(parts) == fold.max() + 1 <= count
    squares = np.sum([held_out_squares(part.held_out, truth) for part in parts], axis=0)
    np.testing.assert_allclose(squares, held_out_squares(information, truth), rtol=1e-9)
    for k, part in enumerate(parts):
        trains = (fold != k) & ~training_information(information, fold == k)
        rest = held_out_squares(select(information, trains), truth)
        np.testing.assert_allclose(held_out_squares(part.training, truth), rest, rtol=1e-9)
