"""Hyper-dual numbers: a value with two first derivatives and their mixed second derivative, exact to rounding.

    x = x0 + x1 ε1 + x2 ε2 + x12 ε1 ε2,    ε1² = ε2² = 0

If a function is evaluated for such numbers, the factor of ε1 in the result is the derivative of the function along
the first direction, and the factor of ε1 ε2 is the second derivative along both directions [Fike2011]. There is no
truncation error, and no step size has to be chosen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array


@dataclass(frozen=True, eq=False, slots=True)
class HyperDual:
    """Array of hyper-dual numbers.

    Attributes:
        parts: Value, the two first derivatives and the mixed second derivative, shape (4, ...).
    """

    parts: Array

    def __add__(self, other: HyperDual) -> HyperDual:
        return HyperDual(self.parts + other.parts)

    def __sub__(self, other: HyperDual) -> HyperDual:
        return HyperDual(self.parts - other.parts)

    def __mul__(self, other: HyperDual) -> HyperDual:
        return bilinear(np.multiply, self, other)

    def times(self, factor: ArrayLike) -> HyperDual:
        """Product of the hyper-dual numbers with real numbers; shapes are broadcast."""
        return HyperDual(self.parts * np.asarray(factor))

    def at(self, *index: int) -> HyperDual:
        """Elements at given indices of the last axes, for all indices of the other axes."""
        return HyperDual(self.parts[(..., *index)])


def hyper_dual(value: ArrayLike, first: ArrayLike, second: ArrayLike) -> HyperDual:
    """Hyper-dual numbers with given values and first derivatives along two directions; shapes are broadcast."""
    parts = np.broadcast_arrays(value, first, second, 0.0)
    return HyperDual(np.stack(parts).astype(np.float64))


def constant(value: ArrayLike) -> HyperDual:
    """Hyper-dual numbers with given values and with derivatives of zero."""
    return hyper_dual(value, 0.0, 0.0)


def bilinear(product: Callable[[Array, Array], Array], a: HyperDual, b: HyperDual) -> HyperDual:
    """Bilinear product of two arrays of hyper-dual numbers; `product` computes this product for real arrays."""
    x, y = a.parts, b.parts
    return HyperDual(
        np.stack(
            [
                product(x[0], y[0]),
                product(x[0], y[1]) + product(x[1], y[0]),
                product(x[0], y[2]) + product(x[2], y[0]),
                product(x[0], y[3]) + product(x[1], y[2]) + product(x[2], y[1]) + product(x[3], y[0]),
            ]
        )
    )


def sine(x: HyperDual) -> HyperDual:
    """Sine of each hyper-dual number [rad]."""
    s, c = np.sin(x.parts[0]), np.cos(x.parts[0])
    return _function(x, s, c, -s)


def cosine(x: HyperDual) -> HyperDual:
    """Cosine of each hyper-dual number [rad]."""
    s, c = np.sin(x.parts[0]), np.cos(x.parts[0])
    return _function(x, c, -s, -c)


def stacked(numbers: list[HyperDual]) -> HyperDual:
    """Stacks arrays of hyper-dual numbers of the same shape along a new last axis."""
    return HyperDual(np.stack([x.parts for x in numbers], axis=-1))


def _function(x: HyperDual, value: Array, slope: Array, bend: Array) -> HyperDual:
    """Applies a function to hyper-dual numbers x.

    Args:
        x: The numbers.
        value: Values of the function at the real parts of x.
        slope: First derivatives of the function at the real parts of x.
        bend: Second derivatives of the function at the real parts of x.
    """
    _, a, b, ab = x.parts
    return HyperDual(np.stack([value, slope * a, slope * b, slope * ab + bend * a * b]))
