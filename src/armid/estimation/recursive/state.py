"""State of a recursive estimate: factors, what is kept beside them, and how it forgets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.errors import EstimationError
from armid.estimation.whitening import minimum_norm_solution
from armid.information.information import Information, JointFactors
from armid.values import Array

__all__ = ["JUMP", "ForgettingOptions", "Innovations", "RecursiveState"]

JUMP = 1000.0
"""How much larger than its deviation a change of a parameter at once may be: more than any."""

WHITE = 0.3
"""White blocks that are added to those seen, so that the first ones do not say everything."""


@dataclass(frozen=True, eq=False, slots=True)
class ForgettingOptions:
    """Forgetting of the past.

    Attributes:
        seconds: Time constant; after it 37 % of what was known is left. Infinite for no forgetting.
        changing: Parameters that may change, shape (b,); all where not given. The others are never forgotten.
        renewal: Surprise of a joint from which on a block says that something has changed at once. What may change
            is then forgotten, and learnt again as the motion shows it.
        jump: Standard deviations of such a change, shape (b,); where not given, those of the first estimate times
            `JUMP`.
    """

    seconds: float = np.inf
    changing: NDArray[np.bool_] | None = None
    renewal: float = np.inf
    jump: Array | None = None

    def __post_init__(self) -> None:
        if not self.seconds > 0.0:
            raise EstimationError(f"A memory lasts longer than 0 s; found {self.seconds:g} s.")


@dataclass(frozen=True, eq=False, slots=True)
class Innovations:
    """News of blocks, which the estimate before them did not know, joint by joint.

    Attributes:
        surprise: RMS torque error of the last block by the estimate before it, over what such errors usually are,
            shape (n,). Chance makes it three with ten independent rows once in 1e14 blocks.
        level: Usual squared error over the expected one, shape (n,).
        blocks: Blocks that the level was found from, discounted.
        pull: Slope of the last block's squared error, by joint, shape (n, b).
        power: Σ of the squared pulls over those of white noise, neighbours counted, shape (n,).
        expected: Number of blocks in it, those with an unsure estimate counted less, shape (n,).
    """

    surprise: Array
    level: Array
    blocks: Array
    pull: Array
    power: Array
    expected: Array

    @property
    def correlation(self) -> Array:
        """Variance of the pull over that of white noise, at least 1, shape (n,)."""
        return np.maximum((self.power + WHITE) / (self.expected + WHITE), 1.0)


@dataclass(frozen=True, eq=False, slots=True)
class RecursiveState:
    """All that is known after some blocks.

    Attributes:
        names: Names of the b parameters.
        joints: Discounted factors of each joint's rows, one block.
        rows: Rows that count, discounted, shape (n,).
        kept: Whitened rows beside those of the joints, side last, shape (b, b + 1).
        weights: Weight of each joint's rows, shape (n,).
        fixed: Whether the weights were given; else they follow the residuals.
        whole: All rows whitened, triangular, side last, shape (b, b + 1).
        root: Factor L of the covariance L Lᵀ of the values, shape (b, b); `None` while the data do not determine
            them. A factor, since rounding can make variances negative that are updated as a matrix [Bierman1977].
        memory: How the past is forgotten.
        innovations: What the blocks said that was new.
    """

    names: tuple[str, ...]
    joints: tuple[JointFactors, ...]
    rows: Array
    kept: Array
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
        """The estimate, shape (b,); the shortest, columns of unit length, where the data do not determine it."""
        return minimum_norm_solution(self.whole[:, :-1], self.whole[:, -1])[0]

    @property
    def information(self) -> Information:
        """The discounted factors as information of one block; `kept` is not in it."""
        rows = np.rint(self.rows).astype(np.int64)[None]
        one = np.zeros(1, dtype=np.int64)
        return Information(self.names, self.joints, rows, one, one, made_by="discounted")
