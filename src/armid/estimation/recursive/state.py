"""State of a recursive estimate: factors, retained rows, and options of forgetting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.whitened_system import minimum_norm_solution
from armid.information.information import FactorOrigin, Information, JointFactors
from armid.model.parameter_name import ParameterName

JUMP = 1000.0
"""Standard deviation of a sudden change of a parameter, divided by that of its estimate: larger than any real
change."""

WHITE = 0.3
"""Number of blocks with white noise to which the prior of the correlation is equivalent; it limits the influence of
the first blocks."""


@dataclass(frozen=True, eq=False, slots=True)
class ForgettingOptions:
    """Options of forgetting.

    Attributes:
        seconds: Time constant [s], after which 37 % of the information remains. If it is infinite, nothing is
            forgotten.
        changing: Mask of the parameters that may change, shape (b,); if not given, all. Information about the others
            is never forgotten.
        renewal: Smallest normalised innovation of a joint that counts as a sudden change. After a sudden change, the
            information about the parameters that may change is forgotten, and these parameters are estimated again.
        jump: Standard deviations of a sudden change, shape (b,); by default those of the first estimate times
            `JUMP`.
    """

    seconds: float = np.inf
    changing: NDArray[np.bool_] | None = None
    renewal: float = np.inf
    jump: Array | None = None

    def __post_init__(self) -> None:
        if not self.seconds > 0.0:
            raise EstimationError(f"The time constant of forgetting must be above 0 s; found {self.seconds:g} s.")


@dataclass(frozen=True, eq=False, slots=True)
class Innovations:
    """Statistics of the innovations of blocks, joint by joint.

    Attributes:
        normalized_innovation: RMS torque error of the last block, predicted with the estimate before it, divided by
            the usual RMS error, shape (n,). For ten independent rows it is three or more by chance once in 1e14
            blocks.
        level: Usual ratio of the squared error to its expected value, shape (n,).
        blocks: Discounted number of blocks from which `level` was computed, shape (n,).
        pull: Negative gradient of the last block's squared error for each joint, shape (n, b).
        power: Sum of the squared gradients divided by their expectation for white noise, shape (n,). It contains
            the products of the gradients of neighbouring blocks.
        expected: Number of blocks in `power`, each weighted by the share of its gradient that noise causes, shape
            (n,).
    """

    normalized_innovation: Array
    level: Array
    blocks: Array
    pull: Array
    power: Array
    expected: Array

    @property
    def correlation(self) -> Array:
        """Variance of the gradient divided by its variance for white noise, at least 1, shape (n,)."""
        return np.maximum((self.power + WHITE) / (self.expected + WHITE), 1.0)


@dataclass(frozen=True, eq=False, slots=True)
class RecursiveState:
    """State of a recursive estimate after some blocks.

    Attributes:
        names: Names of the b parameters.
        joints: Discounted factors of each joint's rows, one block.
        rows: Discounted number of rows in use, shape (n,).
        whitened_rows: Whitened rows of information that is not in `joints`, with the right-hand side last,
            shape (b, b + 1).
        weights: Weight of each joint's rows, shape (n,).
        fixed: True if the weights were given; otherwise they are computed from the residuals.
        whole: Triangular factor of all whitened rows, with the right-hand side last, shape (b, b + 1).
        root: Factor L of the covariance L Lᵀ of the values, shape (b, b); `None` while the data do not determine the
            values. The update of a factor keeps variances positive; an update of the full matrix may not
            [Bierman1977].
        memory: Options of forgetting.
        innovations: Statistics of the innovations.
    """

    names: tuple[ParameterName, ...]
    joints: tuple[JointFactors, ...]
    rows: Array
    whitened_rows: Array
    weights: Array
    fixed: bool
    whole: Array
    root: Array | None
    memory: ForgettingOptions
    innovations: Innovations

    @property
    def covariance(self) -> Array | None:
        """Covariance of the values, shape (b, b); `None` while the data do not determine them."""
        return None if self.root is None else self.root @ self.root.T

    @property
    def values(self) -> Array:
        """Estimate, shape (b,); if it is not unique, the one with the smallest norm for columns of unit length."""
        return minimum_norm_solution(self.whole[:, :-1], self.whole[:, -1])[0]

    @property
    def information(self) -> Information:
        """Discounted factors as information of one block, without `whitened_rows`."""
        rows = np.rint(self.rows).astype(np.int64)[None]
        one = np.zeros(1, dtype=np.int64)
        return Information(self.names, self.joints, rows, one, one, made_by=FactorOrigin("discounted"))
