"""Least squares with a Gaussian prior on the base parameters.

    minimise |W (y - A π)|² + λ (π - π₀)ᵀ P (π - π₀)

Here π are the base parameters, W contains the weights of the rows, A and y are the factors and their right-hand side,
and λ is the weight of the prior. The mean π₀ of the prior is zero, or the base parameters of the bodies in the
description. The precision P of the prior follows from the log-det divergence of the standard parameters
(`armid.estimation.prior`), approximated to second order. A change of all parameters of a link by 100 % then has the
same cost for large and small links. With a factor C of P = CᵀC and the singular value decomposition U S Vᵀ = W A C⁻¹,
the solution for each λ is one product, π = π₀ + C⁻¹ V S (S² + λ)⁻¹ Uᵀ W (y - A π₀), so the cross-validation of λ
takes a few milliseconds.

If the data hardly determine a direction of the parameters, the prior keeps the estimate near the description. Unlike
the estimator `physical`, it does not make the bodies physically consistent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError, Finding, did_you_mean
from armid.estimation.crossvalidation import folds, held_out_error, held_out_squares, split
from armid.estimation.fit_result import Fit
from armid.estimation.least_squares import solve
from armid.estimation.prior import GIVEN, make_prior, project_covariance, weight_finding
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.covariance import scale_covariance
from armid.estimation.whitened_system import WhitenedSystem, rows_of, whiten
from armid.information.information import Information, stack
from armid.maths.linalg import condition, scaled_condition
from armid.threads import one_blas_thread

STRENGTHS = np.concatenate([np.logspace(6.0, -4.0, 31), [0.0]])
"""Weights of the prior that are tried, in independent samples, the largest first. The largest one keeps links
within about 0.1 % of the description; the smallest one that is not zero, within a factor of 100."""

DOMINATED = 0.5
"""Share of the value of a parameter that comes from the prior, above which a finding names the parameter."""


@dataclass(frozen=True, slots=True)
class Ridge:
    """Weighted least squares with a prior, which determines the parameters that the data hardly determine.

    Attributes:
        towards: Mean of the prior: `nominal`, the inertial parameters of the description; `zero`; or `auto`, which is
            `nominal` if the description gives every link a mass.
        weight: Number of independent samples to which the prior is equivalent; with `auto` it is found by
            cross-validation with blocks.
    """

    towards: Literal["auto", "nominal", "zero"] = "auto"
    weight: float | Literal["auto"] = "auto"
    name: ClassVar[str] = "ridge"
    quick: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.towards not in ("auto", "nominal", "zero"):
            raise EstimationError(
                f"The option `towards` has the unknown value {self.towards!r}.",
                possible="auto, nominal, zero",
                remedy=did_you_mean(self.towards, ("auto", "nominal", "zero")),
            )
        if self.weight != "auto" and not 0.0 <= self.weight < np.inf:
            raise EstimationError(
                f"The option `weight` must be at least 0; found {self.weight!r}.",
                possible="auto, a number",
                remedy='use "auto", which finds the weight from the data.',
            )

    @one_blas_thread
    def solve(self, problem: EstimationProblem) -> Fit:
        """Estimates the base parameters, with standard deviations for white residuals.

        Raises:
            EstimationError: The weight is zero and the data do not determine all parameters, or the prior needs
                inertial parameters that the description lacks.
        """
        weighted = whiten(problem.information)
        prior = self._prior(problem, weighted)
        if self.weight == "auto":
            weight, how = _chosen(problem.information, weighted, prior)
        else:
            weight, how = float(self.weight), GIVEN
        if weight == 0.0:
            solve(problem.information, weighted.weights)  # raises where the data do not determine the parameters
        return _fit(weighted, prior, weight, how)

    def with_prior_of(self, problem: EstimationProblem, fit: Fit) -> Ridge:
        """Copy of this estimator with the weight that cross-validation finds on the data of a problem.

        A weight that is already a number is kept. `fit` is not used: the weight is found again from the data.
        """
        del fit
        if self.weight != "auto":
            return self
        weighted = whiten(problem.information)
        return replace(self, weight=_chosen(problem.information, weighted, self._prior(problem, weighted))[0])

    def _prior(self, problem: EstimationProblem, weighted: WhitenedSystem) -> _Prior:
        """Mean and precision of the base parameters for weight 1."""
        standard = problem.require_standard(self.name)
        towards = self.towards
        if towards == "auto":
            towards = "nominal" if standard.described else "zero"
        at, copy = _places(problem)
        L = standard.regrouping[at]
        belief = make_prior("log-det" if towards == "nominal" else "mass", replace(standard, regrouping=L), weighted)
        covariance = project_covariance(belief.precision, L)
        covariance *= copy[:, None] == copy[None, :]  # recordings have independent friction
        return _Prior(towards, L @ belief.mean, covariance / weighted.correlation, belief.findings)


@dataclass(frozen=True, eq=False, slots=True)
class _Prior:
    """Prior of the b base parameters: mean (b,) and covariance (b, b), in units of the weighted normal equations."""

    towards: str
    mean: Array
    covariance: Array
    findings: tuple[Finding, ...]


def _places(problem: EstimationProblem) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Base parameter and recording of each parameter of the information, shape (parameters,) each.

    Base parameters are given by index. The recording is 2 for the copy `FV_1[2]`, and 0 for a common parameter.
    """
    names = problem.information.names
    copy = np.array([name.recording or 0 for name in names], dtype=np.intp)
    if problem.base is None:
        return np.arange(len(names)), copy
    index = {name: k for k, name in enumerate(problem.base.names)}
    return np.array([index[name.of_all] for name in names], dtype=np.intp), copy


