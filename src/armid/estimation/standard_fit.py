"""Estimated standard parameters, each with what the data really say about it.

With H the information of the data and P that of the prior, both in standard parameters, the diagonal of

    (H + P)⁻¹ H

is the share of a parameter's value that the data bring; the rest is the prior's [Backus1968]. Base parameters are
what torques show, so that most standard ones are shared out by the prior or the cone alone, however good the data
are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from armid.values import Array, array

__all__ = [
    "IDENTIFIED",
    "UNSEEN",
    "PriorUse",
    "Proof",
    "StandardFit",
    "Status",
    "Trial",
    "inverse_of",
    "shares",
    "status_of",
]

Status = Literal["identified", "prior-dominated", "not identifiable"]

IDENTIFIED = 0.9
"""Share of the data from which on a parameter is identified: a tenth of the prior's value moves it by no more than a
tenth of what the prior is wrong."""

LEAST = 1e-15
"""Smallest eigenvalue over the largest, rows and columns scaled: what is smaller is rounding."""

UNSEEN = 0.1
"""Share of the data below which a parameter is not identifiable: the data say next to nothing."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A weight of the prior that was tried.

    Attributes:
        weight: Independent samples a joint.
        error: Mean over folds and joints of the logarithm of the held-out variance over that of the residual.
    """

    weight: float
    error: float


@dataclass(frozen=True, slots=True)
class PriorUse:
    """The prior of an estimate.

    Attributes:
        kind: `mass`, `log-det`, `euclidean` or `none`.
        weight: Independent samples a joint; 0 where the kind has none.
        how: How the weight was found.
        correlation: Rows that count as one independent sample.
        trials: What was tried.
    """

    kind: str
    weight: float
    how: str
    correlation: float
    trials: tuple[Trial, ...] = ()


@dataclass(frozen=True, slots=True)
class Proof:
    """What the solution was checked by, computed from the answer and not from the solver's word.

    Attributes:
        price: Weighted squared residual over that without constraints and prior, less one.
        smallest_eigenvalue: Of all links' pseudo-inertias.
        lowest: Smallest value of the parameters that physics forbids to be negative.
        gap: Duality gap, relative.
    """

    price: float
    smallest_eigenvalue: float
    lowest: float
    gap: float


@dataclass(frozen=True, eq=False, slots=True)
class StandardFit:
    """Estimate of p standard parameters.

    Attributes:
        names: Their names; friction of several recordings has copies, `FV_1[2]`.
        units: Their units.
        values: Shape (p,).
        deviation: Standard deviations of what data and prior leave open, correlation of rows counted, shape (p,).
        intervals: 95 % intervals, cut where physics forbids values, shape (p, 2).
        resolution: Share of the data in each value, shape (p,).
        status: What that means, p of them.
        prior: The prior.
        proof: Checks of the solution.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    deviation: Array
    intervals: Array
    resolution: Array
    status: tuple[str, ...]
    prior: PriorUse
    proof: Proof

    def __post_init__(self) -> None:
        p = len(self.names)
        for name in ("names", "units", "status"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for name in ("values", "deviation", "resolution"):
            object.__setattr__(self, name, array(getattr(self, name), (p,), name))
        object.__setattr__(self, "intervals", array(self.intervals, (p, 2), "intervals"))


def status_of(resolution: Array, told: bool, given: Array, held: Array) -> tuple[Status, ...]:
    """Status of each parameter.

    Args:
        resolution: Share of the data, shape (p,).
        told: Whether a prior says where parameters are that the data do not determine.
        given: Which parameters the study gives, shape (p,).
        held: Which parameters stand at a bound that the data would cross, shape (p,).
    """
    result: list[Status] = []
    for share, is_given, is_held in zip(resolution, given, held, strict=True):
        if is_given:
            result.append("prior-dominated")
        elif share >= IDENTIFIED:
            result.append("prior-dominated" if is_held else "identified")
        else:
            result.append("prior-dominated" if told and share >= UNSEEN else "not identifiable")
    return tuple(result)


def shares(information: Array, precision: Array) -> tuple[Array, Array]:
    """Covariance (H + P)⁻¹ and the diagonal of (H + P)⁻¹ H.

    Args:
        information: H, shape (p, p).
        precision: P, shape (p, p), positive definite.
    """
    inverse = inverse_of(information + precision)
    return inverse, np.clip(np.sum(inverse * information.T, axis=1), 0.0, 1.0)


def inverse_of(matrix: Array) -> Array:
    """Inverse of a positive definite matrix, symmetric and positive whatever rounding made of the matrix."""
    size = 1.0 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(np.float64).tiny))
    values, vectors = np.linalg.eigh(size[:, None] * (0.5 * (matrix + matrix.T)) * size)
    half = size[:, None] * vectors / np.sqrt(np.maximum(values, LEAST * values[-1]))
    return half @ half.T
