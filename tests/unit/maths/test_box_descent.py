"""Minima in a box, where they are known or SciPy finds them."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize

from armid.checked_array import Array
from armid.maths.box_descent import descend_in_box

CLOSE = 1e-6
"""Distance from a minimum at which the values differ by rounding alone."""


def test_a_quadratic_with_bounds_is_minimised_where_its_multipliers_say():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(5, 5))
    H, c = root @ root.T + np.eye(5), 3.0 * rng.normal(size=5)
    low, high = -np.full(5, 0.3), np.full(5, 0.3)
    starts = rng.uniform(-1.0, 1.0, (8, 5))
    x, value = descend_in_box(
        lambda q: (0.5 * np.einsum("ki,ij,kj->k", q, H, q) + q @ c, q @ H + c), starts, low, high
    )
    slope = x @ H + c
    inside = (x > low) & (x < high)
    assert inside.any() and (~inside).any()
    assert np.abs(slope[inside]).max() < CLOSE
    assert (slope[x <= low] >= 0.0).all() and (slope[x >= high] <= 0.0).all()
    assert np.ptp(value) < CLOSE**2 + 1e-14


def valley(q: Array) -> tuple[Array, Array]:
    """Rosenbrock's function of three variables."""
    rise, gap = q[:, 1:] - q[:, :-1] ** 2, 1.0 - q[:, :-1]
    gradient = np.zeros_like(q)
    gradient[:, :-1] = -400.0 * q[:, :-1] * rise - 2.0 * gap
    gradient[:, 1:] += 200.0 * rise
    return (100.0 * rise**2 + gap**2).sum(axis=1), gradient


@pytest.mark.parametrize("top", [2.0, 0.5])
def test_the_minimum_in_a_curved_valley_is_that_of_scipy(top: float):
    low, high = np.full(3, -2.0), np.full(3, top)
    starts = np.random.default_rng(1).uniform(low, high, (6, 3))
    found = descend_in_box(valley, starts, low, high)[1].min()
    peers = [
        scipy.optimize.minimize(
            lambda x: float(valley(x[None])[0][0]), start, bounds=np.column_stack([low, high]), method="L-BFGS-B"
        ).fun
        for start in starts
    ]
    assert found <= min(peers) + CLOSE
    assert found == pytest.approx(0.0 if top > 1.0 else min(peers), abs=CLOSE)


def test_a_flat_function_and_a_start_outside():
    x, value = descend_in_box(
        lambda q: (np.zeros(len(q)), np.zeros_like(q)), np.full((2, 2), 5.0), -np.ones(2), np.ones(2)
    )
    assert (x == 1.0).all() and (value == 0.0).all()
