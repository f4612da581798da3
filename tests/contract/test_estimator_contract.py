"""Duties of every estimator, from information alone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from armid.errors import EstimationError
from armid.estimation.catalogue import ESTIMATORS
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem, build_problem
from armid.information.information import Information, stack
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Offset, RigidBody, Viscous
from problems import lively_motion, one_run, raw
from trees import random_inertial, robot_of, structured_tree

RATE, SECONDS, NOISE = 50.0, 20.0, 0.2

EXACT = 1e-8
"""Relative error that noise-free data leave: rounding of 1e-16 times a condition number of a few thousand, squared by
weights that follow from residuals of pure rounding, with room."""

ROUNDING = 1e-12
"""Of the largest entry of a covariance that is made by a few products of matrices."""

SIGMAS = 5.0
"""Standard deviations that an estimate may be off by; of some thirty parameters one in a million goes beyond."""

METHOD = pytest.mark.parametrize("name", ESTIMATORS)

ANY_BODY = [name for name, kind in ESTIMATORS.items() if not getattr(kind, "excludes_bodies", False)]
"""Methods that can come to any body that exists; of others no truth can be asked."""

TRUTHFUL = pytest.mark.parametrize("name", ANY_BODY)


@pytest.fixture(scope="module")
def model() -> DynamicsModel:
    tree = structured_tree(np.random.default_rng(2), 3, prismatic=0.0, branching=0.0)
    return DynamicsModel(robot_of(tree), (RigidBody(), Viscous(), Coulomb(width=0.02), Offset()))


@pytest.fixture(scope="module")
def base(model: DynamicsModel) -> BaseParameters:
    return find_base_parameters(model)


@pytest.fixture(scope="module")
def truth(model: DynamicsModel) -> np.ndarray:
    """Standard parameters of bodies that can exist, and positive friction."""
    theta = np.random.default_rng(3).uniform(0.2, 1.0, len(model.parameters))
    theta[model.inertial_columns] = random_inertial(np.random.default_rng(4), model.n).ravel()
    return theta


def problem_of(
    model: DynamicsModel, base: BaseParameters, truth: np.ndarray, noise: float, moving: bool = True, times: int = 1
) -> EstimationProblem:
    """A recording, or the same one several times."""
    motion = lively_motion(np.random.default_rng(5), model.n, RATE, SECONDS)
    if not moving:
        motion = Motion(motion.time, motion.q, np.zeros_like(motion.q), np.zeros_like(motion.q))
    torque = model.torque(motion, truth) + noise * np.random.default_rng(6).normal(size=motion.q.shape)
    return build_problem(model, raw(*[one_run(motion, torque, RATE)] * times), base=base)


def bytes_of(information: Information) -> list[bytes]:
    return [joint.R.tobytes() for joint in information.joints] + [information.rows.tobytes()]


@METHOD
def test_is_a_frozen_value(name: str):
    kind = ESTIMATORS[name]
    assert kind.name == name
    assert dataclasses.is_dataclass(kind) and kind.__dataclass_params__.frozen and hasattr(kind, "__slots__")
    assert kind.__doc__ and kind.solve.__doc__
    assert eval(repr(kind()), {kind.__name__: kind}) == kind()  # what a repr is for


@TRUTHFUL
def test_noise_free_data_give_the_truth_back(name: str, model, base, truth):
    fit = ESTIMATORS[name]().solve(problem_of(model, base, truth, 0.0))
    exact = base.values_of(truth)
    np.testing.assert_allclose(fit.values, exact, rtol=0, atol=EXACT * np.abs(exact).max())


@TRUTHFUL
def test_a_fit_is_whole(name: str, model, base, truth):
    problem = problem_of(model, base, truth, NOISE)
    fit = ESTIMATORS[name]().solve(problem)
    assert isinstance(fit, Fit) and fit.names == base.names
    for field in dataclasses.fields(Fit):
        value = getattr(fit, field.name)
        assert not isinstance(value, np.ndarray | float) or np.isfinite(value).all(), field.name
    np.testing.assert_array_equal(fit.rows, problem.information.rows.sum(axis=0))
    np.testing.assert_allclose(fit.residual_rms, NOISE, rtol=0.15)  # a thousand rows, a dozen parameters a joint
    assert (fit.deviation > 0.0).all() and np.all(fit.freedom > 0.0)
    rounding = ROUNDING * np.abs(fit.covariance).max()
    np.testing.assert_allclose(fit.covariance, fit.covariance.T, rtol=0, atol=rounding)
    assert np.linalg.eigvalsh(fit.covariance).min() > -rounding
    assert (np.abs(fit.values - base.values_of(truth)) < SIGMAS * fit.deviation).all()


@METHOD
def test_deviations_are_those_of_white_noise(name: str, model, base, truth):
    """All joints have the same noise here, so the best deviations are σ times those of the rows themselves."""
    problem = problem_of(model, base, truth, NOISE)
    rows, _ = stack(problem.information)
    best = NOISE * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    np.testing.assert_allclose(ESTIMATORS[name]().solve(problem).deviation, best, rtol=0.1)


@METHOD
def test_same_in_same_out_and_nothing_changed(name: str, model, base, truth):
    problem = problem_of(model, base, truth, NOISE)
    before = bytes_of(problem.information)
    first, second = (ESTIMATORS[name]().solve(problem) for _ in range(2))
    assert first.values.tobytes() == second.values.tobytes()
    assert first.covariance.tobytes() == second.covariance.tobytes()
    assert bytes_of(problem.information) == before


@METHOD
def test_more_of_the_same_is_surer(name: str, model, base, truth):
    one, two = (ESTIMATORS[name]().solve(problem_of(model, base, truth, NOISE, times=k)) for k in (2, 4))
    # Twice the rows have relatively more degrees of freedom, which moves weights and deviations a little; a method
    # that tries itself on parts of the data tries others, and one recording of this length has too few of them.
    assert (np.abs(two.values - one.values) < 0.1 * one.deviation).all()
    np.testing.assert_allclose(two.deviation, one.deviation / np.sqrt(2.0), rtol=0.02)


@METHOD
def test_data_that_do_not_determine_it_are_refused_or_it_is_said(name: str, model, base, truth):
    """Nothing moves, so no friction shows; a method with a prior has an answer and says whose it is."""
    problem = problem_of(model, base, truth, NOISE, moving=False)
    try:
        fit = ESTIMATORS[name]().solve(problem)
    except EstimationError as error:
        assert error.remedy and any(parameter in error.problem for parameter in base.names)
    else:
        (said,) = [finding for finding in fit.findings if finding.code == "prior-dominated"]
        assert "FV_1" in said.evidence and said.remedy
