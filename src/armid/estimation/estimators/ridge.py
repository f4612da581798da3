"""Least squares with a Gaussian prior on the base parameters.

    minimise |W (y - A π)|² + λ (π - π₀)ᵀ P (π - π₀)

π₀ is what the description's bodies give, or zero; P comes from what is believed of the standard parameters behind
the base (`armid.estimation.prior`): for each link the second-order form of the log-det divergence, in which a change
of a whole link by 100 % counts the same for a big and a small one. With P = CᵀC and U S Vᵀ = W A C⁻¹, every λ costs
one product, π = π₀ + C⁻¹ V S (S² + λ)⁻¹ Uᵀ W (y - A π₀), and blocked cross-validation of λ a few milliseconds.

The prior keeps estimates from poor data near the description as far as the data do not say otherwise. It does not
keep bodies physical; `physical` does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from armid.errors import EstimationError, Finding
from armid.estimation.crossvalidation import folds, held_out_error, held_out_squares, split
from armid.estimation.fit import Fit
from armid.estimation.least_squares import solve
from armid.estimation.prior import make_prior, project_covariance
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.covariance import scale_covariance
from armid.estimation.whitening import WhitenedSystem, rows_of, whiten
from armid.information.information import Information, stack
from armid.maths.linalg import condition, scaled_condition
from armid.threads import one_blas_thread
from armid.values import Array

__all__ = ["Ridge"]

STRENGTHS = np.concatenate([np.logspace(6.0, -4.0, 31), [0.0]])
"""Weights of the prior that are tried, strongest first: from links known to a thousandth to known to a factor of 100,
in independent samples."""

DOMINATED = 0.5
"""Share of a parameter's value from which on it is the prior's."""


@dataclass(frozen=True, slots=True)
class Ridge:
    """Weighted least squares that keeps near the description as far as the data allow it.

    Attributes:
        towards: `nominal`, the description's inertial parameters; `zero`; or `auto`, nominal where there are any.
        weight: How many independent samples the prior counts as; `auto` finds it by blocked cross-validation.
    """

    towards: Literal["auto", "nominal", "zero"] = "auto"
    weight: float | Literal["auto"] = "auto"
    name: ClassVar[str] = "ridge"
    quick: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.towards not in ("auto", "nominal", "zero"):
            raise EstimationError(f"Unknown prior towards {self.towards!r}.", possible="auto, nominal, zero")
        if self.weight != "auto" and not 0.0 <= self.weight < np.inf:
            raise EstimationError(f"weight must be at least 0; found {self.weight!r}.", possible="auto, a number")

    @one_blas_thread
    def estimate(self, problem: EstimationProblem) -> Fit:
        """Estimate the base parameters.

        Raises:
            EstimationError: A weight of zero with data that do not determine the parameters, or no description to
                keep near to.
        """
        weighted = whiten(problem.information)
        prior = self._prior(problem, weighted)
        if self.weight == "auto":
            weight, how = _chosen(problem.information, weighted, prior)
        else:
            weight, how = float(self.weight), "given"
        if weight == 0.0:
            solve(problem.information, weighted.weights)  # refuses what the data do not determine
        return _fit(weighted, prior, weight, how)

    def settled(self, problem: EstimationProblem) -> Ridge:
        """The method with the weight of the prior that it finds on a problem."""
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
        covariance *= copy[:, None] == copy[None, :]  # friction of each recording is believed the same by itself
        return _Prior(towards, L @ belief.mean, covariance / weighted.correlation, belief.findings)


@dataclass(frozen=True, eq=False, slots=True)
class _Prior:
    """Belief about the b base parameters: mean (b,), covariance (b, b) in the unit of the data's weights."""

    towards: str
    mean: Array
    covariance: Array
    findings: tuple[Finding, ...]


def _places(problem: EstimationProblem) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Tell which base parameter each of the information's is, and its recording: 2 for `FV_1[2]`, 0 if shared."""
    names = [name.rstrip("]").split("[") for name in problem.information.names]
    copy = np.array([int(parts[1]) if len(parts) > 1 else 0 for parts in names], dtype=np.intp)
    if problem.base is None:
        return np.arange(len(names)), copy
    index = {name: k for k, name in enumerate(problem.base.names)}
    return np.array([index[parts[0]] for parts in names], dtype=np.intp), copy


class _Path:
    """The estimates for all weights of the prior, from whitened rows."""

    def __init__(self, rows: Array, side: Array, prior: _Prior) -> None:
        self.mean = prior.mean
        self.root = np.linalg.cholesky(prior.covariance)  # C⁻¹, up to a rotation that changes nothing
        U, self.sizes, Vt = np.linalg.svd(rows @ self.root, full_matrices=True)
        self.turned = self.root @ Vt.T
        self.sizes = np.concatenate([self.sizes, np.zeros(Vt.shape[0] - len(self.sizes))])
        seen = (U.T @ (side - rows @ prior.mean))[: len(self.sizes)]
        self.seen = np.concatenate([seen, np.zeros(len(self.sizes) - len(seen))])

    def values(self, weight: float) -> Array:
        """The estimate (b,)."""
        return self.mean + self.turned @ (self.sizes * self.seen / (self.sizes**2 + weight))

    def covariance(self, weight: float) -> Array:
        """(H + λ P)⁻¹, shape (b, b)."""
        return (self.turned / (self.sizes**2 + weight)) @ self.turned.T


def _chosen(information: Information, weighted: WhitenedSystem, prior: _Prior) -> tuple[float, str]:
    """The weight that errs least on folds left out, and how it was found."""
    candidates = STRENGTHS[:-1] if len(weighted.unseen) else STRENGTHS
    parts = split(information, folds(information))
    if not parts:
        return 1.0, "of one sample, for want of blocks to validate on"
    errors = np.full((len(candidates), len(parts)), np.inf)
    for f, part in enumerate(parts):
        path = _Path(*rows_of(part.training, weighted.weights), prior)
        for k, weight in enumerate(candidates):
            if weight > 0.0 or path.sizes.min() > 0.0:
                errors[k, f] = held_out_error(part.held_out, path.values(float(weight)), weighted.weights)
    return float(candidates[int(np.argmin(errors.mean(axis=1)))]), f"chosen on {len(parts)} folds of blocks left out"


def _fit(weighted: WhitenedSystem, prior: _Prior, weight: float, how: str) -> Fit:
    """The estimate for a weight of the prior."""
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
    """Return what the prior weighs, and what it decides."""
    said = f"The prior towards {'the description' if towards == 'nominal' else 'zero'} weighs {weight:.3g} "
    found = [Finding("prior-weight", "info", "", f"{said}independent samples, {how}.")]
    decided = [name for name, part in zip(names, share, strict=True) if part > DOMINATED]
    if decided:
        said = f"The prior determines these more than the data do: {', '.join(decided)}."
        found.append(Finding("prior-dominated", "warning", "", said, "record a motion that shows them."))
    return found
