"""Student's t and chi-squared distributions.

The distributions of SciPy are not used, because their import takes a fifth of a second.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from armid.checked_array import Array

NORMAL = 1.959963984540054
"""Quantile 0.975 of the normal distribution, for two-sided 95 % intervals."""

NODES = 32
"""Number of nodes of the quadrature that integrates the density of Student's t distribution. With this number, the
error is below rounding for one degree of freedom and more."""

SHIFT = 20
"""Integer that is added to the argument of a ratio of gamma functions, so that five terms of the asymptotic series
are enough."""

MANY = 1e30
"""Finite number of degrees of freedom that replaces infinity in the computation."""

STEPS = 20
"""Largest number of Newton steps for a quantile; ten are enough."""

POINTS = 24
"""Number of Chebyshev points by which quantiles for many different degrees of freedom are interpolated. With this
number, the error is below 1e-13 of the quantile for one degree of freedom and more."""

MIXTURE_NODES = 40
"""Number of nodes of the quadrature over a lognormal standard deviation. If the standard deviation of its logarithm
is at most 0.7, the quantile has an error below 1e-6."""

BISECTIONS = 50
"""Number of bisections for a quantile; each one halves the error of the quantile."""


def student_quantile(freedom: ArrayLike) -> Array:
    """Quantile 0.975 of Student's t distribution, the factor of two-sided 95 % intervals.

    With t = √ν tan θ, the distribution function is the integral of cos^(ν-1) θ, which is computed by quadrature to
    rounding accuracy. The distribution function is concave, so Newton's method converges from below without
    overshooting. For many different ν, the logarithm of the quantile is interpolated by a polynomial in 1/ν.

    Args:
        freedom: Degrees of freedom ν, any shape; they may be infinite.

    Returns:
        Quantiles of the same shape.
    """
    nu = np.asarray(freedom, dtype=np.float64)
    if not (nu >= 1.0).all():  # the density is singular, and nobody has so little
        from scipy.special import stdtrit

        return np.asarray(stdtrit(nu, 0.975), dtype=np.float64)
    v, place = np.unique(np.minimum(nu, MANY), return_inverse=True)
    return (_quantiles(v) if v.size <= POINTS else _interpolated(v))[place].reshape(nu.shape)


def _interpolated(v: Array) -> Array:
    """Quantiles 0.975 for increasing degrees of freedom v (N,), interpolated between Chebyshev points in 1/v."""
    x = 1.0 / v
    middle, half = 0.5 * (x[0] + x[-1]), 0.5 * (x[0] - x[-1])
    at = np.cos(np.pi * (np.arange(POINTS) + 0.5) / POINTS)
    coefficients = chebyshev.chebfit(at, np.log(_quantiles(1.0 / (middle + half * at))), POINTS - 1)
    return np.asarray(np.exp(chebyshev.chebval((x - middle) / half, coefficients)), dtype=np.float64)


def _quantiles(v: Array) -> Array:
    """Quantiles 0.975 for degrees of freedom v, shape (N,), by Newton's method."""
    scale = _gamma_ratio(v / 2.0) / math.sqrt(math.pi)
    node, weight = _quadrature()
    angle = np.arctan(NORMAL / np.sqrt(v))
    for _ in range(STEPS):
        inner = np.exp((v[:, None] - 1.0) / 2.0 * np.log1p(-(np.sin(angle[:, None] * node) ** 2)))
        density = np.exp((v - 1.0) / 2.0 * np.log1p(-(np.sin(angle) ** 2)))
        step = (0.475 / scale - angle * (inner @ weight)) / density
        angle += step
        if (np.abs(step) <= 1e-15 * angle).all():
            break
    return np.asarray(np.sqrt(v) * np.tan(angle), dtype=np.float64)


def scale_mixture_quantile(deviation: float) -> float:
    """Quantile 0.975 of a variable that is normal with a random standard deviation, which is lognormal with median 1.

    The probability is an integral over the logarithm of the standard deviation, computed by Gauss-Hermite quadrature,
    and the quantile is found by bisection.

    Args:
        deviation: Standard deviation of the natural logarithm of the random standard deviation, up to about one.
    """
    node, weight = np.polynomial.hermite_e.hermegauss(MIXTURE_NODES)
    weight = weight / weight.sum()
    scale = np.exp(deviation * node)

    def inside(x: float) -> float:
        return float(weight @ np.array([math.erf(x / (each * math.sqrt(2.0))) for each in scale]))

    low, high = 0.5 * NORMAL, NORMAL * math.exp(3.0 * deviation**2 + 3.0 * deviation)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if inside(middle) < 0.95 else (low, middle)
    return 0.5 * (low + high)


def chi_squared_survival(freedom: int, x: float) -> float:
    """Probability that a chi-squared variable exceeds x, computed by the finite sum for integer degrees of freedom.

    Args:
        freedom: Degrees of freedom, an integer of at least one.
        x: Threshold.
    """
    half = x / 2.0
    if half <= 0.0:
        return 1.0
    first = 0.5 * (freedom % 2)  # the powers are whole, or between whole numbers
    power = first + np.arange(freedom // 2)
    exponent = np.array([k * math.log(half) - half - math.lgamma(k + 1.0) for k in power])
    return float(np.exp(exponent).sum()) + (math.erfc(math.sqrt(half)) if first else 0.0)


def _gamma_ratio(a: Array) -> Array:
    """Ratios Γ(a + 1/2) / Γ(a) for a > 0, computed without subtracting two large logarithms."""
    ratio, x = np.ones_like(a), a + SHIFT
    for k in range(SHIFT):
        ratio *= (a + k) / (a + k + 0.5)
    series = (-1 / 8, 1 / 192, -1 / 640, 17 / 14336, -31 / 18432)
    return ratio * np.sqrt(x) * np.exp(sum(c / x ** (2 * k + 1) for k, c in enumerate(series)))


@cache
def _quadrature() -> tuple[Array, Array]:
    """Nodes and weights of the Gauss-Legendre rule on [0, 1], from its three-term recursion."""
    k = np.arange(1, NODES)
    beside = k / np.sqrt(4.0 * k**2 - 1.0)
    node, vectors = np.linalg.eigh(np.diag(beside, -1) + np.diag(beside, 1))
    return (node + 1.0) / 2.0, vectors[0] ** 2
