"""Least squares with a Gaussian prior on the base parameters.

    minimise |W (y - A π)|² + (π - π₀)ᵀ (B / λ + F)⁻¹ (π - π₀)

Here π are the base parameters, W contains the weights of the rows, A and y are the factors and their right-hand side,
and λ is the weight of the prior. The mean π₀ of the prior is zero, or the base parameters of the bodies in the
description. The covariances B of bodies and F of other parameters (friction, offsets, rotor inertia) follow from the
prior of the standard parameters (`armid.estimation.prior`). For each link, the inverse of B is the second-order
approximation of the log-det divergence. A change of all parameters of a link by 100 % then has the same cost for
large and small links. The weight belongs to the bodies alone, because a description says nothing about friction. With
B + F = K Kᵀ and M = K V, where V are the eigenvectors of K⁻¹ B K⁻ᵀ and d its eigenvalues, the covariance for each λ
is M diag(d / λ + 1 - d) Mᵀ, so the cross-validation of λ needs one small factorisation for each weight.

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
from armid.estimation.base_covariance import BaseCovariance, base_covariance
from armid.estimation.crossvalidation import folds, held_out_error, held_out_squares, split
from armid.estimation.fit_result import Fit
from armid.estimation.least_squares import solve
from armid.estimation.prior import (
    GIVEN,
    make_prior,
    shrinkage_option,
    weight_finding,
)
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.prior_scale import link_covariances, prior_scales
from armid.estimation.uncertainty.scale_covariance import scale_covariance
from armid.estimation.whitened_system import WhitenedSystem, noise_option, rows_of, whiten
from armid.information.information import Information, stack
from armid.maths.linalg import condition, root_of, scaled_condition
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
        noise: Standard deviation of each joint's noise, from which the weights of the rows are computed; if not
            given, the standard deviation of the residual is used.
        shrinkage: Pull towards zero of friction beyond viscous and Coulomb friction, as a share of the information in
            the part of its column that the other columns do not explain.
    """

    towards: Literal["auto", "nominal", "zero"] = "auto"
    weight: float | Literal["auto"] = "auto"
    noise: tuple[float, ...] = ()
    shrinkage: float = 0.0
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
        object.__setattr__(self, "noise", noise_option(self.noise))
        object.__setattr__(self, "shrinkage", shrinkage_option(self.shrinkage))

    @one_blas_thread
    def solve(self, problem: EstimationProblem) -> Fit:
        """Estimates the base parameters, with standard deviations for white residuals.

        Raises:
            EstimationError: The weight is zero and the data do not determine all parameters, or the prior needs
                inertial parameters that the description lacks.
        """
        weighted = whiten(problem.information, noise=self.noise)
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
        weighted = whiten(problem.information, noise=self.noise)
        return replace(self, weight=_chosen(problem.information, weighted, self._prior(problem, weighted))[0])

    def _prior(self, problem: EstimationProblem, weighted: WhitenedSystem) -> _Prior:
        """Prior of the base parameters for weight 1: mean and covariance."""
        standard = problem.require_standard(self.name)
        towards = self.towards
        if towards == "auto":
            towards = "nominal" if standard.described else "zero"
        at, copy = _places(problem)
        L = standard.regrouping[at]
        kind = "log-det" if towards == "nominal" else "mass"
        belief = make_prior(kind, replace(standard, regrouping=L), weighted, shrinkage=self.shrinkage)
        covariance = base_covariance(belief, replace(standard, regrouping=L))
        alike = (copy[:, None] == copy[None, :]) / weighted.correlation  # recordings have independent friction
        own = BaseCovariance(covariance.bodies * alike, covariance.others * alike)
        links = L @ link_covariances(belief.precision, standard) @ L.T / weighted.correlation
        return _Prior(towards, L @ belief.mean, own, links, belief.findings)


@dataclass(frozen=True, eq=False, slots=True)
class _Prior:
    """Prior of the b base parameters: mean (b,) and covariance, in units of the weighted normal equations.

    `links` are the parts of the covariance that belong to mass, centre of mass and inertia of each link, shape
    (parts, b, b).
    """

    towards: str
    mean: Array
    covariance: BaseCovariance
    links: Array
    findings: tuple[Finding, ...]


