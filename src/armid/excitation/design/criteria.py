"""Optimality criteria of a motion: functions of the information matrix G = Σ Yᵀ Y / σ², with exact derivatives.

The covariance of the base parameters is G⁻¹. Every criterion is minimised, has the order of magnitude of one, and is
returned with its symmetric derivative with respect to G. An extreme eigenvalue has no derivative if two eigenvalues
coincide, and at an optimum they often do. A search therefore replaces the largest and smallest eigenvalue by p-norms
and increases their exponent p (the sharpness) step by step; reported values are exact.

D-optimality does not depend on the units of the parameters; all other criteria do [Swevers1997].
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, cast

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError, did_you_mean

lapack: Any = import_module("scipy.linalg.lapack")

Criterion = Callable[[Array], tuple[float, Array]]
"""Function from G to the value of a criterion and its derivative with respect to G."""

NEGLIGIBLE = 1e-13
"""Ratio of the derivative of the criterion by an eigenvalue to the largest such derivative, below which the
eigenvector is neglected. Gradients need six digits."""

FLOOR = 1e-15
"""Ratio of an eigenvalue of G to the largest one, to which smaller eigenvalues are raised; they are rounding errors
without a useful derivative."""

WELL_CONDITIONED = 1e-10
"""Smallest squared ratio of the smallest to the largest pivot of the Cholesky factor of G with which the inverse by
this factor is accurate enough for gradients."""

SHARP = 30.0
"""Exponent p of a norm of eigenvalues above which the norm usually depends on at most a third of the eigenvalues."""

WORK = 64
"""Number of workspace entries per column that LAPACK gets for products with Householder reflections."""


def _dense(vectors: Array, slopes: Array) -> Array:
    """Derivative by G of a function of its eigenvalues: vectors · slopes · vectorsᵀ, made exactly symmetric."""
    result = (vectors * slopes) @ vectors.T
    return 0.5 * (result + result.T)


def _bounded_below(values: Array) -> Array:
    """Eigenvalues (b,) in ascending order, raised to a small positive lower bound."""
    return np.maximum(values, FLOOR * values[-1] + np.finfo(float).tiny)


def _by_extremes(G: Array, function: Callable[[Array], tuple[float, Array]], sharpness: float) -> tuple[float, Array]:
    """Value of a function of the eigenvalues of G, and its derivative with respect to G, shape (b, b).

    With a large exponent `sharpness`, the function depends on few eigenvalues. Computing all eigenvalues of the
    tridiagonal form takes half the time of computing all eigenvectors; inverse iteration then computes only the
    necessary eigenvectors.
    """
    if sharpness > SHARP:
        form, diagonal, off_diagonal, tau, _ = lapack.dsytrd(G, lower=1)
        values, failed = lapack.dsterf(diagonal, off_diagonal)
        result, slopes = function(_bounded_below(values))
        relevant = np.flatnonzero(np.abs(slopes) > NEGLIGIBLE * np.abs(slopes).max())
        size, r = len(G), len(relevant)
        unreduced = np.abs(off_diagonal).min(initial=np.inf) > FLOOR * np.abs(diagonal).max()
        if not failed and unreduced and 3 * r < size:
            block, split = np.ones(size, dtype=np.int32), np.full(size, size, dtype=np.int32)
            vectors, failed = lapack.dstein(diagonal, off_diagonal, values[relevant], block, split)
            if not failed:
                vectors[1:] = lapack.dormqr("L", "N", form[1:, :-1], tau, vectors[1:], WORK * r)[0]
                return result, _dense(vectors, slopes[relevant])
    values, vectors = np.linalg.eigh(G)
    result, slopes = function(_bounded_below(values))
    return result, _dense(vectors, slopes)


def _inverse(G: Array) -> tuple[float, Array]:
    """Logarithm of the determinant of G, and inverse of G.

    If G is well conditioned, they are computed by Cholesky factorisation, in a third of the time.
    """
    factor, failed = lapack.dpotrf(G, lower=1)
    pivots = np.diag(factor)
    if failed == 0 and pivots.min() ** 2 > WELL_CONDITIONED * pivots.max() ** 2:
        lower = lapack.dpotri(factor, lower=1)[0]
        lower = np.tril(lower)
        return 2.0 * float(np.log(pivots).sum()), lower + np.tril(lower, -1).T
    values, vectors = np.linalg.eigh(G)
    values = _bounded_below(values)
    return float(np.log(values).sum()), _dense(vectors, 1.0 / values)


def d_optimal(G: Array) -> tuple[float, Array]:
    """D-optimality: negative mean logarithm of G's eigenvalues, a measure of the confidence ellipsoid's volume."""
    logarithm, inverse = _inverse(G)
    return -logarithm / len(G), -inverse / len(G)


def condition_number(G: Array, sharpness: float) -> tuple[float, Array]:
    """Logarithm of the condition number of the stacked regressor, equation (3.55a) of the thesis."""

    def function(values: Array) -> tuple[float, Array]:
        largest, smallest = (values / values[-1]) ** sharpness, (values[0] / values) ** sharpness
        value = np.log(values[-1] / values[0]) + np.log(largest.sum() * smallest.sum()) / sharpness
        return 0.5 * float(value), 0.5 * (largest / largest.sum() - smallest / smallest.sum()) / values

    return _by_extremes(G, function, sharpness)


def scaled_condition_number(G: Array, sharpness: float) -> tuple[float, Array]:
    """Logarithm of the condition number of the stacked regressor with columns scaled to unit length."""
    lengths = np.sqrt(np.maximum(np.diag(G), np.finfo(float).tiny))
    scaled = G / np.outer(lengths, lengths)
    value, H = condition_number(scaled, sharpness)
    slopes = H / np.outer(lengths, lengths)
    slopes[np.diag_indices_from(slopes)] -= (H * scaled).sum(axis=1) / lengths**2
    return value, slopes


def trace_of_covariance(G: Array, weight: Array) -> tuple[float, Array]:
    """Logarithm of trace(weight · G⁻¹).

    If the weight is the identity, this is the sum of the variances. If the weight is the information matrix of other
    motions, it is the variance of the torque that is predicted along them.
    """
    inverse = _inverse(G)[1]
    product = inverse @ weight
    trace = float(np.trace(product))
    slopes = -(product @ inverse) / trace
    return float(np.log(trace)), 0.5 * (slopes + slopes.T)


def e_optimal(G: Array, sharpness: float) -> tuple[float, Array]:
    """E-optimality: logarithm of the largest eigenvalue of the covariance."""

    def function(values: Array) -> tuple[float, Array]:
        smallest = (values[0] / values) ** sharpness
        value = np.log(smallest.sum()) / sharpness - np.log(values[0])
        return float(value), -smallest / (values * smallest.sum())

    return _by_extremes(G, function, sharpness)


def worst_deviation(G: Array, scale: Array, sharpness: float) -> tuple[float, Array]:
    """Logarithm of the largest relative standard deviation of all parameters.

    The relative standard deviation of a parameter is its standard deviation divided by its typical value in `scale`.
    Parameters with an infinite value in `scale` are ignored.
    """
    inverse = _inverse(G)[1]
    variance = np.diag(inverse)
    relative = variance / scale**2
    highest = relative.max()
    powers = (relative / highest) ** sharpness
    value = 0.5 * (np.log(highest) + np.log(powers.sum()) / sharpness)
    slopes = 0.5 * powers / (variance * powers.sum())
    return float(value), -(inverse * slopes) @ inverse


CRITERIA = {
    "d-optimal": "volume of the confidence ellipsoid; does not depend on units",
    "condition": "condition number of the stacked regressor, (3.55a) of the thesis",
    "scaled-condition": "condition number of the stacked regressor with columns scaled to unit length",
    "a-optimal": "sum of the variances of the base parameters",
    "e-optimal": "largest variance of any combination of base parameters of unit length",
    "prediction": "variance of the torque predicted along given motions",
    "worst": "largest standard deviation of a base parameter, divided by its typical value where values are known",
}
"""Names of the criteria, with the quantity that each criterion minimises."""


def make_criterion(
    name: str, sharpness: float, prediction: Array | None = None, scale: Array | None = None
) -> Criterion:
    """Makes the criterion with a given name.

    Args:
        name: One of `CRITERIA`.
        sharpness: Exponent p of the norms that replace extreme eigenvalues.
        prediction: Information matrix (b, b) of the motions whose torque the model must predict well.
        scale: Typical values of the parameters, shape (b,); infinite for parameters to be ignored. If `None`, all
            typical values are 1.

    Raises:
        ArmidError: The name is unknown, or the criterion is `prediction` and no motions are given.
    """
    if name not in CRITERIA:
        raise ArmidError(
            f"There is no criterion {name!r}.", possible=", ".join(CRITERIA), remedy=did_you_mean(name, CRITERIA)
        )
    if name == "prediction" and prediction is None:
        raise ArmidError(
            "The criterion 'prediction' needs at least one motion whose torque the model must predict well.",
            remedy="give the plans of these motions with --predict.",
        )
    made: dict[str, Criterion] = {
        "d-optimal": d_optimal,
        "condition": lambda G: condition_number(G, sharpness),
        "scaled-condition": lambda G: scaled_condition_number(G, sharpness),
        "a-optimal": lambda G: trace_of_covariance(G, np.eye(len(G))),
        "e-optimal": lambda G: e_optimal(G, sharpness),
        "prediction": lambda G: trace_of_covariance(G, cast("Array", prediction)),
        "worst": lambda G: worst_deviation(G, np.ones(len(G)) if scale is None else scale, sharpness),
    }
    return made[name]
