"""Criteria of a motion: functions of the information matrix G = Σ Yᵀ Y / σ² and their exact derivatives.

The covariance of the base parameters is G⁻¹. Every criterion is made small, is of the order of one, and is returned
with its derivative by G, symmetric. Extremes of eigenvalues have no derivative where two of them meet, and that is
where an optimum is; they are taken as p-norms, whose sharpness p a search raises, and reported exactly.

D-optimality does not depend on the units of the parameters; the others do [Swevers1997].
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, cast

import numpy as np

from armid.errors import ArmidError, did_you_mean
from armid.values import Array

__all__ = ["CRITERIA", "Criterion", "condition_number", "make_criterion", "trace_of_covariance"]

lapack: Any = import_module("scipy.linalg.lapack")

Criterion = Callable[[Array], tuple[float, Array]]
"""Value and derivative by G."""

FEW = 1e-13
"""Slope by an eigenvalue, over the largest, below which its vector is left out: gradients need six digits."""

FLOOR = 1e-15
"""Smallest eigenvalue over the largest that counts; below it there is only rounding, and no way down."""

SAFE = 1e-10
"""Smallest pivot over the largest down to which Cholesky's inverse is good to more digits than gradients need."""

SHARP = 30.0
"""p above which a third of the eigenvalues or fewer decide a norm."""

WORK = 64
"""Numbers of workspace a column that LAPACK's products with reflections ask for."""


def _dense(vectors: Array, slopes: Array) -> Array:
    """Derivative by G of a function of its eigenvalues: vectors · slopes · vectorsᵀ, exactly symmetric."""
    result = (vectors * slopes) @ vectors.T
    return 0.5 * (result + result.T)


def _lifted(values: Array) -> Array:
    """Eigenvalues, the smallest lifted from zero."""
    return np.maximum(values, FLOOR * values[-1] + np.finfo(float).tiny)


def _by_extremes(G: Array, function: Callable[[Array], tuple[float, Array]], sharpness: float) -> tuple[float, Array]:
    """A function of the eigenvalues, and its derivative by G.

    Where it is sharp, few of them decide it: all eigenvalues of the tridiagonal form take half the time of all
    vectors, and inverse iteration then finds those that count.
    """
    if sharpness > SHARP:
        form, diagonal, beside, tau, _ = lapack.dsytrd(G, lower=1)
        values, failed = lapack.dsterf(diagonal, beside)
        found, slopes = function(_lifted(values))
        counted = np.flatnonzero(np.abs(slopes) > FEW * np.abs(slopes).max())
        size, r = len(G), len(counted)
        whole = np.abs(beside).min(initial=np.inf) > FLOOR * np.abs(diagonal).max()
        if not failed and whole and 3 * r < size:
            block, split = np.ones(size, dtype=np.int32), np.full(size, size, dtype=np.int32)
            vectors, failed = lapack.dstein(diagonal, beside, values[counted], block, split)
            if not failed:
                vectors[1:] = lapack.dormqr("L", "N", form[1:, :-1], tau, vectors[1:], WORK * r)[0]
                return found, _dense(vectors, slopes[counted])
    values, vectors = np.linalg.eigh(G)
    found, slopes = function(_lifted(values))
    return found, _dense(vectors, slopes)


def _inverse(G: Array) -> tuple[float, Array]:
    """Logarithm of the determinant, and inverse; by Cholesky, a third of the time, where G is far from singular."""
    factor, failed = lapack.dpotrf(G, lower=1)
    pivots = np.diag(factor)
    if failed == 0 and pivots.min() ** 2 > SAFE * pivots.max() ** 2:
        lower = lapack.dpotri(factor, lower=1)[0]
        lower = np.tril(lower)
        return 2.0 * float(np.log(pivots).sum()), lower + np.tril(lower, -1).T
    values, vectors = np.linalg.eigh(G)
    values = _lifted(values)
    return float(np.log(values).sum()), _dense(vectors, 1.0 / values)


