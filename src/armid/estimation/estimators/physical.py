"""Physically consistent standard parameters: what a real arm can have, and nothing else.

Every link's pseudo-inertia at least epsilon, rotor inertia, viscous and Coulomb friction not negative, and what else
is known of masses and centres of mass; under these the smallest weighted residual, with a prior for what data leave
open. The problem is convex and small: it is solved on the compressed factors, whatever the length of the recordings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal

import numpy as np

from armid.errors import EstimationError, Finding, UnsolvedError
from armid.estimation.consistency.cones import EPSILON
from armid.estimation.consistency.consistent_fit import ConsistentProgram
from armid.estimation.consistency.constraints import Requirements
from armid.estimation.crossvalidation import folds, held_out_squares, one_standard_error, split
from armid.estimation.fit import Fit
from armid.estimation.per_recording import standard_per_recording
from armid.estimation.physical_fit import PhysicalFit
from armid.estimation.prior import make_prior
from armid.estimation.problem import EstimationProblem, StandardParameters
from armid.estimation.standard_fit import PriorTrial, PriorUse
from armid.estimation.whitening import WhitenedSystem, rows_of, whiten
from armid.information.information import Information
from armid.threads import one_blas_thread
from armid.values import Array

__all__ = ["NOT_JUDGED", "PhysicallyConsistent"]

RESOLUTIONS = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""Smallest residual over torque that counts as noise. No model of an arm is right to more digits than the first says.
Data that no body explains may be wrong by so many deviations of it that a solver has no digits left for the
constraints; then the next counts, and a finding says so."""

FAR = 10.0
"""Deviations of noise by which bodies must miss a joint's torque for it to be said that none explains it."""

WEIGHTS = np.logspace(4.0, -1.0, 11)
"""Weights of a prior that are tried, strongest first: from links known to a hundredth to hardly known at all."""

TRIED = 1e-4
"""Gap at which a weight is tried."""

LEAST_ERROR = 1e-4
"""Held-out variance over that of the residual below which no difference counts."""

REMEDY = "look for a wrong sign of torque or gravity, a wrong unit, or a description of another arm."
"""Remedy for torques that no consistent body explains."""

PRIORS = ("auto", "mass", "log-det", "euclidean", "none")


NOT_JUDGED = "that of one sample, for want of blocks to leave out"
"""Origin of a prior weight that held-out blocks were to judge."""


