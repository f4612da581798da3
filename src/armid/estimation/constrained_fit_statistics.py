"""Covariance, status and findings of an estimate of standard parameters with a prior and constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding
from armid.estimation.base_covariance import project_covariance
from armid.estimation.consistency.additional_constraints import Requirements, at_mass_limit
from armid.estimation.consistency.analytic_centre import AnalyticCentre, find_centre
from armid.estimation.consistency.cones import smallest_eigenvalues
from armid.estimation.crossvalidation import held_out_squares
from armid.estimation.fit_result import Fit
from armid.estimation.prior import INFORMED, Prior, weight_finding
from armid.estimation.problem import StandardParameters
from armid.estimation.standard_parameter_resolution import (
    FROM_NOISE,
    IDENTIFIED,
    ConeShift,
    PriorUse,
    Proof,
    StandardFit,
    StandardMap,
    map_to_standard,
    shares,
    stated,
    status_of,
)
from armid.estimation.uncertainty.prior_scale import link_covariances, prior_scales
from armid.estimation.uncertainty.scale_covariance import scale_covariance
from armid.estimation.whitened_system import WhitenedSystem
from armid.information.information import stack
from armid.maths.linalg import condition, inverse_of, scaled_condition
from armid.maths.median import median
from armid.remedy import Remedy, setting

PRICE = 0.05
"""Relative increase of the squared residual by prior and constraints above which a finding reports the increase.
Noise causes far less than 0.01."""

PUSHED = 2.0
"""Distance between the estimate of a parameter and the value that fits the data best, in standard deviations, above
which a finding names the parameter."""

AT_BOUND = 1e-3
"""Distance from a bound, in standard deviations, below which a parameter counts as at the bound."""

NAMED = 0.01
"""Component of an undetermined direction above which the finding names the parameter of this component; parameters
are scaled so that the columns have unit length."""

REMEDY = Remedy("use ", setting("method", "physical"), " for simulation or export.")

PHYSICAL = -1e-9
"""Most negative eigenvalue of a pseudo-inertia that counts as a rounding error of zero [kg and kg·m²]."""


@dataclass(frozen=True, eq=False, slots=True)
class PhysicalEstimate:
    """Estimate of standard parameters with a prior and constraints, as an estimator has computed it.

    Attributes:
        standard: The standard parameters.
        weighted: The whitened data.
        prior: The prior for weight 1; if the estimate has no prior, a prior that is suitable for any arm.
        use: Kind and weight of the prior in the estimate.
        values: The estimate, shape (p,).
        gap: Duality gap of the solution; NaN if the estimator computes none.
        basis: Derivative of the p parameters by the x unknowns, shape (p, x); the identity if not given.
        requirements: Requirements of the study on the parameters.
    """

    standard: StandardParameters
    weighted: WhitenedSystem
    prior: Prior
    use: PriorUse
    values: Array
    gap: float = float("nan")
    basis: Array = None  # pyright: ignore[reportAssignmentType]
    requirements: Requirements | None = None

    def __post_init__(self) -> None:
        if self.basis is None:  # pyright: ignore[reportUnnecessaryComparison]
            object.__setattr__(self, "basis", np.eye(len(self.values)))

    @property
    def base(self) -> Array:
        """Base parameters, shape (b,)."""
        return self.standard.regrouping @ self.values

    @property
    def is_informed(self) -> bool:
        """True if the prior determines the parameters that the data do not determine."""
        return self.use.kind in INFORMED

    @property
    def is_reduced(self) -> bool:
        """True if constraints make the number of unknowns smaller than the number of parameters."""
        return self.basis.shape[0] != self.basis.shape[1]


@dataclass(frozen=True, eq=False, slots=True)
class _Held:
    """Masks (p,) of parameters that constraints or the prior hold away from the values that fit the data best.

    Attributes:
        at_zero: Parameters at the bound zero.
        at_limit: Parameters at a limit that the study sets.
        inside: Parameters that are at no bound, whose values the prior or the consistency of the body holds away.
    """

    at_zero: NDArray[np.bool_]
    at_limit: NDArray[np.bool_]
    inside: NDArray[np.bool_]


def fit_of(estimate: PhysicalEstimate, findings: Sequence[Finding] = ()) -> Fit:
    """Makes the fit of an estimate, with covariance and findings.

    Args:
        estimate: The estimate.
        findings: Findings of the estimator, which are added to the fit.
    """
    data, values, basis = estimate.weighted, estimate.values, estimate.basis
    eigenvalues = smallest_eigenvalues(estimate.standard, values)
    prior = _prior_precision(estimate)
    centre = _centre(estimate, float(eigenvalues.min(initial=0.0)))
    feasible = prior if centre is None else basis.T @ centre.precision @ basis
    precision = None
    if centre is not None or estimate.is_informed or len(data.unseen) or estimate.is_reduced:
        precision = _base_precision(estimate, feasible)
    white = data.inverse if precision is None else inverse_of(data.rows.T @ data.rows + precision)
    whole, rows, unweighted = data.whole, data.whole.rows[0], stack(data.whole)[0]
    squares = held_out_squares(whole, estimate.base)
    known = scale_covariance(whole, data.weights, white)
    price = float(data.weights**2 @ (squares - data.squares)) / data.freedom
    lift = map_to_standard(
        feasible,
        estimate.standard.regrouping,
        basis,
        data.correlation,
        np.zeros(len(values)) if centre is None else centre.values - values,
        _bounded(estimate.standard),
    )
    if centre is not None:
        lift = replace(lift, cone=_cone_shift(estimate, prior))
    excess = _prior_excess(estimate)
    if excess is not None:
        lift = replace(lift, rest=lift.rest + _left_over(lift.share, estimate.standard.regrouping, excess))
        excess = estimate.standard.regrouping @ excess @ estimate.standard.regrouping.T
    standard, held = _standard_fit(estimate, prior, eigenvalues, price, lift)
    standard = stated(standard, data.correlation * white, known, np.full(whole.count, data.freedom))
    return Fit(
        whole.names,
        estimate.base,
        np.sqrt(np.diag(white)),
        white + known,
        "white",
        data.freedom,
        np.sqrt(squares / np.maximum(rows, 1)),
        rows,
        condition(unweighted),
        scaled_condition(unweighted),
        data.weights,
        prior_precision=precision,
        prior_correlation=data.correlation,
        prior_excess=excess,
        findings=(*findings, *estimate.prior.findings, *_findings(estimate, eigenvalues, price, held)),
        standard=standard,
    )


def _prior_precision(estimate: PhysicalEstimate) -> Array:
    """Precision (x, x) of the prior at the estimate, in units of the weighted normal equations."""
    weight = estimate.use.weight if estimate.is_informed else 1.0
    curvature = estimate.prior.curvature(estimate.standard, estimate.values, weight)
    return estimate.weighted.correlation * (estimate.basis.T @ curvature @ estimate.basis)


def _prior_excess(estimate: PhysicalEstimate) -> Array | None:
    """Covariance (p, p) that is added to that of the prior, because links differ more from the description.

    The result is `None` if the prior does not determine all parameters, or if constraints reduce the unknowns.
    """
    if not estimate.is_informed or estimate.is_reduced:
        return None
    standard, data, prior = estimate.standard, estimate.weighted, estimate.prior
    L = standard.regrouping
    precision = prior.curvature(standard, estimate.values, estimate.use.weight)
    links = link_covariances(precision, standard)
    others = np.setdiff1d(np.arange(len(precision)), standard.inertial)
    friction = project_covariance(precision[np.ix_(others, others)], L[:, others])
    # The strongest weight within one standard error predicts well; the best one says how far links are.
    trials = estimate.use.trials
    best = min(trials, key=lambda trial: trial.error).weight if trials else estimate.use.weight
    scales = prior_scales(
        data.rows,
        data.values - L @ prior.mean,
        L @ links @ L.T,
        friction,
        data.correlation,
        expected=estimate.use.weight / best,
    )
    return np.asarray(np.tensordot(scales - 1.0, links, 1), dtype=np.float64)


def _left_over(share: Array, regrouping: Array, excess: Array) -> Array:
    """Part of a covariance of the standard parameters in directions that do not change the base parameters, (p, p).

    Args:
        share: Derivative of the standard parameters by the base parameters, shape (p, b).
        regrouping: Matrix from standard to base parameters, shape (b, p).
        excess: The covariance, shape (p, p).
    """
    left = np.eye(len(share)) - share @ regrouping
    return left @ excess @ left.T


def _centre(estimate: PhysicalEstimate, lowest_eigenvalue: float) -> AnalyticCentre | None:
    """Analytic centre; `None` if the search finds none, or if the estimate is outside the cone."""
    standard, values = estimate.standard, estimate.values
    if min(lowest_eigenvalue, float(values[standard.nonnegative].min(initial=0.0))) < PHYSICAL:
        return None
    return find_centre(standard, estimate.weighted, estimate.prior, estimate.use, values, estimate.basis)


def _base_precision(estimate: PhysicalEstimate, precision: Array) -> Array:
    """Precision of the base parameters that prior and cone give, shape (b, b), from that of the unknowns (x, x)."""
    covariance = project_covariance(precision, estimate.standard.regrouping @ estimate.basis)
    if not estimate.is_reduced:
        return inverse_of(covariance)
    # What is given has no variance; a millionth of the others' stands for that.
    length = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    length = np.where(length > 0.0, length, median(length) if length.any() else 1.0)
    return inverse_of(covariance + 1e-6 * np.diag(length**2))


def _cone_shift(estimate: PhysicalEstimate, prior: Array) -> ConeShift | None:
    """Effect of the cone in addition to a Gaussian prior of precision `prior` (x, x); `None` for other priors."""
    if estimate.use.kind != "euclidean" or estimate.is_reduced:
        return None
    rows, precision = estimate.weighted.rows, _base_precision(estimate, prior)
    mean = estimate.standard.regrouping @ estimate.prior.mean
    normal = rows.T @ rows
    free = inverse_of(normal + precision) @ (normal @ estimate.weighted.values + precision @ mean)
    return ConeShift(precision, estimate.base - free)


def _bounded(standard: StandardParameters) -> Array:
    """Mask (p,) of the parameters that cannot be negative."""
    bounded = standard.nonnegative.astype(np.float64)
    bounded[standard.inertial[:, [0, 4, 6, 9]]] = 1.0  # mass and the moments of inertia about the axes
    return bounded


def _standard_fit(
    estimate: PhysicalEstimate, prior: Array, eigenvalues: Array, price: float, lift: StandardMap
) -> tuple[StandardFit, _Held]:
    """Makes the fit of the standard parameters, and the masks of the parameters that are held away from the best fit.

    Args:
        estimate: The estimate.
        prior: Precision of the prior, shape (x, x).
        eigenvalues: Smallest eigenvalue of each link's pseudo-inertia, shape (links,).
        price: Relative increase of the squared residual by prior and constraints.
        lift: Map from the covariance of the base parameters to that of the standard parameters.
    """
    standard, data, values, basis = estimate.standard, estimate.weighted, estimate.values, estimate.basis
    columns = data.rows @ standard.regrouping @ basis
    covariance, share = shares(columns.T @ columns, prior)
    spread, noise = basis @ covariance @ basis.T, basis @ covariance @ columns.T
    # A value that the data move may nevertheless depend on errors of the prior of other parameters.
    by_prior = np.sum(noise**2, axis=1) < FROM_NOISE * np.diag(spread)
    moves = basis != 0.0
    given, resolution = ~moves.any(axis=1), moves @ share
    held = _held(estimate, np.sqrt(np.maximum(np.diag(spread), 0.0)), given, resolution)
    lowest = float(values[standard.nonnegative].min(initial=np.inf))
    fit = StandardFit(
        standard.names,
        standard.units,
        values,
        data.correlation * spread,
        np.stack([values, values], axis=1),
        resolution,
        status_of(resolution, estimate.is_informed, given, held.at_zero | held.at_limit | held.inside | by_prior),
        estimate.use,
        Proof(price, float(eigenvalues.min(initial=np.inf)), lowest, estimate.gap),
        lift,
    )
    return fit, held


def _held(estimate: PhysicalEstimate, white: Array, given: NDArray[np.bool_], resolution: Array) -> _Held:
    """Masks of the parameters that are held away from the values that fit best.

    The masks do not contain parameters whose values the study gives.

    Args:
        estimate: The estimate.
        white: Standard deviations under white noise, shape (p,).
        given: Mask of the parameters that the study gives, shape (p,).
        resolution: Share of the data in each parameter's value, shape (p,).
    """
    standard, data, values = estimate.standard, estimate.weighted, estimate.values
    root = np.sqrt(data.correlation)
    # Gradient of the squared residuals, over what white noise makes of it.
    gradient = standard.regrouping.T @ (data.rows.T @ (data.rows @ (estimate.base - data.values))) * white
    at_bound = standard.nonnegative & (values <= AT_BOUND * np.maximum(root * white, np.finfo(np.float64).tiny))
    at_limit = _limited(estimate, root * white) & ~given
    far = np.zeros(len(values), dtype=np.bool_)
    far[standard.inertial] = np.abs(gradient[standard.inertial]) > PUSHED * root
    inside = far & (resolution >= IDENTIFIED) & ~given & ~at_limit
    return _Held(at_bound & (gradient > PUSHED) & ~given, at_limit, inside)


def _limited(estimate: PhysicalEstimate, deviation: Array) -> NDArray[np.bool_]:
    """Mask of parameters (p,) that are at a limit of the study, or that must equal a mass at a limit of the study."""
    if estimate.requirements is None:
        return np.zeros(len(estimate.values), dtype=bool)
    near = AT_BOUND * np.maximum(deviation, np.abs(estimate.values))
    at = at_mass_limit(estimate.standard, estimate.requirements, estimate.values, near)
    return np.asarray((estimate.basis != 0.0) @ (estimate.basis[at] != 0.0).any(axis=0), dtype=bool)


def _findings(estimate: PhysicalEstimate, eigenvalues: Array, price: float, held: _Held) -> list[Finding]:
    """Findings about inconsistent bodies, the weight of the prior, undetermined parameters, and held parameters.

    Args:
        estimate: The estimate.
        eigenvalues: Smallest eigenvalue of each link's pseudo-inertia, shape (links,).
        price: Relative increase of the squared residual by prior and constraints.
        held: Masks of the parameters that are held away from the values that fit the data best.
    """
    standard, data, use = estimate.standard, estimate.weighted, estimate.use
    findings: list[Finding] = []
    for own, smallest in zip(standard.inertial, eigenvalues, strict=True):
        if smallest < PHYSICAL:
            message = (
                "No real body can have the values of this link: its pseudo-inertia has the negative eigenvalue "
                f"{smallest:.2g}."
            )
            findings.append(Finding("not-physical", "warning", standard.names[own[0]], message, REMEDY))
    if estimate.is_informed:
        findings.append(weight_finding(f"{use.kind} prior", use.weight, use.how))
    if len(data.unseen):
        length = np.linalg.norm(stack(data.whole)[0], axis=0)
        part = np.abs(data.unseen * np.where(length > 0.0, length, 1.0)).max(axis=0)
        named = _listed(data.whole.names, part > NAMED)
        message = f"The data do not determine {len(data.unseen)} combinations of these base parameters: {named}."
        remedy = "record a motion that determines these parameters; with these data, the prior gives their values."
        findings.append(Finding("prior-dominated", "warning", "", message, remedy))
    if price > PRICE:
        message = f"Physical consistency and the prior increase the squared residual by {100.0 * price:.3g} %."
        remedy = (
            "add torque terms (key `terms`) that reduce the residuals, or reduce the option `weight` of the method, "
            "which is the weight of the prior. A wrong sign or a wrong gravity would be reported as a separate "
            "finding."
        )
        findings.append(Finding("price-of-consistency", "warning", "", message, remedy))
    far = f"more than {PUSHED:g} standard deviations from the values that fit the data best"
    for code, mask, message in (
        (
            "held-at-zero",
            held.at_zero,
            "Without the bound at zero, the estimates of these parameters would be negative",
        ),
        ("held-at-limit", held.at_limit, "These parameters are at limits that the study sets"),
        (
            "held-inside",
            held.inside,
            f"Physical consistency, the prior and the limits of the study hold these parameters {far}",
        ),
    ):
        if mask.any():
            findings.append(Finding(code, "info", "", f"{message}: {_listed(standard.names, mask)}."))
    return findings


def _listed(names: Sequence[str], mask: NDArray[np.bool_]) -> str:
    return ", ".join(name for name, is_listed in zip(names, mask, strict=True) if is_listed)