def d_optimal(G: Array) -> tuple[float, Array]:
    """Minus the mean logarithm of the eigenvalues: the volume of the confidence ellipsoid."""
    logarithm, inverse = _inverse(G)
    return -logarithm / len(G), -inverse / len(G)


def condition_number(G: Array, sharpness: float) -> tuple[float, Array]:
    """Logarithm of the condition number of the stacked regressor, (3.55a)."""

    def function(values: Array) -> tuple[float, Array]:
        largest, smallest = (values / values[-1]) ** sharpness, (values[0] / values) ** sharpness
        value = np.log(values[-1] / values[0]) + np.log(largest.sum() * smallest.sum()) / sharpness
        return 0.5 * float(value), 0.5 * (largest / largest.sum() - smallest / smallest.sum()) / values

    return _by_extremes(G, function, sharpness)


def scaled_condition_number(G: Array, sharpness: float) -> tuple[float, Array]:
    """The same of columns scaled to unit length."""
    lengths = np.sqrt(np.maximum(np.diag(G), np.finfo(float).tiny))
    scaled = G / np.outer(lengths, lengths)
    value, H = condition_number(scaled, sharpness)
    slopes = H / np.outer(lengths, lengths)
    slopes[np.diag_indices_from(slopes)] -= (H * scaled).sum(axis=1) / lengths**2
    return value, slopes


def trace_of_covariance(G: Array, weight: Array) -> tuple[float, Array]:
    """Logarithm of trace(weight · G⁻¹): of the sum of variances, or of the variance of what weight predicts."""
    inverse = _inverse(G)[1]
    through = inverse @ weight
    trace = float(np.trace(through))
    slopes = -(through @ inverse) / trace
    return float(np.log(trace)), 0.5 * (slopes + slopes.T)


def e_optimal(G: Array, sharpness: float) -> tuple[float, Array]:
    """Logarithm of the largest eigenvalue of the covariance."""

    def function(values: Array) -> tuple[float, Array]:
        smallest = (values[0] / values) ** sharpness
        value = np.log(smallest.sum()) / sharpness - np.log(values[0])
        return float(value), -smallest / (values * smallest.sum())

    return _by_extremes(G, function, sharpness)


def worst_deviation(G: Array, scale: Array, sharpness: float) -> tuple[float, Array]:
    """Logarithm of the largest standard deviation of a parameter over its size; infinite sizes do not count."""
    inverse = _inverse(G)[1]
    variance = np.diag(inverse)
    relative = variance / scale**2
    highest = relative.max()
    worth = (relative / highest) ** sharpness
    value = 0.5 * (np.log(highest) + np.log(worth.sum()) / sharpness)
    slopes = 0.5 * worth / (variance * worth.sum())
    return float(value), -(inverse * slopes) @ inverse


CRITERIA = {
    "d-optimal": "volume of the confidence ellipsoid; does not depend on units",
    "condition": "condition number of the stacked regressor, (3.55a)",
    "scaled-condition": "condition number of its columns scaled to unit length",
    "a-optimal": "sum of the base parameters' variances",
    "e-optimal": "largest variance of any combination of base parameters of unit length",
    "prediction": "variance of the torque predicted along given motions",
    "worst": "largest deviation of a base parameter over its size, where sizes are known, else as it is",
}
"""Names of the criteria, and what each makes small."""


def make_criterion(
    name: str, sharpness: float, prediction: Array | None = None, scale: Array | None = None
) -> Criterion:
    """A criterion by name.

    Args:
        name: One of `CRITERIA`.
        sharpness: p of the norms that stand for extremes of eigenvalues.
        prediction: Information matrix (b, b) of the motions whose torque is to be predicted.
        scale: Sizes of the parameters, shape (b,), infinite for those that do not count; one where not given.

    Raises:
        ArmidError: No such criterion, or `prediction` without motions.
    """
    if name not in CRITERIA:
        raise ArmidError(
            f"There is no criterion {name!r}.", possible=", ".join(CRITERIA), remedy=did_you_mean(name, CRITERIA)
        )
    if name == "prediction" and prediction is None:
        raise ArmidError(
            "The criterion 'prediction' needs motions to predict.", remedy="give plans whose torque matters."
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
