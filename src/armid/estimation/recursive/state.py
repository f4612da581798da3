"""State of a recursive estimate: triangular factors, rows that are not forgotten, and options of forgetting."""

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
"""Standard deviation that is assumed for a sudden change of a parameter, divided by the standard deviation of the
estimate. It is larger than any real change."""

WHITE = 0.3
"""Weight of the prior that noise is white, as an equivalent number of blocks with white noise, in the estimate of the
correlation between rows. The prior limits the influence of the first blocks."""


@dataclass(frozen=True, eq=False, slots=True)
class ForgettingOptions:
    """Options of forgetting.

    Attributes:
        seconds: Time constant [s], after which 37 % of the information remains. If it is infinite, nothing is
            forgotten.
        changing: Mask of the parameters that may change, shape (b,); if not given, all parameters may change.
            Information about other parameters is never forgotten.
        renewal: Smallest normalised innovation of a joint that counts as a sudden change. After a sudden change, the
            information about the parameters that may change is forgotten, and these parameters are estimated again.
        jump: Standard deviations of a sudden change, shape (b,); by default the standard deviations of the first
            estimate times `JUMP`.
    """

    seconds: float = np.inf
    changing: NDArray[np.bool_] | None = None
    renewal: float = np.inf
    jump: Array | None = None

    def __post_init__(self) -> None:
        if not self.seconds > 0.0:
            raise EstimationError(
                f"The time constant of forgetting must be above 0 s; found {self.seconds:g} s.",
                remedy="give a time in seconds, or infinity to forget nothing.",
            )


@dataclass(frozen=True, eq=False, slots=True)
class Innovations:
    """Statistics of the innovations of blocks, separately for each joint.

    Attributes:
        normalized_innovation: RMS error with which the estimate before the last block predicts the torque of this
            block, divided by the usual RMS error, shape (n,). With ten independent rows, a value of three or more
            occurs by chance once in 1e14 blocks.
        level: Usual ratio of the squared torque error of a block to its expected value, shape (n,).
        blocks: Discounted number of blocks from which `level` was computed, shape (n,).
        pull: Negative gradient of the last block's squared error for each joint, shape (n, b).
        power: Sum over the blocks of the squared gradients divided by their expectation for white noise, shape (n,).
            The sum also contains the products of the gradients of neighbouring blocks.
        expected: Number of blocks in `power`, where each block counts with the share of its gradient that noise
            causes, shape (n,).
    """

    normalized_innovation: Array
    level: Array
    blocks: Array
    pull: Array
    power: Array
    expected: Array

    @property
    def correlation(self) -> Array:
        """Variance of the gradients of blocks, divided by their variance for white noise, at least 1, shape (n,).

        The gradient is that of a joint's squared error in a block.
        """
        return np.maximum((self.power + WHITE) / (self.expected + WHITE), 1.0)


@dataclass(frozen=True, eq=False, slots=True)
class RecursiveState:
    """State of a recursive estimate after some blocks.

    Attributes:
        names: Names of the b parameters.
        joints: Discounted triangular factors of the rows of each joint, as one block.
        rows: Discounted number of rows in use, shape (n,).
        whitened_rows: Whitened rows of the information that is not in `joints` (initial and retained information),
            with the right-hand side last, shape (b, b + 1).
        weights: Weight of each joint's rows, shape (n,).
        fixed: True if the weights were given; otherwise they are computed from the residuals.
        whole: Triangular factor of all whitened rows, those of `joints` included, with the right-hand side last,
            shape (b, b + 1).
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
        """Covariance of the estimate, shape (b, b); `None` as long as the data do not determine all parameters."""
        return None if self.root is None else self.root @ self.root.T

    @property
    def values(self) -> Array:
        """Estimate of the parameters, shape (b,).

        If the estimate is not unique, it is the one with the smallest norm for columns of unit length.
        """
        return minimum_norm_solution(self.whole[:, :-1], self.whole[:, -1])[0]

    @property
    def information(self) -> Information:
        """Discounted factors as information of one block, without `whitened_rows`."""
        rows = np.rint(self.rows).astype(np.int64)[None]
        one = np.zeros(1, dtype=np.int64)
        return Information(self.names, self.joints, rows, one, one, made_by=FactorOrigin("discounted"))
