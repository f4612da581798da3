"""Hyper-dual numbers: derivatives of known functions, products of arrays."""

from __future__ import annotations

import numpy as np

from armid.thesis.hyperdual import bilinear, constant, cosine, hyper_dual, sine, stacked

ROUNDING = 1e-14
"""A few operations on numbers of the order of one."""


def test_derivatives_of_a_product_of_sines():
    """f = sin(x y) cos(y) at states, by x and by y."""
    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(2, 20))
    a, b = hyper_dual(x, 1.0, 0.0), hyper_dual(y, 0.0, 1.0)
    value, by_x, by_y, mixed = (sine(a * b) * cosine(b)).parts
    s, c = np.sin(x * y), np.cos(x * y)
    np.testing.assert_allclose(value, s * np.cos(y), atol=ROUNDING)
    np.testing.assert_allclose(by_x, y * c * np.cos(y), atol=ROUNDING)
    np.testing.assert_allclose(by_y, x * c * np.cos(y) - s * np.sin(y), atol=ROUNDING)
    expected = c * np.cos(y) - x * y * s * np.cos(y) - y * c * np.sin(y)
    np.testing.assert_allclose(mixed, expected, atol=ROUNDING)


def test_second_derivative_along_one_direction():
    """x³ - 2 x, both directions the same."""
    x = np.linspace(-1.0, 2.0, 7)
    a = hyper_dual(x, 1.0, 1.0)
    found = a * a * a - a.times(2.0) + constant(np.full(7, 5.0))
    np.testing.assert_allclose(found.parts[0], x**3 - 2.0 * x + 5.0, atol=ROUNDING)
    np.testing.assert_allclose(found.parts[1], 3.0 * x**2 - 2.0, atol=ROUNDING)
    np.testing.assert_allclose(found.parts[3], 6.0 * x, atol=ROUNDING)


def test_products_of_matrices_and_places():
    rng = np.random.default_rng(1)
    A, B = rng.normal(size=(2, 3, 3))
    a = hyper_dual(A, np.eye(3), 0.0)
    product = bilinear(np.matmul, a, constant(B))
    np.testing.assert_allclose(product.parts[0], A @ B, atol=ROUNDING)
    np.testing.assert_allclose(product.parts[1], B, atol=ROUNDING)
    assert product.at(0, 1).parts[0] == product.parts[0][0, 1]
    side = stacked([a.at(0, 0), a.at(1, 1)])
    np.testing.assert_array_equal(side.parts[1], [1.0, 1.0])
