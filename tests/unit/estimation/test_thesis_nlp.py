"""Bounds of the nonlinear program of the thesis: one for all links, one for each, or around the description."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.estimators import ThesisNLP
from armid.estimation.estimators.thesis_nlp import FACTOR, REACH
from armid.estimation.problem import EstimationProblem, standard_of
from armid.information.accumulate import accumulate_information
from armid.maths.inertia import vector_to_com_inertia
from armid.model.base_parameters import find_base_parameters
from armid.thesis.algorithm_corrections import HOLDING
from armid.thesis.published import published
from labs import small_model_with_rotors as model
from labs import small_truth_with_rotors as truth
from problems import lively_motion, one_run, raw

pytest.importorskip("casadi")

ROOM = 1e-6
"""Tolerance of IPOPT for bounds."""


def problem_of() -> EstimationProblem:
    base, rate = find_base_parameters(model()), 50.0
    motion = lively_motion(np.random.default_rng(1), model().n, rate, 8.0)
    torque = model().torque(motion, truth()) + 0.2 * np.random.default_rng(2).standard_normal(motion.q.shape)
    observations = raw(one_run(motion, torque, rate))
    return EstimationProblem(
        accumulate_information(model(), base, observations), standard_of(model(), base), model(), base
    )


def bodies_of(estimator: ThesisNLP, problem: EstimationProblem) -> list[tuple[float, Array, Array]]:
    fit = estimator.solve(problem)
    assert fit.standard is not None
    return [vector_to_com_inertia(fit.standard.values[own]) for own in model().inertial_columns.reshape(-1, 10)]


def test_bounds_of_each_link_are_kept():
    links = model().n
    mass = [[0.5 + k, 1.0 + k] for k in range(links)]
    com = [0.1 + 0.1 * k for k in range(links)]
    estimator = ThesisNLP(constraints=("3.52d",), mass=mass, com=com, product=[0.5] * links, starts=1)
    for (m, centre, _), (low, high), reach in zip(bodies_of(estimator, problem_of()), mass, com, strict=True):
        assert low - ROOM <= m <= high + ROOM
        assert (np.abs(centre) <= reach + ROOM).all()


def test_bounds_around_the_description():
    problem = problem_of()
    assert problem.standard is not None and problem.standard.nominal is not None
    around = {name: "description" for name in ("mass", "com", "moment", "product")}
    estimator = ThesisNLP(constraints=("3.52d",), starts=1, **around)  # pyright: ignore[reportArgumentType]
    nominal = problem.standard.nominal[problem.standard.inertial]
    for (m, centre, tensor), own in zip(bodies_of(estimator, problem), nominal, strict=True):
        mass, com, described = vector_to_com_inertia(own)
        assert mass / FACTOR - ROOM <= m <= FACTOR * mass + ROOM
        assert (np.abs(centre - com) <= REACH + ROOM).all()
        assert (np.diag(tensor) <= FACTOR * np.maximum(np.diag(described), 1e-4) + ROOM).all()
    nameless = replace(problem, standard=replace(problem.standard, nominal=None))
    with pytest.raises(EstimationError, match="description"):
        estimator.solve(nameless)


@pytest.mark.parametrize(
    "options", [{"mass": [[0.1, 1.0], [2.0, 1.0]]}, {"com": [0.1, -0.1]}, {"friction": "description"}]
)
def test_bounds_are_checked(options: dict[str, object]):
    with pytest.raises(EstimationError):
        ThesisNLP(**options)  # pyright: ignore[reportArgumentType]


def test_as_many_bounds_as_links():
    with pytest.raises(EstimationError, match="2 entries"):
        ThesisNLP(mass=[[0.1, 1.0], [0.1, 2.0]], starts=1).solve(problem_of())


def test_the_bounds_of_the_study_hold_table_4_2():
    """The printed solution lies within the bounds that the study calls as printed, but not within the defaults."""
    table = published().physical
    used = replace(ThesisNLP(), **HOLDING)
    (light, heavy), (small, large) = (np.asarray(x, dtype=np.float64) for x in (used.mass, used.moment))
    assert (table[:, 0] >= light).all() and (table[:, 0] <= heavy).all()
    assert np.abs(table[:, 1:4]).max() <= used.com and np.abs(table[:, 1:4]).max() > ThesisNLP().com  # pyright: ignore[reportOperatorIssue]
    assert (table[:, [4, 7, 9]] >= small).all() and (table[:, [4, 7, 9]] <= large).all()
    assert np.abs(table[:, [5, 6, 8]]).max() <= used.product  # pyright: ignore[reportOperatorIssue]
