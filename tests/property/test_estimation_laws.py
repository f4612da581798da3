"""Laws of the estimators on random arms and motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armid.checked_array import Array
from armid.estimation.estimators import OrdinaryLeastSquares, WeightedLeastSquares
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.run_estimator import estimate
from armid.estimation.uncertainty.covariance import estimate_covariance
from armid.estimation.uncertainty.covariance_choice_thresholds import FEWEST_BLOCKS
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, JointFactors, merge, select, total
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, Offset, RigidBody, RotorInertia, Viscous
from informed import Arm, recorded
from problems import one_run, raw
from trees import random_tree, robot_of, structured_tree

OLS, WLS = OrdinaryLeastSquares(), WeightedLeastSquares()
METHOD = pytest.mark.parametrize("method", [OLS, WLS], ids=["ols", "wls"])
Method = OrdinaryLeastSquares | WeightedLeastSquares

EPS = float(np.finfo(float).eps)

EXACT = 1e-9
"""Relative error that noise-free data may leave: rounding times condition numbers that reach thousands."""

SETTLED = 1e-7
"""Relative difference of weighted estimates, whose iteration ends at a change of weights by 1e-9."""

MERGED = 100.0
"""In units of rounding times the condition number, by which the order of merging may change an estimate."""

SEEDS = st.integers(0, 2**31)


def random_arm(rng: np.random.Generator) -> Arm:
    """Two to five joints, any or special geometry, all common terms."""
    make = random_tree if rng.random() < 0.5 else structured_tree
    tree = make(rng, int(rng.integers(2, 6)), prismatic=0.2, branching=0.2)
    model = DynamicsModel(robot_of(tree), (RigidBody(), Viscous(), Coulomb(width=0.05), Offset(), RotorInertia()))
    base = find_base_parameters(model)
    return model, base, rng.normal(size=base.count)


def random_information(seed: int, noise: float) -> tuple[Arm, Information]:
    rng = np.random.default_rng(seed)
    arm = random_arm(rng)
    motion, torque = recorded(arm, int(rng.integers(2**31)), seconds=10.0, noise=noise, rate=50.0)
    return arm, accumulate_information(arm[0], arm[1], raw(one_run(motion, torque, 50.0)))


def weighed(information: Information, factor: Array) -> Information:
    """The information had the rows of each joint been multiplied by its factor."""
    joints = [
        JointFactors(joint.parameters, joint.R * f) for joint, f in zip(information.joints, factor, strict=True)
    ]
    return replace(information, joints=tuple(joints))


def measured_in(information: Information, unit: float) -> Information:
    """The information had the torque been measured in another unit."""
    scale = [np.append(np.ones(len(joint.parameters)), 1.0 / unit) for joint in information.joints]
    joints = [JointFactors(joint.parameters, joint.R * s) for joint, s in zip(information.joints, scale, strict=True)]
    return replace(information, joints=tuple(joints))


def assert_close(a: Fit, b: Fit, tolerance: float) -> None:
    """Estimates that differ by little against the largest of their parameters, each white deviation too."""
    assert np.linalg.norm(a.values - b.values) <= tolerance * np.linalg.norm(b.values)
    np.testing.assert_allclose(a.white_deviation, b.white_deviation, rtol=max(tolerance, SETTLED))


@METHOD
@settings(max_examples=25)
@given(seed=SEEDS)
def test_noise_free_data_give_the_truth_back(method: Method, seed: int):
    (_, _, truth), information = random_information(seed, noise=0.0)
    fit = method.solve(EstimationProblem(information))
    assert np.linalg.norm(fit.values - truth) <= EXACT * np.linalg.norm(truth)


@settings(max_examples=15)
@given(seed=SEEDS, digits=st.integers(8, 12))
def test_weights_settle_on_data_that_were_only_rounded(seed: int, digits: int):
    """Exact torques in so many digits: residuals not far above the rounding of the solution."""
    (_, _, truth), information = random_information(seed, noise=10.0**-digits)
    fit = WLS.solve(EstimationProblem(information))
    assert np.linalg.norm(fit.values - truth) <= 10.0 ** (4 - digits) * np.linalg.norm(truth)


@METHOD
@settings(max_examples=15)
@given(seed=SEEDS)
def test_merging_in_any_order_and_chunking_is_one_estimate(method: Method, seed: int):
    _, information = random_information(seed, noise=0.2)
    expected = method.solve(EstimationProblem(information))
    rng = np.random.default_rng(seed)
    order = rng.permutation(information.blocks)
    cuts = np.sort(rng.choice(np.arange(1, information.blocks), FEWEST_BLOCKS - 2, replace=False))
    chunks = [total(select(information, part)) for part in np.split(order, cuts)]
    expected = estimate_covariance(expected, information)
    shuffled, chunked = (estimate(EstimationProblem(x), method) for x in (select(information, order), merge(chunks)))
    tolerance = MERGED * EPS * expected.condition if method is OLS else SETTLED
    assert_close(shuffled, expected, tolerance)
    assert_close(chunked, expected, tolerance)
    # The scatter between blocks does not know their order, but it knows the blocks.
    np.testing.assert_allclose(np.diag(shuffled.covariance), np.diag(expected.covariance), rtol=SETTLED)
    assert (shuffled.covariance_kind, chunked.covariance_kind) == ("block", "white")


@settings(max_examples=15)
@given(seed=SEEDS)
def test_weighted_estimates_do_not_know_the_scale_of_a_joint(seed: int):
    """Measured with a gain that differs from joint to joint, on both sides, the estimate is the same."""
    (model, _, _), information = random_information(seed, noise=0.2)
    factor = 10.0 ** np.random.default_rng(seed).uniform(-2.0, 2.0, model.n)
    plain, scaled = (
        WLS.solve(EstimationProblem(information)),
        WLS.solve(EstimationProblem(weighed(information, factor))),
    )
    assert_close(scaled, plain, SETTLED)
    np.testing.assert_allclose(scaled.residual_rms, factor * plain.residual_rms, rtol=SETTLED)


@METHOD
@settings(max_examples=15)
@given(seed=SEEDS, unit=st.floats(1e-3, 1e3))
def test_the_unit_of_torque_does_not_matter(method: Method, seed: int, unit: float):
    _, information = random_information(seed, noise=0.2)
    plain, other = (
        method.solve(EstimationProblem(information)),
        method.solve(EstimationProblem(measured_in(information, unit))),
    )
    np.testing.assert_allclose(other.values * unit, plain.values, rtol=0, atol=SETTLED * np.abs(plain.values).max())
    np.testing.assert_allclose(other.relative_deviation, plain.relative_deviation, rtol=1e-4)
    assert (other.poorly_identified == plain.poorly_identified).mean() > 0.9  # but for ties at the mark
    assert other.condition == pytest.approx(plain.condition)


@METHOD
@settings(max_examples=10)
@given(seed=SEEDS)
def test_residuals_are_what_the_estimate_leaves(method: Method, seed: int):
    """Rows, residuals and the degrees of freedom that the parameters spend."""
    (model, base, truth), information = random_information(seed, noise=0.3)
    fit = method.solve(EstimationProblem(information))
    squares = (fit.residual_rms**2 * fit.rows).sum()
    assert squares == pytest.approx(0.09 * (fit.rows.sum() - base.count), rel=0.2)  # 1000 rows and more
    assert fit.rows.tolist() == [500] * model.n
    assert (np.abs(fit.values - truth) < 6 * fit.deviation).all()