@dataclass(frozen=True, slots=True)
class PhysicallyConsistent:
    """Standard parameters of bodies that can exist, by convex optimisation.

    Attributes:
        prior: What decides where the data do not: `mass`, the smallest bodies; `log-det` or `euclidean`, the
            description's; `none`, nothing, and such parameters are any that fit; `auto`, `log-det` where the
            description gives every link a mass, else `mass`.
        weight: Of the prior, in independent samples a joint; `auto` is by blocked cross-validation where `log-det` or
            `euclidean` is asked for by name, else one.
        epsilon: Smallest eigenvalue of a pseudo-inertia.
        heaviest: Largest mass of any link [kg].
        total_mass: Least and largest mass of all links [kg].
        masses: Least and largest mass of single links [kg], `{ 3 = [1.0, 4.0] }`.
        com: Points around centres of mass in link frames [m]: two corners of a box, or more points of a hull.
        equal: Sets of parameters that have one value, such as `[["XX_7", "YY_7"]]`.
        fixed: Parameters that are known, `{ XY_7 = 0.0 }`.
        known: Numbers of links that are as the description says.
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
    name: ClassVar[str] = "physical"
    quick: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.prior not in PRIORS:
            raise EstimationError(f"prior must be one of these; found {self.prior!r}.", possible=", ".join(PRIORS))
        if self.weight != "auto" and not (_number(self.weight) and 0.0 < self.weight < math.inf):
            raise EstimationError(f"weight must be auto or a positive number; found {self.weight!r}.")
        if not (_number(self.epsilon) and 0.0 < self.epsilon < 1.0):
            raise EstimationError(f"epsilon must be a small positive number; found {self.epsilon!r}.")
        if self.heaviest is not None and not (_number(self.heaviest) and self.heaviest > 0.0):
            raise EstimationError(f"heaviest must be a positive mass [kg]; found {self.heaviest!r}.")
        for option in ("masses", "com", "fixed"):
            if not isinstance(getattr(self, option), Mapping):
                raise EstimationError(f"{option} must be a table; found {getattr(self, option)!r}.")
        if not all(isinstance(group, list | tuple) for group in self.equal):
            raise EstimationError(f"equal must be a list of lists of names; found {self.equal!r}.")
        object.__setattr__(self, "equal", tuple(tuple(group) for group in self.equal))

    @one_blas_thread
    def estimate(self, problem: EstimationProblem) -> Fit:
        """Estimate standard and base parameters.

        Raises:
            EstimationError: The description gives no prior that was asked for, or constraints contradict each other.
            UnsolvedError: No solution passed its checks.
        """
        trouble = UnsolvedError(
            "No consistent parameters were found.",
            remedy="loosen heaviest, masses, com, known, fixed or equal, or identify with another method.",
        )
        first = whiten(problem.information, resolution=RESOLUTIONS[0])
        for resolution in RESOLUTIONS:
            raised = resolution > RESOLUTIONS[0]
            weighted = whiten(problem.information, resolution=resolution) if raised else first
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
            f"{trouble.problem} Nor did any search with residuals up to {RESOLUTIONS[-1]:g} of the torque as noise.",
            remedy=trouble.remedy or REMEDY,
        )

    def _estimate(self, problem: EstimationProblem, weighted: WhitenedSystem) -> Fit:
        """The estimate from data that were given weights."""
        information = problem.information
        standard = standard_per_recording(problem.require_standard(self.name), problem.base, information)
        kind = self._kind(standard)
        belief = make_prior(kind, standard, weighted)
        asked = Requirements(
            self.epsilon, self.heaviest, self.total_mass, self.masses, self.com, self.equal, self.fixed, self.known
        )
        program = ConsistentProgram(standard, asked, kind, belief, weighted.correlation)
        prior = self._weigh_prior(information, program, weighted)
        bodies = program.solve(weighted.rows, weighted.rows @ weighted.values, prior.weight)
        return PhysicalFit(standard, weighted, belief, prior, bodies.values, bodies.gap, bodies.basis, asked).fit()

    def _kind(self, standard: StandardParameters) -> str:
        """The prior that it is."""
        if self.prior != "auto":
            return self.prior
        return "log-det" if standard.described else "mass"

    def _weigh_prior(
        self, information: Information, program: ConsistentProgram, weighted: WhitenedSystem
    ) -> PriorUse:
        """The prior with its weight and why it has it."""
        kind, correlation = program.kind, weighted.correlation
        if kind == "none":
            return PriorUse(kind, 0.0, "of this kind has none", correlation)
        if self.prior in ("auto", "mass") and self.weight == "auto":
            return PriorUse(kind, 1.0, "the default", correlation)
        if self.weight != "auto":
            return PriorUse(kind, float(self.weight), "given", correlation)
        parts = split(information, folds(information))
        if not parts:
            return PriorUse(kind, 1.0, NOT_JUDGED, correlation)
        samples = float(weighted.whole.rows.max()) / correlation
        weights = WEIGHTS[WEIGHTS <= max(samples, WEIGHTS[-1])]  # no opinion outweighs all that was seen
        errors = np.full((len(weights), len(parts)), np.inf)
        for f, part in enumerate(parts):
            rows, side = rows_of(part.training, weighted.weights)
            for k, weight in enumerate(weights):
                values = program.solve(rows, side, float(weight), aim=TRIED).values
                errors[k, f] = _error(part.held_out, program.standard.regrouping @ values, weighted.weights)
        chosen = one_standard_error(errors)
        how = f"the strongest within a standard error of the best of {len(weights)} on {len(parts)} folds left out"
        trials = tuple(PriorTrial(float(w), float(e)) for w, e in zip(weights, errors.mean(axis=1), strict=True))
        return PriorUse(kind, float(weights[chosen]), how, correlation, trials)


def _raised(resolution: float, far: Array) -> Finding:
    """Return what is said where noise had to be taken as larger than it is.

    Args:
        resolution: Residual over torque that was taken as noise.
        far: Residual of each joint over the noise that it seems to have, shape (n,).
    """
    counted = f"residuals up to {resolution:g} of the torque were counted as noise"
    joint = int(np.argmax(far))
    if far[joint] <= FAR:
        said = f"The search had no digits for noise as small as that of these torques: {counted}."
        return Finding("noise-raised", "info", "", said)
    said = (
        "No body explains these torques to within their noise, and by so far that a search has no digits for it. "
        f"Joint {joint + 1} is off by {far[joint]:.2g} of its deviations; {counted}."
    )
    return Finding("noise-raised", "warning", "", said, REMEDY)


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _error(held_out: Information, values: Array, weights: Array) -> float:
    """Mean over joints of the logarithm of the held-out variance over that of the residual.

    A joint whose torque is heavy, and whose noise rises with it, would otherwise decide alone.
    """
    rows = held_out.rows.sum(axis=0)
    counted = rows > 0
    variance = weights**2 * held_out_squares(held_out, values) / np.maximum(rows, 1)
    return float(np.log(np.maximum(variance[counted], LEAST_ERROR)).mean())