def _places(problem: EstimationProblem) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Index of the base parameter, and number of the recording, of each parameter of the information.

    Both arrays have the shape (parameters,). The number is 2 for the copy `FV_1[2]`, and 0 for a common parameter.
    """
    names = problem.information.names
    copy = np.array([name.recording or 0 for name in names], dtype=np.intp)
    if problem.base is None:
        return np.arange(len(names)), copy
    index = {name: k for k, name in enumerate(problem.base.names)}
    return np.array([index[name.of_all] for name in names], dtype=np.intp), copy


class _Path:
    """Estimates of the base parameters from whitened rows, for any weight of the prior."""

    def __init__(self, rows: Array, side: Array, prior: _Prior) -> None:
        bodies, others = prior.covariance.bodies, prior.covariance.others
        root = root_of(bodies + others)
        half = np.linalg.inv(root)
        shares, vectors = np.linalg.eigh(half @ bodies @ half.T)
        self.shares = np.clip(shares, 0.0, 1.0)
        self.mean = prior.mean
        self.directions = root @ vectors
        self.rows = rows @ self.directions
        self.products = self.rows.T @ self.rows
        self.projection = self.rows.T @ (side - rows @ prior.mean)

    def values(self, weight: float) -> Array:
        """The estimate (b,) for a weight of the prior."""
        size = np.sqrt(self.shares / weight + 1.0 - self.shares) if weight else np.ones(len(self.mean))
        normal = size[:, None] * self.products * size + (np.eye(len(size)) if weight else 0.0)
        return self.mean + self.directions @ (size * np.linalg.solve(normal, size * self.projection))


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
            if weight > 0.0 or np.linalg.matrix_rank(path.rows) == len(path.mean):
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
    rows, side = rows_of(whole, weights)
    precision = prior.covariance.precision(weight)
    white, values = _posterior(rows, side, prior, weight)
    share = np.diag(white @ precision)
    unweighted = stack(whole)[0]
    counted = whole.rows[0]
    correlation = weighted.correlation
    excess = None
    if weight:
        links, others = prior.links * (correlation / weight), prior.covariance.others * correlation
        scales = prior_scales(weighted.rows, weighted.values - prior.mean, links, others, correlation)
        excess = np.tensordot(scales - 1.0, links, 1)
    return Fit(
        whole.names,
        values,
        np.sqrt(np.diag(white)),
        white + scale_covariance(whole, weights, white),
        "white",
        max(float(counted.sum()) - len(values) + float(share.sum()), 1.0),
        np.sqrt(held_out_squares(whole, values) / np.maximum(counted, 1)),
        counted,
        condition(unweighted),
        scaled_condition(unweighted),
        weights,
        prior_precision=precision if weight else None,
        prior_correlation=correlation,
        prior_excess=excess,
        findings=(*prior.findings, *_findings(whole.names, prior.towards, weight, how, share)),
    )


def _posterior(rows: Array, side: Array, prior: _Prior, weight: float) -> tuple[Array, Array]:
    """Covariance (b, b) and values (b,) of the estimate with a prior, from a singular value decomposition.

    For the decomposition, the parameters are scaled so that their prior has unit covariance. The values and the
    covariance in the result are not scaled.

    Args:
        rows: Whitened rows, shape (k, b).
        side: Right-hand side of the whitened rows, shape (k,).
        prior: The prior.
        weight: Weight of the prior; 0 for no prior.
    """
    root = root_of(prior.covariance.weighted(weight if weight else 1.0))
    U, sizes, Vt = np.linalg.svd(rows @ root, full_matrices=True)
    sizes = np.concatenate([sizes, np.zeros(Vt.shape[0] - len(sizes))])
    projection = (U.T @ (side - rows @ prior.mean))[: len(sizes)]
    projection = np.concatenate([projection, np.zeros(len(sizes) - len(projection))])
    turned = root @ Vt.T
    held = sizes**2 + (1.0 if weight else 0.0)
    return (turned / held) @ turned.T, prior.mean + turned @ (sizes * projection / held)


def _findings(names: tuple[str, ...], towards: str, weight: float, how: str, share: Array) -> list[Finding]:
    """Findings about the weight of the prior, and about parameters that depend more on the prior than on the data.

    Args:
        names: Names of the parameters.
        towards: Mean of the prior: `nominal` or `zero`.
        weight: Weight of the prior.
        how: Text that says how the weight was found.
        share: Share of each parameter's value that comes from the prior, shape (b,).
    """
    mean = "the description" if towards == "nominal" else "zero"
    findings = [weight_finding(f"prior towards {mean}", weight, how)]
    dominated = [name for name, part in zip(names, share, strict=True) if part > DOMINATED]
    if dominated:
        message = f"These parameters are determined more by the prior than by the data: {', '.join(dominated)}."
        findings.append(
            Finding("prior-dominated", "warning", "", message, "record a motion that excites these parameters.")
        )
    return findings
