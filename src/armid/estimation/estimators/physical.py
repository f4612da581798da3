"""Physically consistent standard parameters by convex optimisation.

The estimate minimises the weighted residual plus a prior, which determines the parameters that the data do not
determine. The constraints are: the eigenvalues of each link's pseudo-inertia are at least epsilon; rotor inertia,
viscous and Coulomb friction are not negative; masses and centres of mass are within the bounds that the user gives.
The program contains the triangular factors, so its size does not depend on the length of the recordings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError, Finding, UnsolvedError, did_you_mean
from armid.estimation.consistency.additional_constraints import Requirements
from armid.estimation.consistency.cones import EPSILON
from armid.estimation.consistency.consistent_fit import ConsistentProgram
from armid.estimation.constrained_fit_statistics import PhysicalEstimate, fit_of
from armid.estimation.crossvalidation import folds, held_out_squares, one_standard_error, split
from armid.estimation.fit_result import Fit
from armid.estimation.friction_per_recording import standard_per_recording
from armid.estimation.prior import GIVEN, make_prior, shrinkage_option
from armid.estimation.problem import EstimationProblem, StandardParameters
from armid.estimation.standard_parameter_resolution import NOT_JUDGED, PriorTrial, PriorUse
from armid.estimation.whitened_system import WhitenedSystem, noise_option, rows_of, whiten
from armid.information.information import Information
from armid.threads import one_blas_thread

RESOLUTIONS = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""Lower bounds of the ratio of noise to torque, tried in this order. The first is the accuracy of the best models of
arms. If no real body explains the data, the residual may be so many standard deviations of the noise that rounding
errors of the solver hide the constraints. Then the next bound is used, and a finding records it."""

FAR = 10.0
"""RMS residual of a joint, in standard deviations of its noise, above which a finding says that no consistent arm
explains the torque."""

WEIGHTS = np.logspace(4.0, -1.0, 11)
"""Weights of a prior that are tried, the largest first. The largest one keeps links within about 1 % of the
description; with the smallest one, the description has almost no effect."""

TRIED = 1e-4
"""Difference between the cost and its minimum at which the search ends, if a weight of the prior is only tried."""

LEAST_ERROR = 1e-4
"""Lower bound of the ratio of held-out variance to the variance of the residual; all smaller ratios count as this
one."""

REMEDY = "check the signs of torque and gravity, the units, and that the description belongs to this arm."
"""Remedy for torques that no consistent body explains."""

PRIORS = ("auto", "mass", "log-det", "euclidean", "none")


