"""Condition numbers and missing directions."""

from __future__ import annotations

import numpy as np
import pytest

from armid.maths.linalg import condition, half_of, null_directions, orthonormal, scaled_condition, unit_columns


def with_singular_values(rng, rows, values):
    U = np.linalg.qr(rng.normal(size=(rows, len(values))))[0]
    V = np.linalg.qr(rng.normal(size=(len(values), len(values))))[0]
    return U @ np.diag(values) @ V.T


def test_condition_is_the_ratio_of_singular_values():
    A = with_singular_values(np.random.default_rng(0), 40, [50.0, 3.0, 1.0, 0.2])
    assert condition(A) == pytest.approx(250.0, rel=1e-12)
    assert condition(np.linalg.qr(A, mode="r")) == pytest.approx(250.0, rel=1e-12)


def test_scaling_columns_does_not_change_the_scaled_condition():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(40, 6))
    units = 10.0 ** rng.uniform(-6, 6, 6)
    assert condition(A * units) > 1e6
    assert scaled_condition(A * units) == pytest.approx(scaled_condition(A), rel=1e-9)


def test_missing_rank_is_an_infinite_condition():
    assert condition(np.zeros((3, 2))) == np.inf
    assert condition(np.diag([1.0, 0.0])) == np.inf
    assert condition(np.ones((2, 3))) == np.inf
    assert condition(np.eye(3)[:2]) == np.inf
    assert scaled_condition(np.array([[1.0, 0.0], [1.0, 0.0]])) == np.inf


def test_unit_columns():
    A = np.array([[3.0, 0.0, 1e-100], [4.0, 0.0, 0.0]])
    scaled, length = unit_columns(A)
    assert scaled.tolist() == [[0.6, 0.0, 1.0], [0.8, 0.0, 0.0]]
    assert length.tolist() == [5.0, 1.0, 1e-100]


def test_full_rank_misses_nothing():
    assert null_directions(np.random.default_rng(2).normal(size=(20, 5))).shape == (0, 5)


@pytest.mark.parametrize("rows", [30, 4, 1])
def test_missing_directions(rows):
    """Column 2 = 2e5 · column 0, column 4 zero, and fewer rows than columns."""
    rng = np.random.default_rng(3)
    A = rng.normal(size=(rows, 5))
    A[:, 2] = 2e5 * A[:, 0]
    A[:, 4] = 0.0
    directions = null_directions(A)
    scaled, _ = unit_columns(A)
    assert len(directions) == 5 - np.linalg.matrix_rank(scaled)
    assert np.abs(scaled @ directions.T).max() < 1e-12
    assert directions @ directions.T == pytest.approx(np.eye(len(directions)), abs=1e-12)
    if rows == 30:
        # Together they span (e0 - e2)/√2 and e4.
        plane = np.zeros((2, 5))
        plane[0, [0, 2]] = np.array([1.0, -1.0]) / np.sqrt(2.0)
        plane[1, 4] = 1.0
        assert np.linalg.norm(plane @ directions.T @ directions - plane) < 1e-12


def test_poor_columns_are_not_missing():
    A = with_singular_values(np.random.default_rng(4), 40, [1.0, 0.5, 1e-6])
    assert len(null_directions(A)) == 0
    assert len(null_directions(A, tolerance=1e-3)) == 1


@pytest.mark.parametrize(("values", "clear"), [([3.0, 1.0, 1e-3], True), ([3.0, 1.0, 1e-9], False)])
def test_columns_that_are_clearly_independent_have_a_triangle(values: list[float], clear: bool):
    A, _ = unit_columns(with_singular_values(np.random.default_rng(1), 9, values))
    found = orthonormal(A)
    assert (found is not None) == clear
    if found is not None:
        Q, R, inverse = found
        np.testing.assert_allclose(Q @ R, A, rtol=0, atol=1e-14)
        np.testing.assert_allclose(R @ inverse, np.eye(3), rtol=0, atol=1e-12)
    assert orthonormal(A[:2]) is None


@pytest.mark.parametrize("least", [1e-2, 1e-7, 1e-11])
def test_half_of_the_inverse_whichever_way_it_is_found(least: float):
    """By a triangle, or by eigenvalues where the matrix is nearly singular."""
    values = np.array([2.0, 1.0, least])
    V = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    half = half_of((V * values) @ V.T)
    inverse = (V / values) @ V.T
    np.testing.assert_allclose(half @ half.T, inverse, rtol=0, atol=1e-14 / least * np.abs(inverse).max())


def test_half_of_a_singular_matrix_is_finite():
    half = half_of(np.ones((3, 3)))
    assert np.isfinite(half).all()
