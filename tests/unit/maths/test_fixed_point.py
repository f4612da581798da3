"""Fixed points: the point, the number of iterations against the plain iteration, and the limit of rounding."""

from __future__ import annotations

import numpy as np
import pytest

from armid.maths.fixed_point import fixed_point

CLOSE = 1e-9
"""Tolerance of the steps; the point is then within this over one minus the rate."""


def within(size: float):
    """Tolerance of the steps that does not depend on the point."""
    return lambda x: np.full_like(x, size)


def linear(rates: list[float], seed: int = 0):
    """Function whose steps shrink by the given rates along random directions, with its fixed point."""
    rng = np.random.default_rng(seed)
    basis = np.linalg.qr(rng.normal(size=(len(rates), len(rates))))[0]
    matrix, goal = basis @ np.diag(rates) @ basis.T, rng.normal(size=len(rates))
    return (lambda x: goal + matrix @ (x - goal)), goal


@pytest.mark.parametrize("rates", [[0.9], [0.98, 0.5], [0.95, 0.9, 0.8, 0.6, 0.3, 0.1, 0.0]])
def test_slow_iterations_end_early(rates: list[float]):
    g, goal = linear(rates)
    plain = np.log(CLOSE) / np.log(max(rates))
    found = fixed_point(g, np.zeros(len(rates)), within(CLOSE), 1000)
    assert found.settled and found.step <= CLOSE and found.iterations < plain / 5
    assert np.abs(found.x - goal).max() <= CLOSE / (1 - max(rates))


def test_nonlinear_functions_are_solved():
    found = fixed_point(np.cos, np.array([0.0, 3.0]), within(1e-12), 100)
    assert found.settled and found.iterations < 30
    assert found.x == pytest.approx(np.full(2, 0.7390851332151607), abs=1e-11)


def test_the_limit_of_rounding_is_recognised():
    """Steps that stay near 1e-8 are accepted up to 1e-6, and the last evaluation is at the point that is returned."""
    rng = np.random.default_rng(3)
    g, goal = linear([0.7, 0.4])
    points = []

    def rounded(x):
        points.append(x)
        return g(x) + 1e-8 * rng.uniform(-1, 1, 2)

    found = fixed_point(rounded, np.zeros(2), within(1e-12), 1000, limited=1e-6)
    assert found.settled and 1e-12 < found.step < 1e-6 and found.iterations < 60
    assert np.array_equal(points[-1], found.x) and np.abs(found.x - goal).max() < 1e-6
    assert not fixed_point(rounded, np.zeros(2), within(1e-12), 50).settled


def test_what_does_not_converge_is_said():
    found = fixed_point(lambda x: 1.0 - 4.0 * x**3, np.array([0.2]), within(1e-15), 4)
    assert not found.settled and found.iterations == 4