@dataclass(frozen=True, slots=True)
class PhysicallyConsistent:
    """Estimator of standard parameters that real bodies can have, by convex optimisation.

    Attributes:
        prior: Kind of prior, for parameters that the data do not determine: `mass` prefers small bodies; `log-det`
            and `euclidean` prefer the bodies of the description; `none` is no prior; `auto` is `log-det` if the
            description gives every link a mass, otherwise `mass`.
        weight: Weight of the prior, in independent samples of each joint. `auto` means 1. If, however, the option
            `prior` is `log-det` or `euclidean`, `auto` means that the weight is found by cross-validation with
            blocks.
        epsilon: Lower bound of the eigenvalues of a pseudo-inertia [kg and kg·m²].
        heaviest: Upper bound of the mass of each link [kg].
        total_mass: Lower and upper bound of the mass of all links together [kg].
        masses: Lower and upper bound of the mass of single links [kg], by the number of the link:
            `{ 3 = [1.0, 4.0] }`.
        com: Points that enclose the centre of mass of a link, in the link frame [m], by the number of the link: two
            corners of a box, or at least four points of a convex hull.
        equal: Lists of names of parameters that have equal values, such as `[["XX_7", "YY_7"]]`.
        fixed: Known values of parameters, such as `{ XY_7 = 0.0 }`.
        known: Numbers of the links that are not estimated; their parameters are taken from the description.
        noise: Standard deviation of each joint's noise, from which the weights of the rows are computed; if not
            given, the standard deviation of the residual is used.
        shrinkage: Pull towards zero of friction beyond viscous and Coulomb friction, as a share of the information in
            the part of its column that the other columns do not explain.
    """

    prior: Literal["auto", "mass", "log-det", "euclidean", "none"] = "auto"
    weight: float | Literal["auto"] = "auto"
    epsilon: float = EPSILON
    heaviest: float | None = None
    total_mass: tuple[float, ...] | None = None
    masses: Mapping[str, Sequence[float]] = field(default_factory=dict[str, "Sequence[float]"])
    com: Mapping[str, Sequence[Sequence[float]]] = field(default_factory=dict[str, "Sequence[Sequence[float]]"])
    equal: tuple[Sequence[str], ...] = ()
    fixed: Mapping[str, float] = field(default_factory=dict[str, float])
    known: tuple[int, ...] = ()
    noise: tuple[float, ...] = ()
    shrinkage: float = 0.0
    name: ClassVar[str] = "physical"
    quick: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.prior not in PRIORS:
            raise EstimationError(
                f"The option `prior` has the unknown value {self.prior!r}.",
                possible=", ".join(PRIORS),
                remedy=did_you_mean(self.prior, PRIORS),
            )
        if self.weight != "auto" and not (_number(self.weight) and 0.0 < self.weight < math.inf):
            raise EstimationError(
                f"The option `weight` must be auto or a positive number; found {self.weight!r}.",
                remedy='use weight = "auto", or a number of independent samples such as 1.0.',
            )
        if not (_number(self.epsilon) and 0.0 < self.epsilon < 1.0):
            raise EstimationError(
                f"The option `epsilon` must be a small positive number; found {self.epsilon!r}.",
                remedy=f"leave the option out, which gives {EPSILON:g}.",
            )
        if self.heaviest is not None and not (_number(self.heaviest) and self.heaviest > 0.0):
            raise EstimationError(
                f"The option `heaviest` must be a positive mass [kg]; found {self.heaviest!r}.",
                remedy="give a number in kg, or leave the option out, so that masses have no upper bound.",
            )
        examples = {
            "masses": "3 = [1.0, 4.0]",
            "com": "3 = [[-0.1, -0.1, 0.0], [0.1, 0.1, 0.3]]",
            "fixed": "XY_7 = 0.0",
        }
        for option, example in examples.items():
            if not isinstance(getattr(self, option), Mapping):
                raise EstimationError(
                    f"The option `{option}` must be a table; found {getattr(self, option)!r}.",
                    remedy=f"write a table, for instance {option} = {{ {example} }}.",
                )
        if not all(isinstance(group, list | tuple) for group in self.equal):
            raise EstimationError(
                f"The option `equal` must be a list of lists of names; found {self.equal!r}.",
                remedy='write, for instance, equal = [["XX_7", "YY_7"]].',
            )
        object.__setattr__(self, "noise", noise_option(self.noise))
        object.__setattr__(self, "shrinkage", shrinkage_option(self.shrinkage))
        object.__setattr__(self, "equal", tuple(tuple(group) for group in self.equal))

    @one_blas_thread
    def solve(self, problem: EstimationProblem) -> Fit:
        """Estimates standard and base parameters.

        Raises:
            EstimationError: The description lacks masses that the prior needs, or constraints contradict each other.
            UnsolvedError: The solver found no solution that passes the checks.
        """
        trouble = UnsolvedError(
            "The solver found no physically consistent parameters.",
            remedy="relax the options `heaviest`, `masses`, `com`, `known`, `fixed` or `equal`, or identify with "
            "another method.",
        )
        first = whiten(problem.information, resolution=RESOLUTIONS[0], noise=self.noise)
        for resolution in RESOLUTIONS:
            raised = resolution > RESOLUTIONS[0]
            weighted = whiten(problem.information, resolution=resolution, noise=self.noise) if raised else first
            try:
                fit = self._estimate(problem, weighted)
            except UnsolvedError as error:
                trouble = error
                continue
            if raised:
                far = first.weights * fit.residual_rms
                fit = replace(fit, findings=(_raised(resolution, far), *fit.findings))
            return fit
        raise UnsolvedError(
            f"{trouble.problem} The program was also not solved with larger assumed noise, up to "
            f"{RESOLUTIONS[-1]:g} of the torque.",
            remedy=trouble.remedy or REMEDY,
        )

    def with_prior_of(self, problem: EstimationProblem, fit: Fit) -> PhysicallyConsistent:
        """Copy of this estimator with the weight of the prior that a fit has used.

        If the fit has no prior, the copy is equal to this estimator.
        """
        del problem
        weight = 0.0 if fit.standard is None else fit.standard.prior.weight
        return replace(self, weight=weight) if weight > 0.0 else self

    def _estimate(self, problem: EstimationProblem, weighted: WhitenedSystem) -> Fit:
        """Estimates standard and base parameters from whitened data."""
        information = problem.information
        standard = standard_per_recording(problem.require_standard(self.name), problem.base, information)
        kind = self._kind(standard)
        belief = make_prior(kind, standard, weighted, shrinkage=self.shrinkage)
        asked = Requirements(
            self.epsilon, self.heaviest, self.total_mass, self.masses, self.com, self.equal, self.fixed, self.known
        )
        program = ConsistentProgram(standard, asked, kind, belief, weighted.correlation)
        prior = self._weigh_prior(information, program, weighted)
        bodies = program.solve(weighted.rows, weighted.rows @ weighted.values, prior.weight)
        return fit_of(
            PhysicalEstimate(standard, weighted, belief, prior, bodies.values, bodies.gap, bodies.basis, asked)
        )

    def _kind(self, standard: StandardParameters) -> str:
        """Kind of the prior that is used; `auto` is replaced by `log-det` or `mass`."""
        if self.prior != "auto":
            return self.prior
        return "log-det" if standard.described else "mass"

    def _weigh_prior(
        self, information: Information, program: ConsistentProgram, weighted: WhitenedSystem
    ) -> PriorUse:
        """Chooses the weight of the prior, by cross-validation if this is asked for, and states how it was found."""
        kind, correlation = program.kind, weighted.correlation
        if kind == "none":
            return PriorUse(kind, 0.0, "of this kind has none", correlation)
        if self.prior in ("auto", "mass") and self.weight == "auto":
            return PriorUse(kind, 1.0, "the default", correlation)
        if self.weight != "auto":
            return PriorUse(kind, float(self.weight), GIVEN, correlation)
        parts = split(information, folds(information))
        if not parts:
            return PriorUse(kind, 1.0, NOT_JUDGED, correlation)
        samples = float(weighted.whole.rows.max()) / correlation
        weights = WEIGHTS[WEIGHTS <= max(samples, WEIGHTS[-1])]  # no prior may outweigh all data
        errors = np.full((len(weights), len(parts)), np.inf)
        for f, part in enumerate(parts):
            rows, side = rows_of(part.training, weighted.weights)
            for k, weight in enumerate(weights):
                values = program.solve(rows, side, float(weight), aim=TRIED).values
                errors[k, f] = _error(part.held_out, program.standard.regrouping @ values, weighted.weights)
        chosen = one_standard_error(errors)
        how = (
            f"the largest of {len(weights)} weights whose error on {len(parts)} held-out folds is within one "
            "standard error of the smallest"
        )
        trials = tuple(PriorTrial(float(w), float(e)) for w, e in zip(weights, errors.mean(axis=1), strict=True))
        return PriorUse(kind, float(weights[chosen]), how, correlation, trials)


