"""Result of an estimator: values of the base parameters and how well the data determine them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.errors import Finding
from armid.estimation.standard_parameter_status import StandardFit
from armid.information.information import Information
from armid.maths.distributions import student_quantile
from armid.model.parameter_name import ParameterName, parameter_names
from armid.notebook import Displayed, Summary, percent
from armid.values import Array, array

POORLY_IDENTIFIED = 20.0
"""Relative deviation above which a parameter counts as poorly identified [%]. The rule of ten times the smallest
[Khalil2004] condemns nearly all parameters where one is known very well."""


@dataclass(frozen=True, eq=False, slots=True)
class CovarianceReport:
    """Reason for the kind of a covariance, and what was seen of the noise on the way.

    Attributes:
        why: The reason in words.
        parts: Blocks, periods or frequency bands that the covariance was made from; 0 for none.
        whiteness: Probability of residuals as far from white as these, if they were white; `None` where not tested.
        noise: Standard deviation of a joint's torque about the model, in the band, shape (n,) [N·m or N]: what a band
            for a measured torque adds to the parameters' share. Empty where nothing but the residual is known.
        moved: What leaving rows next to reversals out would move the estimate by, shape (b,); empty where that was
            not looked for.
        reach: Share of the move that counts as a deviation: the covariance has reach² moved movedᵀ in it.
    """

    why: str = "as the estimator gave it"
    parts: int = 0
    whiteness: float | None = None
    noise: Array = field(default_factory=lambda: np.zeros(0))
    moved: Array = field(default_factory=lambda: np.zeros(0))
    reach: float = 0.0

    def __post_init__(self) -> None:
        for name in ("noise", "moved"):
            object.__setattr__(self, name, array(getattr(self, name), (None,), name))


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Fit(Displayed):
    """An estimate of b parameters from the rows of n joints.

    Attributes:
        names: Names of the parameters.
        values: Shape (b,).
        white_deviation: Standard deviations under white residuals, (2.44) to (2.46), shape (b,).
        covariance: What intervals are made of, shape (b, b).
        covariance_kind: How it was made: `white` as an estimator solves, from `estimate` also `period`, `spectral`
            or `block`.
        freedom: Degrees of freedom of each parameter's interval, shape (b,); one number stands for all.
        residual_rms: Root mean square of each joint's residual in the band, shape (n,) [N·m or N].
        rows: Rows that counted, shape (n,).
        condition: Condition number of the stacked regressor as it is, (2.51).
        scaled_condition: The same with columns of unit length, which does not depend on units.
        weights: Weight of each joint's rows in the estimate, shape (n,); one each where not given.
        prior_precision: Precision of the Gaussian prior that the estimate was made with, in base parameters and in
            the units of the weighted normal equations, shape (b, b); `None` for none.
        report: Why the covariance is of its kind.
        dropped: Names of parameters that the estimator holds at zero.
        findings: What the estimator noticed on the way.
        information: The factors that the estimate was really made from, where an estimator changed their rows, as by
            weights of its own for each; `None` where they are those it was given.
        standard: Standard parameters, where the estimator estimates them.
        prior_correlation: Rows that count as one independent sample of the prior's weight: it errs by its precision's
            inverse times so much, as the data do.
    """

    names: tuple[ParameterName, ...]
    values: Array
    white_deviation: Array = field(metadata={"stored": "deviation"})
    covariance: Array
    covariance_kind: str
    freedom: Array | float
    residual_rms: Array
    rows: NDArray[np.int64]
    condition: float
    scaled_condition: float
    weights: Array = field(default_factory=lambda: np.ones(0))
    prior_precision: Array | None = None
    report: CovarianceReport = field(default_factory=CovarianceReport)
    dropped: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    information: Information | None = field(default=None, repr=False)
    standard: StandardFit | None = None
    prior_correlation: float = 1.0

    def __post_init__(self) -> None:
        b, n = len(self.names), len(self.rows)
        object.__setattr__(self, "names", parameter_names(self.names))
        object.__setattr__(self, "values", array(self.values, (b,), "values"))
        object.__setattr__(self, "white_deviation", array(self.white_deviation, (b,), "white_deviation"))
        object.__setattr__(self, "covariance", array(self.covariance, (b, b), "covariance"))
        object.__setattr__(self, "freedom", array(_for_each(self.freedom, b), (b,), "freedom"))
        weights = self.weights if np.size(self.weights) else np.ones(n)
        object.__setattr__(self, "weights", array(weights, (n,), "weights"))
        object.__setattr__(self, "residual_rms", array(self.residual_rms, (n,), "residual_rms"))
        if self.prior_precision is not None:
            object.__setattr__(self, "prior_precision", array(self.prior_precision, (b, b), "prior_precision"))

    def summary(self) -> Summary:
        """Parameters with deviations and intervals."""
        rows = tuple(
            (name, f"{value:.5g}", percent(relative), f"{low:.5g} … {high:.5g}")
            for name, value, relative, (low, high) in zip(
                self.names, self.values, self.relative_deviation, self.intervals, strict=True
            )
        )
        note = f"intervals: {self.covariance_kind}, {self.report.why}; condition number {self.condition:.4g}"
        return Summary(f"{len(rows)} parameters", ("parameter", "value", "σ", "95 % interval"), rows, note)

    @property
    def intervals(self) -> Array:
        """Student's 95 % intervals of the parameters, shape (b, 2)."""
        half = student_quantile(self.freedom) * self.deviation
        return np.stack([self.values - half, self.values + half], axis=1)

    @property
    def deviation(self) -> Array:
        """Standard deviations of the parameters by the covariance, as in the intervals, shape (b,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def noise(self) -> Array:
        """Standard deviation of each joint's torque about the model, in the band, shape (n,) [N·m or N]."""
        return self.report.noise if len(self.report.noise) else self.residual_rms

    @property
    def relative_deviation(self) -> Array:
        """Standard deviation over the value's size in percent, (2.47), shape (b,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return 100.0 * self.deviation / np.abs(self.values)

    @property
    def poorly_identified(self) -> NDArray[np.bool_]:
        """Parameters whose relative deviation is above `POORLY_IDENTIFIED`, shape (b,)."""
        return self.relative_deviation > POORLY_IDENTIFIED


def _for_each(value: ArrayLike, count: int) -> ArrayLike:
    """One number for each of so many parameters."""
    return np.full(count, value) if np.ndim(value) == 0 else value
