"""What makes a motion good: functions of the information matrix G = Σ Yᵀ Y / σ² and their exact derivatives.

The covariance of the base parameters is G⁻¹. Every criterion is made small, is of the order of one, and is returned
with its derivative by G, symmetric. Extremes of eigenvalues have no derivative where two of them meet, and that is
where an optimum is; they are taken as p-norms, whose sharpness p a search raises, and reported exactly.

D-optimality does not depend on the units of the parameters; the others do [Swevers1997].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np

from armid.errors import ArmidError
from armid.values import Array

__all__ = ["CRITERIA", "Criterion", "Spectral", "condition_number", "make_criterion", "trace_of_covariance"]

FEW = 1e-17
"""Slope by an eigenvalue, over the largest, that cannot change a sum of double precision."""


@dataclass(frozen=True, eq=False, slots=True)
class Spectral:
    """A derivative by G of low rank, vectors · slopes · vectorsᵀ: sharp extremes look at few eigenvalues.

    Attributes:
        vectors: Shape (b, r).
        slopes: Shape (r,).
    """

    vectors: Array
    slopes: Array

    @property
    def dense(self) -> Array:
        """Shape (b, b)."""
        return (self.vectors * self.slopes) @ self.vectors.T


Criterion = Callable[[Array], tuple[float, Array | Spectral]]
"""Value and derivative by G."""

FLOOR = 1e-15
"""Smallest eigenvalue over the largest that counts; below it there is only rounding, and no way down."""


def _decompose(G: Array) -> tuple[Array, Array]:
    """Eigenvalues, the smallest lifted from zero, and eigenvectors."""
    values, vectors = np.linalg.eigh(G)
    return np.maximum(values, FLOOR * values[-1] + np.finfo(float).tiny), vectors


def _few(vectors: Array, slopes: Array) -> Spectral:
    """Derivative by G of a function of its eigenvalues, those that count."""
    counted = np.abs(slopes) > FEW * np.abs(slopes).max()
    return Spectral(vectors[:, counted], slopes[counted])


def d_optimal(G: Array) -> tuple[float, Array]:
    """Minus the mean logarithm of the eigenvalues: the volume of the confidence ellipsoid."""
    values, vectors = _decompose(G)
    b = len(G)
    return -float(np.log(values).sum()) / b, Spectral(vectors, -1.0 / (b * values)).dense


def condition_number(G: Array, sharpness: float) -> tuple[float, Spectral]:
    """Logarithm of the condition number of the stacked regressor, (3.55a)."""
    values, vectors = _decompose(G)
    largest, smallest = (values / values[-1]) ** sharpness, (values[0] / values) ** sharpness
    value = np.log(values[-1] / values[0]) + np.log(largest.sum() * smallest.sum()) / sharpness
    slopes = largest / (values * largest.sum()) - smallest / (values * smallest.sum())
    return 0.5 * float(value), _few(vectors, 0.5 * slopes)


def scaled_condition_number(G: Array, sharpness: float) -> tuple[float, Array]:
    """The same of columns scaled to unit length."""
    lengths = np.sqrt(np.maximum(np.diag(G), np.finfo(float).tiny))
    scaled = G / np.outer(lengths, lengths)
    value, spectral = condition_number(scaled, sharpness)
    H = spectral.dense
    slopes = H / np.outer(lengths, lengths)
    slopes[np.diag_indices_from(slopes)] -= (H * scaled).sum(axis=1) / lengths**2
    return value, slopes


def trace_of_covariance(G: Array, weight: Array) -> tuple[float, Array]:
    """Logarithm of trace(weight · G⁻¹): of the sum of variances, or of the variance of what weight predicts."""
    values, vectors = _decompose(G)
    inverse = Spectral(vectors, 1.0 / values).dense
    through = inverse @ weight
    trace = float(np.trace(through))
    slopes = -(through @ inverse) / trace
    return float(np.log(trace)), 0.5 * (slopes + slopes.T)


def e_optimal(G: Array, sharpness: float) -> tuple[float, Spectral]:
    """Logarithm of the largest eigenvalue of the covariance."""
    values, vectors = _decompose(G)
    smallest = (values[0] / values) ** sharpness
    value = np.log(smallest.sum()) / sharpness - np.log(values[0])
    return float(value), _few(vectors, -smallest / (values * smallest.sum()))


def worst_deviation(G: Array, scale: Array, sharpness: float) -> tuple[float, Array]:
    """Logarithm of the largest standard deviation of a parameter over its size."""
    values, vectors = _decompose(G)
    inverse = Spectral(vectors, 1.0 / values).dense
    relative = np.diag(inverse) / scale**2
    highest = relative.max()
    worth = (relative / highest) ** sharpness
    value = 0.5 * (np.log(highest) + np.log(worth.sum()) / sharpness)
    slopes = 0.5 * worth / (relative * worth.sum()) / scale**2
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
        scale: Sizes of the parameters, shape (b,); one where not given.

    Raises:
        ArmidError: No such criterion, or `prediction` without motions.
    """
    if name not in CRITERIA:
        raise ArmidError(f"There is no criterion {name!r}.", possible=", ".join(CRITERIA))
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
