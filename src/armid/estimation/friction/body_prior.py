"""Choice between two estimates of the bodies under selected friction: consistent bodies, or a Gaussian prior.

Both keep the bodies near the description. Consistent bodies predict other recordings better where data are weak,
because the cone excludes what no real body has; held-out blocks of the same recordings do not show this. Where data
are strong and no consistent body explains the torques, as with a description of another arm, the error on held-out
blocks decides for the Gaussian prior.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.base_covariance import BaseCovariance, base_covariance
from armid.estimation.catalogue import Estimator
from armid.estimation.crossvalidation import (
    Fold,
    can_cross_validate,
    folds,
    held_out_squares,
    one_standard_error,
    split,
)
from armid.estimation.estimate_record import torque_parameters
from armid.estimation.estimators.physical import PhysicallyConsistent
from armid.estimation.estimators.ridge import Ridge
from armid.estimation.friction.heldout_gains import GainPrior, HeldOutFolds, make_folds
from armid.estimation.friction_per_recording import separate_by_recording
from armid.estimation.prior import make_prior
from armid.estimation.problem import EstimationProblem
from armid.estimation.whitened_system import WhitenedSystem
from armid.information.information import Information, total
from armid.model.dynamics_model import DynamicsModel

FOLDS = 8
"""Number of folds on which the weight of the prior is chosen, as in the selection."""

CONSISTENT = PhysicallyConsistent.name
"""Name of the estimator of physically consistent bodies."""

CONSISTENT_WEIGHT = 1.0
"""Weight of the prior with which physically consistent bodies are estimated under selected friction [independent
samples]. Larger weights, as cross-validation finds them for a Gaussian prior, predicted the Panda's other motions
worse."""

ENOUGH = 2.2
"""Smallest number of independent samples of a joint for each base parameter, with which held-out blocks of the same
recordings can distinguish bodies from friction. With fewer samples of the LWR4+ and the Med 7, a Gaussian prior was
better on held-out blocks, but worse on the other recordings: up to three times the error of plain least squares.
Consistent bodies did not have such errors."""

STRENGTHS = np.logspace(4.0, -4.0, 17)
"""Weights of the prior that are tried, in independent samples, the largest first."""

MARGIN = 0.05
"""Largest log ratio of the squared held-out errors of two estimators, mean over the joints, with which the first one
counts as equally good; it corresponds to an RMS error that is 2.5 % larger."""


@dataclass(frozen=True, eq=False, slots=True)
class BodyPrior:
    """Gaussian prior on the base parameters for any weight of the bodies.

    Attributes:
        mean: Mean of the base parameters, shape (b,).
        covariance: Covariance of the base parameters for weight 1.
        rows: Rows that count as one independent sample, the unit of a weight.
    """

    mean: Array
    covariance: BaseCovariance
    rows: float

    def weighted(self, weight: float) -> GainPrior:
        """Prior with a given weight of the bodies [independent samples]; weight 0 means no prior."""
        return GainPrior(self.mean, self.rows * self.covariance.precision(weight))

    def errors(self, short_folds: HeldOutFolds, own: NDArray[np.intp], kept: NDArray[np.intp], ridge: Array) -> Array:
        """Weighted squared held-out error for each weight in `STRENGTHS` on each of F folds, shape (weights, F).

        Args:
            short_folds: Data in folds; the prior in them is replaced.
            own: Positions of the base parameters among the parameters of the data.
            kept: Positions of the parameters that are estimated.
            ridge: Shrinkage of each parameter, in shares of the squared length of its column, shape (b,).
        """
        count = len(ridge)
        return np.stack(
            [
                short_folds.with_prior(self.weighted(strength).embedded(count, own)).errors(kept, ridge)
                @ short_folds.weights**2
                for strength in STRENGTHS
            ]
        )


def make_body_prior(problem: EstimationProblem, weighted: WhitenedSystem) -> BodyPrior:
    """Makes the prior of the bodies towards the description, or towards small bodies if it has no masses.

    Args:
        problem: Problem of the model without candidates.
        weighted: The whitened data of this model, with offsets that differ between recordings.
    """
    standard = problem.require_standard("friction selection")
    whole = total(problem.information)
    unit_prior = make_prior("log-det" if standard.described else "mass", standard, replace(weighted, whole=whole))
    covariance = base_covariance(unit_prior, standard)
    return BodyPrior(standard.regrouping @ unit_prior.mean, covariance, weighted.correlation)


def choose_prior(bodies: BodyPrior, data: Information, weights: Array) -> tuple[float, GainPrior]:
    """Finds the weight of the prior for the selection by cross-validation, under the model without candidates.

    The selection uses the largest weight whose error is within one standard error of the smallest. With a smaller
    weight, errors of the bodies can imitate friction; the fit of the same recording is then as good, but the
    prediction of other recordings is wrong.

    Args:
        bodies: The prior for any weight.
        data: Information about the model without candidates, with offsets that differ between recordings.
        weights: Weight of each joint's rows, shape (n,).

    Returns:
        The weight with the smallest error, and the prior for the selection.
    """
    kept, ridge = np.arange(data.count), np.zeros(data.count)
    prior = bodies.weighted(0.0).embedded(data.count, kept)
    errors = bodies.errors(make_folds(data, folds(data, FOLDS), weights, prior), kept, kept, ridge)
    best = float(STRENGTHS[np.argmin(errors.sum(axis=1))])
    return best, bodies.weighted(float(STRENGTHS[one_standard_error(errors)]))


def weight_for_estimate(errors: Array, *, contradicted: bool) -> float:
    """Weight of the prior for the estimate, from held-out errors under the selected friction [independent samples].

    While friction is missing in the model, its torque counts as noise, and the weight that suits this noise is too
    large afterwards. Usually the weight is the one with the smallest error. If the data contradict the description,
    it is the smallest weight whose error is within one standard error of the smallest: a prior that is wrong hardly
    shows on held-out parts of the same recording.

    Args:
        errors: Held-out error of each of `STRENGTHS` on each fold, shape (weights, F).
        contradicted: True if the data contradict the bodies of the description.
    """
    if contradicted:
        return float(STRENGTHS[::-1][one_standard_error(errors[::-1])])
    return float(STRENGTHS[np.argmin(errors.sum(axis=1))])


def suitable_method(
    problem: EstimationProblem, weighted: WhitenedSystem, drifting: tuple[str, ...], ridge_weight: float
) -> tuple[str, bool]:
    """Estimator that is suitable for the bodies, chosen with the model without friction candidates.

    Args:
        problem: Problem of the model without candidates.
        weighted: The whitened data.
        drifting: Names of the offsets that have a separate value in each recording.
        ridge_weight: Weight of the Gaussian prior with the smallest held-out error.

    Returns:
        Name of the estimator, and true if the data contradict the bodies of the description.
    """
    if not problem.require_standard("friction selection").described:
        return Ridge.name, False
    samples = float(weighted.whole.rows.max()) / weighted.correlation
    if samples < ENOUGH * weighted.whole.count:
        return PhysicallyConsistent.name, False
    noise = tuple(float(each) for each in 1.0 / weighted.weights)
    separate = separate_by_recording(problem.information, np.isin(problem.information.names, drifting))
    consistent = predicts_as_well(
        replace(problem, information=separate),
        PhysicallyConsistent(noise=noise, weight=CONSISTENT_WEIGHT),
        Ridge(noise=noise, weight=ridge_weight),
    )
    return (PhysicallyConsistent.name, False) if consistent else (Ridge.name, consistent is not None)


def predicts_as_well(problem: EstimationProblem, first: Estimator, second: Estimator) -> bool | None:
    """Tests whether the held-out error of one estimator is about as small as that of another, or smaller.

    The result is `None` if an estimate fails, so that nothing can be compared.

    Args:
        problem: Data and standard parameters.
        first: Estimator that is preferred.
        second: The other estimator. If there are too few blocks for a comparison, the result is true.
    """
    if not can_cross_validate(problem.information):
        return True
    parts = split(problem.information, folds(problem.information))
    if not parts:
        return True
    try:
        of_first, of_second = (
            np.sum([_held_out(problem, method, part) for part in parts], axis=0) for method in (first, second)
        )
    except EstimationError:
        return None
    counted = (of_first > 0.0) & (of_second > 0.0)
    return not counted.any() or float(np.log(of_first[counted] / of_second[counted]).mean()) <= MARGIN


def _held_out(problem: EstimationProblem, method: Estimator, part: Fold) -> Array:
    """Sum of squared errors of each joint on a fold that was left out of the estimate, shape (n,) [(N·m)² or N²]."""
    return held_out_squares(part.held_out, method.solve(replace(problem, information=part.training)).values)


def with_load_parameters(problem: EstimationProblem, weight: float) -> DynamicsModel:
    """Adds the inertial parameters of a first estimate for load-dependent friction, unless the model has them.

    Args:
        problem: Problem of the model without load-dependent friction, with its samples.
        weight: Weight of the prior of the first estimate, in units of one row.
    """
    model, base, _ = problem.require_samples("load-dependent friction")
    if model.load_parameters is not None or not model.has_rigid_bodies:
        return model
    theta = torque_parameters(base, Ridge(weight=weight).solve(problem))
    return replace(model, load_parameters=theta[model.inertial_columns].reshape(model.n, 10))
