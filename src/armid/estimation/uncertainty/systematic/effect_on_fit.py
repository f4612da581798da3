"""Effect of systematic errors on the fit of an estimator, computed from the samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.systematic.regressor_noise import regressor_noise_bias
from armid.estimation.uncertainty.systematic.ripple_search import ripple_kinds
from armid.estimation.uncertainty.systematic.systematic_error_effect import (
    ConeEffect,
    ErrorEffect,
    effect_of_errors,
    effect_with_cone,
)
from armid.estimation.uncertainty.systematic.systematic_errors import OUTLIER, error_kinds, error_products


def effect_on_fit(
    problem: EstimationProblem,
    fit: Fit,
    values: Array,
    prior: Array,
    inverse: Array,
    inverse_with: Callable[[Array], Array],
    column_maps: Sequence[Array] | None,
) -> ErrorEffect:
    """Computes the effect of systematic errors on a fit of b unknowns; the effect is empty if no error is possible.

    Args:
        problem: Problem with its samples, in c parameters.
        fit: The fit.
        values: Parameters of each joint's torque, shape (n, c).
        prior: Precision of the prior, shape (b, b).
        inverse: Inverse of the weighted normal matrix with this prior, shape (b, b).
        inverse_with: Function that gives the inverse of the weighted normal matrix for another precision (b, b) of
            the prior.
        column_maps: Matrices from b unknowns to the parameters of each joint's columns, shapes (c, b); if not given,
            the unknowns are the parameters.
    """
    b = len(inverse)
    # Rows that a robust method gives less weight, such as those in contact, say nothing about systematic errors.
    largest = np.inf if fit.information is None else OUTLIER
    kinds = (*error_kinds(problem, values), *ripple_kinds(problem, values, fit.weights, largest))
    if not kinds:
        return ErrorEffect(covariance=np.zeros((b, b)), attenuation=np.zeros(b))
    attenuation = np.zeros(b)
    if column_maps is None:
        attenuation = regressor_noise_bias(problem, fit.values, fit.weights, inverse)
    products = error_products(problem, kinds, values, fit.weights, column_maps, largest)
    effect = effect_of_errors(products, inverse, prior)
    lift = None if fit.standard is None else fit.standard.lift
    if lift is not None and lift.cone is not None:
        without = inverse_with(lift.cone.precision)
        effect = effect_with_cone(effect, products, ConeEffect(prior, lift.cone, without, fit.prior_correlation))
    return replace(effect, attenuation=attenuation)
