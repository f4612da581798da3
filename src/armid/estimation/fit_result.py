"""Result of an estimator: values of the base parameters, and their covariance."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.checked_array import Array, array
from armid.errors import Finding
from armid.estimation.standard_parameter_resolution import StandardFit
from armid.information.information import Information
from armid.maths.distributions import student_quantile
from armid.model.parameter_name import ParameterName, parameter_names
from armid.notebook_display import Displayed, Summary, interval_text, percent

POORLY_IDENTIFIED = 20.0
"""Relative standard deviation above which a parameter counts as poorly identified [%]. The usual limit is ten
times the smallest relative deviation of all parameters [Khalil2004]. With that limit, nearly all parameters would
be poorly identified if one parameter is known very well."""


@dataclass(frozen=True, eq=False, slots=True)
class CovarianceReport:
    """Reason for the kind of a covariance, and properties of the noise.

    Attributes:
        why: Reason for the kind of the covariance, as text.
        parts: Number of blocks, periods or frequency bands from which the covariance was computed; 0 if it was not
            computed from such parts.
        whiteness: p-value of the test of whiteness of the residuals; `None` if this test was not made.
        noise: Standard deviation of the torque of each joint about the model, in the band, shape (n,) [N·m or N]. The
            interval of a measured torque includes this noise in addition to the uncertainty of the parameters. Empty
            if only the residual is known.
        moved: Change of the estimate if rows next to velocity reversals are left out, shape (b,); empty if not
            computed.
        reach: Factor f with which f · `moved` counts as one standard deviation: the covariance contains f² · moved
            movedᵀ.
        by_misfit: Part of the covariance by the misfit of the prior, shape (b, b); empty if not computed.
        by_systematic: Part of the covariance by systematic errors, shape (b, b); empty if not computed.
    """

    why: str = "as the estimator gave it"
    parts: int = 0
    whiteness: float | None = None
    noise: Array = field(default_factory=lambda: np.zeros(0))
    moved: Array = field(default_factory=lambda: np.zeros(0))
    reach: float = 0.0
    by_misfit: Array = field(default_factory=lambda: np.zeros((0, 0)))
    by_systematic: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        for name in ("noise", "moved"):
            object.__setattr__(self, name, array(getattr(self, name), (None,), name))
        for name in ("by_misfit", "by_systematic"):
            object.__setattr__(self, name, array(getattr(self, name), (None, None), name))

    def mapped(self, change: Array) -> CovarianceReport:
        """Report with parts of the covariance of k linear functions of the b parameters, given by a matrix (k, b)."""
        parts = {name: getattr(self, name) for name in ("by_misfit", "by_systematic")}
        return replace(self, **{name: change @ part @ change.T for name, part in parts.items() if part.size})


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Displayed):
    """Estimate of b parameters from the rows of n joints.

    Attributes:
        names: Names of the parameters.
        values: Values of the parameters, shape (b,).
        white_deviation: Standard deviations for white residuals, equations (2.44) to (2.46) of the thesis, shape
            (b,).
        covariance: Covariance from which the intervals are computed, shape (b, b).
        covariance_kind: Kind of the covariance: `white` in the result of an estimator; in the result of `estimate`
            also `period`, `spectral` or `block`.
        freedom: Degrees of freedom of the interval of each parameter, shape (b,), or one number for all.
        residual_rms: Root mean square of the residual of each joint in the band, shape (n,) [N·m or N].
        rows: Number of rows used for each joint, shape (n,).
        condition: Condition number of the stacked regressor without scaling, equation (2.51) of the thesis.
        scaled_condition: Condition number with columns of unit length, which does not depend on units.
        weights: Weight of the rows of each joint in the estimate, shape (n,); if not given, all weights are one.
        prior_precision: Precision of the Gaussian prior of the estimate, in base parameters and in the units of the
            weighted normal equations, shape (b, b); `None` if there is no prior.
        report: Reason for the kind of the covariance.
        dropped: Names of parameters that the estimator sets to zero.
        findings: Findings of the estimator.
        information: Factors from which the estimate was computed, if they differ from the given factors because the
            estimator has changed the rows, for instance by individual weights; otherwise `None`.
        standard: Standard parameters, if the estimator estimates them.
        prior_correlation: Number of rows that count as one independent sample in the weight of the prior. The
            covariance of the prior is the inverse of its precision times this number.
        prior_excess: Covariance (b, b) by which the prior is wider than its precision says, because the data
            contradict it; `None` for none.
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
    prior_excess: Array | None = field(default=None, repr=False)

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
        """Table of the parameters with standard deviations and intervals."""
        rows = tuple(
            (name, f"{value:.5g}", percent(relative), interval_text(low, high))
            for name, value, relative, (low, high) in zip(
                self.names, self.values, self.relative_deviation, self.intervals, strict=True
            )
        )
        note = f"intervals: {self.covariance_kind}, {self.report.why}; condition number {self.condition:.4g}"
        return Summary(f"{len(rows)} parameters", ("parameter", "value", "σ", "95 % interval"), rows, note)

    @cached_property
    def intervals(self) -> Array:
        """95 % intervals of the parameters by Student's t distribution, shape (b, 2)."""
        half = student_quantile(self.freedom) * self.deviation
        intervals = np.stack([self.values - half, self.values + half], axis=1)
        intervals.setflags(write=False)
        return intervals

    @property
    def deviation(self) -> Array:
        """Standard deviations of the parameters, from the covariance that gives the intervals, shape (b,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def noise(self) -> Array:
        """Standard deviation of the torque of each joint about the model, in the band, shape (n,) [N·m or N]."""
        return self.report.noise if len(self.report.noise) else self.residual_rms

    @property
    def relative_deviation(self) -> Array:
        """Standard deviation of each parameter divided by its absolute value [%], shape (b,).

        This is equation (2.47) of the thesis.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            return 100.0 * self.deviation / np.abs(self.values)

    @property
    def poorly_identified(self) -> NDArray[np.bool_]:
        """Mask of the parameters whose relative deviation is above `POORLY_IDENTIFIED`, shape (b,)."""
        return self.relative_deviation > POORLY_IDENTIFIED


def _for_each(value: ArrayLike, count: int) -> ArrayLike:
    """Repeats a single number `count` times; an array with `count` values is returned unchanged."""
    return np.full(count, value) if np.ndim(value) == 0 else value