def _raised(resolution: float, far: Array) -> Finding:
    """Finding that a higher level of noise was assumed than the level estimated from the data.

    Args:
        resolution: Ratio of noise to torque that was assumed.
        far: RMS residual of each joint, divided by the standard deviation of its noise, shape (n,).
    """
    counted = f"residuals up to {resolution:g} of the torque were counted as noise"
    joint = int(np.argmax(far))
    if far[joint] <= FAR:
        message = f"The noise of these torques is below the accuracy of the solver: {counted}."
        return Finding("noise-raised", "info", "", message)
    message = (
        "No physically consistent arm explains these torques within their noise. "
        f"The residual of joint {joint + 1} is {far[joint]:.2g} standard deviations of its noise; {counted}."
    )
    return Finding("noise-raised", "warning", "", message, REMEDY)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _error(held_out: Information, values: Array, weights: Array) -> float:
    """Held-out error of a fold: mean over the joints of log(held-out variance / variance of the residual).

    Without the logarithm, a single joint with a large error would determine the choice of the weight.
    """
    rows = held_out.rows.sum(axis=0)
    counted = rows > 0
    variance = weights**2 * held_out_squares(held_out, values) / np.maximum(rows, 1)
    return float(np.log(np.maximum(variance[counted], LEAST_ERROR)).mean())
