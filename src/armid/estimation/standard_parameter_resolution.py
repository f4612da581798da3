"""Estimated standard parameters, and for each parameter the share of the value that the data determine.

With H the normal matrix of the data and P the precision of the prior, both in standard parameters, the diagonal of

    (H + P)⁻¹ H

is the share of a parameter's value that comes from the data; the rest comes from the prior [Backus1968]. Its variance
is the sum of (H + P)⁻¹ H (H + P)⁻¹, which comes from the noise of the data, and of (H + P)⁻¹ P (H + P)⁻¹. Torques
determine only base parameters. Therefore the values of most standard parameters depend on the prior or the cone, even
if the data are good.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.maths.distributions import student_quantile
from armid.maths.linalg import half_of, inverse_of, orthonormal
from armid.model.parameter_name import ParameterName, parameter_names
from armid.notebook_display import Displayed, Summary, interval_text

Status = Literal["identified", "prior-dominated", "not identifiable"]

NOT_JUDGED = "that of one sample, because there are too few blocks for cross-validation"
"""Text for the origin of the weight of a prior, if there are too few blocks to choose a weight by
cross-validation."""

IDENTIFIED = 0.9
"""Smallest share of a parameter's value that must come from the data for the status `identified`. At most a tenth of
an error of the prior of this parameter then enters the value."""

FROM_NOISE = 0.5
"""Smallest share of a parameter's variance that must come from the noise of the data for the status `identified`.
With a smaller share, most of the variance comes from the prior, also from the prior of other parameters. On an iiwa
14 and a UR10e, all parameters that fulfil the condition of `IDENTIFIED` had a share below 0.43 or above 0.76."""

SEEN = 1e-9
"""Smallest ratio of a singular value to the largest one, for columns of unit length, with which the combination of
base parameters of this singular value counts as dependent on the unknowns."""

UNSEEN = 0.1
"""Share of a parameter's value that comes from the data below which the status is `not identifiable`: the data have
almost no effect on the value."""


@dataclass(frozen=True, slots=True)
class PriorTrial:
    """Weight of a prior that was tried, with the held-out error.

    Attributes:
        weight: Number of independent samples of each joint to which the prior is equivalent.
        error: Held-out error: mean over folds and joints of log(held-out variance / variance of the residual).
    """

    weight: float
    error: float


@dataclass(frozen=True, slots=True)
class PriorUse:
    """Kind and weight of the prior of an estimate.

    Attributes:
        kind: `mass`, `log-det`, `euclidean` or `none`.
        weight: Number of independent samples of each joint to which the prior is equivalent; 0 if the kind has no
            weight.
        how: Text that says how the weight was found.
        correlation: Number of rows that count as one independent sample.
        trials: Weights that were tried, with their errors.
    """

    kind: str
    weight: float
    how: str
    correlation: float
    trials: tuple[PriorTrial, ...] = ()


@dataclass(frozen=True, slots=True)
class Proof:
    """Certificate of a solution, computed from the values of the parameters and not from the solver's status.

    Attributes:
        cost_increase: Increase of the weighted squared residual by constraints and prior, divided by its value
            without them.
        smallest_eigenvalue: Smallest eigenvalue of the pseudo-inertias of all links.
        lowest: Smallest value among the parameters that cannot be negative, such as friction.
        gap: Duality gap of the solution, divided by the objective.
    """

    cost_increase: float = field(metadata={"stored": "price"})
    smallest_eigenvalue: float
    lowest: float
    gap: float


@dataclass(frozen=True, eq=False, slots=True)
class ConeShift:
    """Effect of the cone on b base parameters, in addition to the effects of the data and of a Gaussian prior.

    Attributes:
        precision: Precision of the base parameters that the prior alone gives, without the cone, shape (b, b).
        shift: Difference between the estimate and the one without the cone, shape (b,).
    """

    precision: Array
    shift: Array


@dataclass(frozen=True, eq=False, slots=True)
class StandardMap:
    """Map from the covariance of b base parameters to the covariance of p standard parameters.

    Attributes:
        share: Derivative of the standard parameters by the base parameters, shape (p, b). Many standard parameters
            have the same base parameters; the prior selects those to which the derivative belongs.
        rest: Covariance of the standard parameters if the base parameters are known exactly, shape (p, p); it follows
            from prior and cone.
        shift: Difference between the analytic centre of the feasible set and the estimate, shape (p,).
        base_shift: Difference between the analytic centre and the estimate in base parameters, shape (b,).
        bounded: 1 for parameters that cannot be negative, otherwise 0, shape (p,).
        cone: Effect of the cone in addition to a Gaussian prior; `None` if there is no such prior.
    """

    share: Array
    rest: Array
    shift: Array
    base_shift: Array
    bounded: Array
    cone: ConeShift | None = None

    def __post_init__(self) -> None:
        p, b = np.shape(self.share)
        for name in ("shift", "bounded"):
            object.__setattr__(self, name, array(getattr(self, name), (p,), name))
        object.__setattr__(self, "rest", array(self.rest, (p, p), "rest"))
        object.__setattr__(self, "share", array(self.share, (p, b), "share"))
        object.__setattr__(self, "base_shift", array(self.base_shift, (b,), "base_shift"))


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class StandardFit(Displayed):
    """Estimate of p standard parameters.

    Attributes:
        names: Names of the parameters. If recordings have separate friction, there is one copy for each recording,
            such as `FV_1[2]` for recording 2.
        units: Units of the parameters.
        values: Estimated values, shape (p,).
        covariance: Covariance of the values that follows from data and prior, corrected for the correlation of rows,
            shape (p, p).
        intervals: 95 % intervals by Student's t distribution, without negative values where physics forbids them,
            shape (p, 2).
        resolution: Share of each value that comes from the data, shape (p,).
        status: Status of each parameter: `identified`, `prior-dominated` or `not identifiable`.
        prior: Kind and weight of the prior.
        proof: Certificate of the solution.
        lift: Map from the covariance of the base parameters to covariance and intervals of the standard parameters;
            `None` if covariance and intervals are already final.
    """

    names: tuple[ParameterName, ...]
    units: tuple[str, ...]
    values: Array
    covariance: Array
    intervals: Array
    resolution: Array
    status: tuple[str, ...]
    prior: PriorUse
    proof: Proof
    lift: StandardMap | None = None

    def __post_init__(self) -> None:
        p = len(self.names)
        object.__setattr__(self, "names", parameter_names(self.names))
        for name in ("units", "status"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for name in ("values", "resolution"):
            object.__setattr__(self, name, array(getattr(self, name), (p,), name))
        object.__setattr__(self, "covariance", array(self.covariance, (p, p), "covariance"))
        object.__setattr__(self, "intervals", array(self.intervals, (p, 2), "intervals"))

    @property
    def deviation(self) -> Array:
        """Standard deviations of the values, shape (p,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def summary(self) -> Summary:
        """Table of the parameters with values, intervals and status."""
        rows = tuple(
            (name, f"{value:.5g}", unit, "–" if said == "not identifiable" else interval_text(low, high), said)
            for name, value, unit, (low, high), said in zip(
                self.names, self.values, self.units, self.intervals, self.status, strict=True
            )
        )
        return Summary(f"{len(rows)} standard parameters", ("parameter", "value", "unit", "95 % interval", ""), rows)


def status_of(
    resolution: Array, informed: bool, given: NDArray[np.bool_], held: NDArray[np.bool_]
) -> tuple[Status, ...]:
    """Status of each standard parameter: `identified`, `prior-dominated` or `not identifiable`.

    Args:
        resolution: Share of each value that comes from the data, shape (p,).
        informed: True if the prior gives values for parameters that the data do not determine.
        given: Mask of the parameters whose value the study gives, shape (p,).
        held: Mask of the parameters that a constraint or the prior holds away from the value that fits best, or whose
            variance comes mostly from the prior, shape (p,).
    """
    result: list[Status] = []
    for share, is_given, is_held in zip(resolution, given, held, strict=True):
        if is_given:
            result.append("prior-dominated")
        elif share >= IDENTIFIED:
            result.append("prior-dominated" if is_held else "identified")
        else:
            result.append("prior-dominated" if informed and share >= UNSEEN else "not identifiable")
    return tuple(result)


def shares(information: Array, precision: Array) -> tuple[Array, Array]:
    """Covariance (H + P)⁻¹ of the parameters, and the diagonal of (H + P)⁻¹ H: the shares that come from the data.

    Args:
        information: Normal matrix H of the data, shape (p, p).
        precision: Precision P of the prior, positive definite, shape (p, p).
    """
    inverse = inverse_of(information + precision)
    return inverse, np.clip(np.sum(inverse * information.T, axis=1), 0.0, 1.0)


def map_to_standard(
    precision: Array, regrouping: Array, basis: Array, correlation: float, shift: Array, bounded: Array
) -> StandardMap:
    """Computes how mean and covariance of the standard parameters follow from the base parameters and a prior.

    Let P be the precision of the prior and L the regrouping. If the base parameters π are known exactly, the standard
    parameters θ have the mean G π with G = P⁻¹Lᵀ(L P⁻¹Lᵀ)⁻¹, and the covariance P⁻¹ - G L P⁻¹. This covariance is
    zero for a standard parameter that is also a base parameter. If π is estimated from data with the normal matrix H,
    its covariance adds a second part, and the sum of the two parts is (LᵀHL + P)⁻¹.

    Args:
        precision: Precision P of the x unknowns, in units of the weighted normal equations, shape (x, x).
        regrouping: Matrix L from standard to base parameters, shape (b, p).
        basis: Derivative of the parameters by the unknowns, shape (p, x).
        correlation: Number of rows that count as one independent sample.
        shift: Difference between the analytic centre of the feasible set and the estimate, shape (p,).
        bounded: 1 for parameters that cannot be negative, otherwise 0, shape (p,).
    """
    half = half_of(precision)
    shown, spread = half.T @ (regrouping @ basis).T, half.T @ basis.T
    length = np.linalg.norm(shown, axis=0)
    length = np.where(length > 0.0, length, 1.0)
    clear = orthonormal(shown / length)
    if clear is not None:
        known, _, back = clear
    else:
        U, s, V = np.linalg.svd(shown / length, full_matrices=False)
        seen = s > SEEN * max(float(s.max(initial=0.0)), np.finfo(np.float64).tiny)
        known, back = U[:, seen], V[seen].T / s[seen]
    within = known.T @ spread
    share = within.T @ back.T / length
    left = spread - known @ within
    return StandardMap(share, correlation * (left.T @ left), shift, regrouping @ shift, bounded)


def stated(fit: StandardFit, scatter: Array, known: Array, freedom: Array) -> StandardFit:
    """Computes covariance and intervals of standard parameters from the covariance of the base parameters.

    Args:
        fit: Estimate of the standard parameters with the map `lift`; without it, the fit is returned unchanged.
        scatter: Covariance of the base parameters that was estimated from residuals, shape (b, b).
        known: Covariance of the base parameters that is not estimated from residuals but follows from prior and
            torque scales, shape (b, b).
        freedom: Degrees of freedom of the scatter of each base parameter, shape (b,).
    """
    own = fit.lift
    if own is None:
        return fit
    scattered = own.share @ scatter @ own.share.T
    settled = own.share @ known @ own.share.T + own.rest + np.outer(own.shift, own.shift)
    learned, certain = np.maximum(np.diag(scattered), 0.0), np.maximum(np.diag(settled), 0.0)
    part = own.share**2 * np.diag(scatter)
    whole = part.sum(axis=1)
    free = np.where(whole > 0.0, part @ freedom / np.where(whole > 0.0, whole, 1.0), np.inf)
    # What is known for certain has no degrees of freedom to pay for [Satterthwaite1946].
    free = free * (1.0 + certain / np.where(learned > 0.0, learned, 1.0)) ** 2
    deviation = np.sqrt(learned + certain)
    half = student_quantile(np.where(learned > 0.0, free, np.inf)) * deviation
    ends = np.stack([fit.values - half, fit.values + half], axis=1)
    ends[own.bounded > 0.0] = np.maximum(ends[own.bounded > 0.0], 0.0)
    covariance = scattered + settled
    return replace(fit, covariance=0.5 * (covariance + covariance.T), intervals=ends)
