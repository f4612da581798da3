"""Newton's method with barriers, and the conic solver, against problems whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from armid.checked_array import Array
from armid.errors import EstimationError, UnsolvedError
from armid.maths.barrier_function import LogDet, Smooth
from armid.maths.barrier_method import minimise
from armid.maths.conic_solver import Cone, solve_cones, symmetric, upper_triangle

EXACT = 1e-6
"""Error that a gap of 1e-9 leaves where the objective is as curved as here."""


def positive(variables: int) -> Cone:
    return Cone("nonnegative", np.eye(variables), np.zeros(variables))


def full(entries: int, variables: int) -> Array:
    """Matrices (m, m, variables) of the upper triangle's entries, the first of the variables."""
    return np.moveaxis(symmetric(np.eye(variables)[:, :entries]), 0, 2)


@pytest.mark.parametrize("weight", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("aim", [-3.0, 5.0])
def test_a_single_logarithm(weight: float, aim: float):
    """½ (x - a)² - w log x is least at the positive root of x² - a x - w."""
    term = LogDet(np.ones((1, 1, 1)), np.zeros((1, 1)), np.zeros(1), 0.0, weight)
    problem = Smooth(np.ones((1, 1)), np.array([aim]), (term,), (), np.zeros(1))
    found = minimise(problem, np.array([1.0]))
    assert found.x[0] == pytest.approx(0.5 * (aim + np.sqrt(aim**2 + 4.0 * weight)), rel=EXACT)
    assert found.objective == problem.objective(found.x) and found.gap <= 2e-9


def test_a_log_det_is_least_at_the_inverse_of_its_cost():
    C = np.array([[2.0, 0.3, 0.1], [0.3, 1.0, -0.2], [0.1, -0.2, 0.5]])
    i, j = upper_triangle(3)
    cost = np.where(i == j, 1.0, 2.0) * C[i, j]
    term = LogDet(full(6, 6), np.zeros((3, 3)), cost, 0.0, 3.0)
    found = minimise(Smooth(np.zeros((0, 6)), np.zeros(0), (term,), (), np.zeros(6)), (i == j).astype(float))
    np.testing.assert_allclose(symmetric(found.x), np.linalg.inv(C), rtol=0, atol=EXACT)


def test_bounds_that_hold_back_are_met_and_the_gap_is_true():
    rng = np.random.default_rng(0)
    A, y = rng.normal(size=(8, 4)), rng.normal(size=8)
    from scipy.optimize import nnls

    best, length = nnls(A, y)
    found = minimise(Smooth(A, y, (), (positive(4),), np.zeros(4)), np.ones(4))
    assert (best == 0.0).any() and (found.x > 0.0).all()
    np.testing.assert_allclose(found.x, best, atol=1e-6)
    least = 0.5 * length**2
    assert 0.0 <= found.objective - least <= found.gap * max(1.0, found.objective)


def test_both_methods_find_the_nearest_semidefinite_matrix():
    """It has the eigenvectors of the matrix and its positive eigenvalues."""
    target = np.array([[1.0, 2.0], [2.0, -1.0]])
    values, vectors = np.linalg.eigh(target)
    nearest = (vectors * np.maximum(values, 0.0)) @ vectors.T
    i, j = upper_triangle(2)
    scale = np.where(i == j, 1.0, np.sqrt(2.0))
    cone = Cone("semidefinite", np.eye(3), np.zeros(3))
    smooth = Smooth(np.diag(scale), scale * target[i, j], (), (cone,), np.zeros(3))
    np.testing.assert_allclose(symmetric(minimise(smooth, np.array([1.0, 0.0, 1.0])).x), nearest, atol=1e-6)
    matrix = np.zeros((4, 4))
    matrix[0, 3], matrix[1:, :3] = 1.0, np.diag(scale)
    cones = [
        Cone("semidefinite", np.eye(3, 4), np.zeros(3)),
        Cone("norm", matrix, np.concatenate([[0.0], -scale * target[i, j]])),
    ]
    square = np.array([0.0, 0.0, 0.0, 1.0])  # half the square of the distance
    found = solve_cones(np.zeros(4), cones, square)
    np.testing.assert_allclose(symmetric(found.x[:3]), nearest, atol=1e-6)
    assert found.objective == pytest.approx(0.5 * min(values) ** 2, rel=1e-6)


def test_a_start_outside_is_refused():
    with pytest.raises(EstimationError, match="start"):
        minimise(Smooth(np.eye(2), np.ones(2), (), (positive(2),), np.zeros(2)), np.array([1.0, -1.0]))


class Liar:
    """A solver that says of anything that it is solved, and what dual objective it pleases."""

    def __init__(self, x: list[float], z: list[float], dual: float) -> None:
        self.status, self.x, self.z, self.obj_val_dual, self.obj_val = "Solved", x, z, dual, dual

    def __call__(self, *_: object) -> Liar:
        return self

    def solve(self) -> Liar:
        return self


@pytest.mark.parametrize(
    ("x", "z", "dual", "honest"),
    [
        ([1.0, 2.0], [1.0, 1.0], 7.0, True),  # the least of x + y over x ≥ 1, y ≥ 2, whatever is said of the dual
        ([1.0, 2.0], [1.0, 0.0], 3.0, False),  # right, but the multipliers prove no more than 1
        ([0.0, 2.0], [1.0, 1.0], 2.0, False),  # outside the cone, with the objective that goes with it
        ([5.0, 5.0], [1.0, 1.0], 10.0, False),  # inside, but not the least: the multipliers prove 3
        ([5.0, 5.0], [6.0, 2.0], 10.0, True),  # multipliers that would prove it leave a slope, which tells
        ([5.0, 5.0], [11.0, -0.5], 10.0, False),  # multipliers outside the dual cone
        ([np.nan, 2.0], [1.0, 1.0], 3.0, False),
        ([1e200, 2.0], [1.0, 1.0], 1e200, False),
    ],
)
def test_a_solver_that_lies_is_found_out(
    monkeypatch: pytest.MonkeyPatch, x: list[float], z: list[float], dual: float, honest: bool
):
    """Whatever status and gap are told, an answer that is wrong or unproved is refused or carries its doubt."""
    import clarabel

    monkeypatch.setattr(clarabel, "DefaultSolver", Liar(x, z, dual))
    bounds = [Cone("nonnegative", np.eye(2), np.array([-1.0, -2.0]))]
    if not honest:
        with pytest.raises(UnsolvedError, match="Solved; gap"):
            solve_cones(np.ones(2), bounds)
        return
    found = solve_cones(np.ones(2), bounds)
    least = 3.0
    assert found.objective - found.doubt(np.abs(found.x)) <= least + EXACT
    assert found.doubt(np.abs(found.x)) <= EXACT or z != [1.0, 1.0]


def test_a_matrix_of_multipliers_is_judged_by_its_eigenvalues(monkeypatch: pytest.MonkeyPatch):
    """The least trace of a matrix with a one off its diagonal is 2; indefinite multipliers would prove 4."""
    import clarabel

    # x are the two diagonal entries; Z = [[1, z], [z, 1]] leaves no slope and proves -2 z for any z
    cone = Cone("semidefinite", np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]]), np.array([0.0, 1.0, 0.0]))
    root = float(np.sqrt(2.0))
    honest = solve_cones(np.ones(2), [cone])
    assert honest.objective == pytest.approx(2.0, abs=EXACT)
    monkeypatch.setattr(clarabel, "DefaultSolver", Liar([2.0, 2.0], [1.0, -2.0 * root, 1.0], 4.0))
    with pytest.raises(UnsolvedError, match="Solved; gap"):
        solve_cones(np.ones(2), [cone])


def test_a_minimum_that_is_not_there_is_not_invented():
    """A linear cost that falls for ever."""
    with pytest.raises(EstimationError):
        solve_cones(np.array([-1.0]), [positive(1)])
