"""What an estimator returns: values of the base parameters and how well the data determine them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from armid.values import Array, array

__all__ = ["POORLY_IDENTIFIED", "Fit"]

POORLY_IDENTIFIED = 10.0
"""A relative deviation above so many times the smallest marks a parameter as poorly identified [Khalil2004]."""


@dataclass(frozen=True, eq=False, slots=True)
class Fit:
    """An estimate of b parameters from the rows of n joints.

    Attributes:
        names: Names of the parameters.
        values: Shape (b,).
        deviation: Standard deviations under white residuals, (2.44) to (2.46), shape (b,).
        covariance: What intervals are made of, shape (b, b).
        covariance_kind: `white` as an estimator gives it; `block` after `cover`: from the scatter between blocks of
            rows, which holds for residuals that are correlated within a block.
        freedom: Degrees of freedom of the intervals.
        residual_rms: Root mean square of each joint's residual in the band, shape (n,) [N·m or N].
        rows: Rows that counted, shape (n,).
        condition: Condition number of the stacked regressor as it is, (2.51).
        scaled_condition: The same with columns of unit length, which does not depend on units.
        weights: Weight of each joint's rows in the estimate, shape (n,); one each where not given.
    """

    names: tuple[str, ...]
    values: Array
    deviation: Array
    covariance: Array
    covariance_kind: str
    freedom: float
    residual_rms: Array
    rows: NDArray[np.int64]
    condition: float
    scaled_condition: float
    weights: Array = field(default_factory=lambda: np.ones(0))

    def __post_init__(self) -> None:
        b = len(self.names)
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "values", array(self.values, (b,), "values"))
        object.__setattr__(self, "deviation", array(self.deviation, (b,), "deviation"))
        object.__setattr__(self, "covariance", array(self.covariance, (b, b), "covariance"))
        weights = self.weights if np.size(self.weights) else np.ones(len(self.rows))
        object.__setattr__(self, "weights", array(weights, (len(self.rows),), "weights"))
        object.__setattr__(self, "residual_rms", array(self.residual_rms, (len(self.rows),), "residual_rms"))

    @property
    def intervals(self) -> Array:
        """Student's 95 % intervals of the parameters, shape (b, 2)."""
        from scipy.special import stdtrit  # a third of a second to import

        half = stdtrit(self.freedom, 0.975) * np.sqrt(np.diag(self.covariance))
        return np.stack([self.values - half, self.values + half], axis=1)

    @property
    def relative_deviation(self) -> Array:
        """Standard deviation over the value's size in percent, (2.47), shape (b,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return 100.0 * self.deviation / np.abs(self.values)

    @property
    def poorly_identified(self) -> NDArray[np.bool_]:
        """Parameters whose relative deviation is more than ten times the smallest, shape (b,)."""
        relative = self.relative_deviation
        return relative > POORLY_IDENTIFIED * np.nanmin(relative)
