"""Newton's step with log-det terms and barriers against dense formulas, and where it ends."""

from __future__ import annotations

import numpy as np
import pytest

from armid.checked_array import Array
from armid.maths import barrier_function
from armid.maths.barrier_function import Barriers, LogDet, Smooth
from armid.maths.barrier_method import minimise
from armid.maths.conic_solver import Cone, upper_triangle

ROUNDING = 1e-9
"""Of a step, beside that of formulas written out: both solve equations of condition 1e4 or so."""

NEXT_TO_NOTHING = 1e-6
"""Length of a step from a minimum, over the size of the variables: what a squared decrement of 1e-13 amounts to."""

VARIABLES = 7


def symmetric_matrices(rng: np.random.Generator, order: int, moved: list[int]) -> Array:
    """Symmetric matrices (order, order, variables) that some variables move."""
    result = np.zeros((order, order, VARIABLES))
    some = rng.normal(size=(order, order, len(moved)))
    result[:, :, moved] = some + some.swapaxes(0, 1)
    return result


def mixed_problem(seed: int) -> Smooth:
    """Terms that share variables, of two orders and each of another number of variables, and both kinds of cones."""
    rng = np.random.default_rng(seed)
    terms = tuple(
        LogDet(symmetric_matrices(rng, order, moved), 9.0 * np.eye(order), rng.normal(size=VARIABLES), 0.0, weight)
        for order, moved, weight in ((3, [0, 1, 2], 2.0), (3, [2, 3], 0.7), (1, [4], 1.3), (2, [1, 5, 6], 0.4))
    )
    i, j = upper_triangle(3)
    matrix = symmetric_matrices(rng, 3, [0, 3, 4, 6])[i, j]
    cones = (
        Cone("semidefinite", matrix, np.where(i == j, 9.0, 0.0)),
        Cone("nonnegative", rng.normal(size=(2, VARIABLES)), np.full(2, 5.0)),
    )
    return Smooth(rng.normal(size=(5, VARIABLES)), rng.normal(size=5), terms, cones, 0.1 * rng.normal(size=VARIABLES))


def derivatives(problem: Smooth, x: Array, mu: float) -> tuple[Array, Array]:
    """Gradient and second derivatives, term by term and unknown by unknown."""
    gradient = problem.A.T @ (problem.A @ x - problem.y) + problem.cost
    hessian = problem.A.T @ problem.A
    found = [(t.matrix, t.offset, max(t.weight, mu), t.cost) for t in problem.terms]
    for cone in problem.cones:
        if cone.kind == "nonnegative":
            found += [
                (row[None, None], offset[None, None], mu, 0.0)
                for row, offset in zip(cone.matrix, cone.offset, strict=True)
            ]
            continue
        i, j = upper_triangle(3)
        full, offset = np.zeros((3, 3, VARIABLES)), np.zeros((3, 3))
        full[i, j] = full[j, i] = cone.matrix
        offset[i, j] = offset[j, i] = cone.offset
        found.append((full, offset, mu, 0.0))
    for matrix, offset, weight, cost in found:
        inverse = np.linalg.inv(matrix @ x + offset)
        each = [inverse @ matrix[:, :, k] for k in range(VARIABLES)]
        gradient = gradient + weight * (cost - np.array([np.trace(part) for part in each]))
        hessian = hessian + weight * np.array([[np.trace(a @ b) for b in each] for a in each])
    return gradient, hessian


@pytest.mark.parametrize("lost", [barrier_function.LOST, -1.0])
@pytest.mark.parametrize("seed", range(3))
def test_a_step_is_newtons(monkeypatch: pytest.MonkeyPatch, seed: int, lost: float):
    """By the product and, where that is not trusted, by its root."""
    monkeypatch.setattr(barrier_function, "LOST", lost)
    problem, x, mu = mixed_problem(seed), 0.1 * np.random.default_rng(9 + seed).normal(size=VARIABLES), 0.5
    gradient, hessian = derivatives(problem, x, mu)
    newton = -np.linalg.solve(hessian, gradient)
    step, decrement = Barriers(problem).step(x, mu, mu)
    assert decrement == pytest.approx(float(-gradient @ newton), rel=ROUNDING)
    share = float(step @ newton / (newton @ newton))
    assert share > 0.0
    np.testing.assert_allclose(step, share * newton, rtol=0, atol=ROUNDING * np.abs(newton).max())


@pytest.mark.parametrize("seed", range(12))
def test_a_step_from_the_minimum_goes_nowhere(seed: int):
    """However long rounding would have it: the slope along it is none that could be told from zero."""
    problem = mixed_problem(seed)
    found = minimise(problem, np.zeros(VARIABLES))
    barriers, x, mu = Barriers(problem), found.x, 1e-10
    for _ in range(20):
        step, _ = barriers.step(x, mu, mu)
        x = x + step
    step, _ = barriers.step(x, mu, mu)
    assert np.abs(step).max() <= NEXT_TO_NOTHING * np.abs(x).max()