class _Path:
    """Estimates as a function of the weight of the prior, from whitened rows."""

    def __init__(self, rows: Array, side: Array, prior: _Prior) -> None:
        self.mean = prior.mean
        self.root = np.linalg.cholesky(prior.covariance)  # C⁻¹ up to a rotation, which has no effect
        U, self.sizes, Vt = np.linalg.svd(rows @ self.root, full_matrices=True)
        self.turned = self.root @ Vt.T
        self.sizes = np.concatenate([self.sizes, np.zeros(Vt.shape[0] - len(self.sizes))])
        projection = (U.T @ (side - rows @ prior.mean))[: len(self.sizes)]
        self.projection = np.concatenate([projection, np.zeros(len(self.sizes) - len(projection))])

    def values(self, weight: float) -> Array:
        """The estimate (b,) for a weight of the prior."""
        return self.mean + self.turned @ (self.sizes * self.projection / (self.sizes**2 + weight))

    def covariance(self, weight: float) -> Array:
        """Inverse normal matrix (H + λ P)⁻¹, shape (b, b), for a weight λ of the prior.

        H is the normal matrix of the data and P the precision of the prior.
        """
        return (self.turned / (self.sizes**2 + weight)) @ self.turned.T


def _chosen(information: Information, weighted: WhitenedSystem, prior: _Prior) -> tuple[float, str]:
    """Weight with the smallest error on held-out folds, and a text that says how this weight was found."""
    candidates = STRENGTHS[:-1] if len(weighted.unseen) else STRENGTHS
    parts = split(information, folds(information))
    if not parts:
        return 1.0, "one sample, because there are too few blocks for cross-validation"
    errors = np.full((len(candidates), len(parts)), np.inf)
    for f, part in enumerate(parts):
        path = _Path(*rows_of(part.training, weighted.weights), prior)
        for k, weight in enumerate(candidates):
            if weight > 0.0 or path.sizes.min() > 0.0:
                errors[k, f] = held_out_error(part.held_out, path.values(float(weight)), weighted.weights)
    return float(candidates[int(np.argmin(errors.mean(axis=1)))]), f"chosen on {len(parts)} held-out folds of blocks"


def _fit(weighted: WhitenedSystem, prior: _Prior, weight: float, how: str) -> Fit:
    """Makes the fit for a weight of the prior.

    Args:
        weighted: The whitened data.
        prior: The prior.
        weight: Weight of the prior.
        how: Text that says how the weight was found.
    """
    whole, weights = weighted.whole, weighted.weights
    path = _Path(*rows_of(whole, weights), prior)
    values, white = path.values(weight), path.covariance(weight)
    precision = weight * np.linalg.inv(prior.covariance)
    precision = 0.5 * (precision + precision.T)
    share = np.diag(white @ precision)
    unweighted = stack(whole)[0]
    rows = whole.rows[0]
    return Fit(
        whole.names,
        values,
        np.sqrt(np.diag(white)),
        white + scale_covariance(whole, weights, white),
        "white",
        max(float(rows.sum()) - len(values) + float(share.sum()), 1.0),
        np.sqrt(held_out_squares(whole, values) / np.maximum(rows, 1)),
        rows,
        condition(unweighted),
        scaled_condition(unweighted),
        weights,
        prior_precision=precision if weight else None,
        prior_correlation=weighted.correlation,
        findings=(*prior.findings, *_findings(whole.names, prior.towards, weight, how, share)),
    )


def _findings(names: tuple[str, ...], towards: str, weight: float, how: str, share: Array) -> list[Finding]:
    """Findings about the weight of the prior, and about parameters that depend more on the prior than on the data."""
    mean = "the description" if towards == "nominal" else "zero"
    findings = [weight_finding(f"prior towards {mean}", weight, how)]
    dominated = [name for name, part in zip(names, share, strict=True) if part > DOMINATED]
    if dominated:
        message = f"These parameters are determined more by the prior than by the data: {', '.join(dominated)}."
        findings.append(
            Finding("prior-dominated", "warning", "", message, "record a motion that excites these parameters.")
        )
    return findings
