"""Estimated standard parameters, each with what the data really say about it.

With H the information of the data and P that of the prior, both in standard parameters, the diagonal of

    (H + P)⁻¹ H

is the share of a parameter's value that the data bring; the rest is the prior's [Backus1968]. Base parameters are
what torques show, so that most standard ones are shared out by the prior or the cone alone, however good the data
are.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.maths.distributions import student_quantile
from armid.maths.linalg import half_of, inverse_of, orthonormal
from armid.model.parameter_name import ParameterName, parameter_names
from armid.notebook_display import Displayed, Summary, interval_text

Status = Literal["identified", "prior-dominated", "not identifiable"]

IDENTIFIED = 0.9
"""Share of the data from which on a parameter is identified: a tenth of the prior's value moves it by no more than a
tenth of what the prior is wrong."""

SEEN = 1e-9
"""Smallest singular value over the largest, columns of unit length, of what base parameters show of the unknowns."""

UNSEEN = 0.1
"""Share of the data below which a parameter is not identifiable: the data say next to nothing."""


@dataclass(frozen=True, slots=True)
class PriorTrial:
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
    trials: tuple[PriorTrial, ...] = ()


@dataclass(frozen=True, slots=True)
class Proof:
    """Certificate of a solution, computed from the answer and not from the solver's word.

    Attributes:
        price: By how much constraints and prior raise the weighted squared residual, over what noise makes of it.
        smallest_eigenvalue: Of all links' pseudo-inertias.
        lowest: Smallest value of the parameters that physics forbids to be negative.
        gap: Duality gap, relative.
    """

    price: float
    smallest_eigenvalue: float
    lowest: float
    gap: float


@dataclass(frozen=True, eq=False, slots=True)
class StandardMap:
    """Way from the uncertainty of b base parameters to that of p standard ones.

    Attributes:
        share: Change of each standard parameter with the base parameters, the least under the prior, shape (p, b).
        rest: Covariance that stays where base parameters are known, the prior's and the cone's, shape (p, p).
        shift: Way from the estimate to the middle of what can be, shape (p,).
        base_shift: The same in base parameters, shape (b,).
        bounded: What cannot be negative, shape (p,).
    """

    share: Array
    rest: Array
    shift: Array
    base_shift: Array
    bounded: Array

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
        names: Their names; friction of several recordings has copies, `FV_1[2]`.
        units: Their units.
        values: Shape (p,).
        covariance: Of what data and prior leave open, correlation of rows counted, shape (p, p).
        intervals: Student's 95 % intervals, cut where physics forbids values, shape (p, 2).
        resolution: Share of the data in each value, shape (p,).
        status: What that means, p of them.
        prior: The prior.
        proof: Checks of the solution.
        lift: How these follow from the base parameters' uncertainty, until that is settled; `None` afterwards.
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
        """Standard deviations of what data and prior leave open, shape (p,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def summary(self) -> Summary:
        """Parameters with intervals, and what the data say of each."""
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
    """Status of each parameter.

    Args:
        resolution: Share of the data, shape (p,).
        informed: Whether a prior says where parameters are that the data do not determine.
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
            result.append("prior-dominated" if informed and share >= UNSEEN else "not identifiable")
    return tuple(result)


def shares(information: Array, precision: Array) -> tuple[Array, Array]:
    """Covariance (H + P)⁻¹ and the diagonal of (H + P)⁻¹ H.

    Args:
        information: H, shape (p, p).
        precision: P, shape (p, p), positive definite.
    """
    inverse = inverse_of(information + precision)
    return inverse, np.clip(np.sum(inverse * information.T, axis=1), 0.0, 1.0)


def map_to_standard(
    precision: Array, regrouping: Array, basis: Array, correlation: float, shift: Array, bounded: Array
) -> StandardMap:
    """Return what a prior shares out among standard parameters when base parameters are known.

    With P the prior's precision and L the regrouping, known base parameters π leave θ with the mean G π, where
    G = P⁻¹Lᵀ(L P⁻¹Lᵀ)⁻¹, and the covariance P⁻¹ - G L P⁻¹: nothing for a parameter that stands alone. With H the
    information of the data, this is (LᵀHL + P)⁻¹ in two parts.

    Args:
        precision: P of the unknowns, in units of the weighted normal equations, shape (x, x).
        regrouping: L, shape (b, p).
        basis: Parameters (p,) that each unknown moves, shape (p, x).
        correlation: Rows that count as one independent sample.
        shift: Way from the estimate to the middle of what can be, shape (p,).
        bounded: What cannot be negative, shape (p,).
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
    """The fit with deviations and intervals that follow from the base parameters'.

    Args:
        fit: With its lift.
        scatter: Covariance of the base parameters that was learned from residuals, shape (b, b).
        known: What is added to it for certain, prior and torque scales, shape (b, b).
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
