"""Stick or slide: answers that can be seen by hand, and the conditions that every answer has to meet."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armid.maths import stiction
from armid.maths.stiction import solve_stiction

TOLERANCE = 1e-10
"""Relative: one solution of a few equations with a condition number of at most a thousand."""


def settled(mobility, free, lower, upper):
    f, v = solve_stiction(*(np.array(x, dtype=float)[None] for x in (mobility, free, lower, upper)))
    return f[0], v[0]


@pytest.mark.parametrize(
    ("free", "torque", "velocity"),
    [(1.0, 3.0, 0.4), (-1.0, -2.0, -0.6), (0.5, 2.5, 0.0), (-0.3, -1.5, 0.0), (0.0, 0.0, 0.0), (0.6, 3.0, 0.0)],
)
def test_one_joint(free: float, torque: float, velocity: float):
    f, v = settled([[0.2]], [free], [2.0], [3.0])
    np.testing.assert_allclose((f[0], v[0]), (torque, velocity), atol=1e-15)


def test_without_friction_nothing_changes():
    f, v = settled(np.eye(3), [1.0, -2.0, 0.0], np.zeros(3), np.zeros(3))
    assert not f.any()
    np.testing.assert_array_equal(v, [1.0, -2.0, 0.0])


def check(mobility, free, lower, upper):
    f, v = solve_stiction(mobility, free, lower, upper)
    scale = np.abs(free).max() + 1.0
    np.testing.assert_allclose(v, free - np.einsum("wij,wj->wi", mobility, f), atol=1e-7 * scale)
    assert (f <= upper + TOLERANCE).all() and (f >= -lower - TOLERANCE).all()
    moves = np.abs(v) > 1e-7 * scale
    np.testing.assert_allclose(f[moves & (v > 0)], upper[moves & (v > 0)], rtol=1e-7, atol=TOLERANCE)
    np.testing.assert_allclose(f[moves & (v < 0)], -lower[moves & (v < 0)], rtol=1e-7, atol=TOLERANCE)


def problem(seed: int):
    rng = np.random.default_rng(seed)
    w, n = int(rng.integers(1, 4)), int(rng.integers(1, 8))
    root = rng.normal(size=(w, n, n))
    mobility = root @ np.swapaxes(root, 1, 2) + 0.05 * np.eye(n)
    free = rng.normal(size=(w, n)) * rng.choice([0.01, 1.0, 10.0])
    lower, upper = rng.uniform(0.0, 1.0, (2, w, n)) * rng.integers(0, 2, (2, w, n))
    return mobility, free, lower, upper


@given(st.integers(0, 10_000))
def test_a_joint_slides_at_a_bound_or_sticks_between(seed: int):
    check(*problem(seed))


def test_sweeping_finds_the_same(monkeypatch: pytest.MonkeyPatch):
    """Sweeps have to do where the active set cycles; they are slow where joints are coupled as much as here."""
    rng = np.random.default_rng(3)
    root = 0.3 * rng.normal(size=(4, 5, 5))
    mobility = root @ np.swapaxes(root, 1, 2) + np.eye(5)
    free, bound = rng.normal(size=(4, 5)), rng.uniform(0.0, 1.0, (4, 5))
    expected = solve_stiction(mobility, free, bound, bound)
    monkeypatch.setattr(stiction, "ROUNDS", 1)
    for found, right in zip(solve_stiction(mobility, free, bound, bound), expected, strict=True):
        np.testing.assert_allclose(found, right, atol=1e-9)
