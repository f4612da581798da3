"""Scatter of the estimate between recordings, which enters the covariance of the parameters.

If all recordings have the same parameters, the estimate without recording k differs from the estimate of all by d_k,
whose covariance is the difference of the covariances of the two estimates. If friction and offsets change from one
recording to the next with the covariance C, an estimate from R recordings contains their mean over these recordings,
with the covariance C / R. The mean of d_k² divided by its variance is then one. A larger mean shows that the
parameters change more than assumed, or that the model lacks an effect that differs between the recordings. The
variances of the parameters are then multiplied by it.

A few recordings hardly determine the mean of one parameter. Therefore it is combined with the mean over all
parameters, as in the moderated variances of [Smyth2004].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem
from armid.estimation.standard_parameter_resolution import StandardFit
from armid.estimation.uncertainty.covariance import Uncertainty, scale_covariance
from armid.estimation.uncertainty.left_out_recordings import LeftOut

PRIOR_RECORDINGS = 4.0
"""Weight of the mean over all parameters in the scatter of one parameter, as an equivalent number of left-out
recordings."""

SMALLEST_DIFFERENCE = 0.1
"""Lower limit of the difference between the variances of the estimates without and with a recording, as a share of
the variance without the recording. The difference of two estimated variances can be zero or negative."""

LARGEST = 25.0
"""Upper limit of the squared change of one parameter without one recording, divided by the variance of the change. It
prevents that a single parameter of a single recording determines the mean over all."""


def covariance_by_scales(fit: Fit, problem: EstimationProblem) -> Array:
    """Part of the covariance of a fit that uncertain torque scales cause, shape (b, b); zero if they are exact."""
    if not problem.information.scale_deviation.any():
        return np.zeros_like(fit.covariance)
    own = Uncertainty(fit, problem)
    return scale_covariance(own.whole, fit.weights, own.inverse)


def with_recording_scatter(
    fit: Fit, left_out: Sequence[LeftOut], recordings: int, by_scales: Array, change: Array
) -> Fit:
    """Adds the usual change between recordings to the covariance of a fit, and multiplies the sum by scatter factors.

    A factor is larger than one if the estimate of a parameter scatters more between recordings than its covariance
    predicts.

    Args:
        fit: Estimate from all training recordings.
        left_out: Estimates without one recording or several; without any, the fit is returned unchanged.
        recordings: Number of all training recordings.
        by_scales: Part of the covariance by uncertain torque scales, which are the same in all recordings, shape (b,
            b).
        change: Covariance of the parameters of one recording by the change of friction and offsets, shape (b, b).
    """
    if not left_out:
        return fit
    copies = [name.of_all for name in fit.names]
    names = left_out[0].fit.names
    mean = np.array([[name == copy for copy in copies] for name in names], dtype=np.float64)
    mean /= mean.sum(axis=1, keepdims=True)
    separate = mean.max(axis=1) < 1.0  # each recording has its own, whose scatter is that of the change
    change = np.where(separate[:, None] | separate, 0.0, change)
    place = [names.index(copy) for copy in copies]
    scattered = fit.covariance - by_scales + change[np.ix_(place, place)] / recordings
    variance = np.diag(mean @ (fit.covariance - by_scales) @ mean.T)
    factors = scatter_factors(mean @ fit.values, variance, left_out, recordings, np.diag(change))
    each = np.sqrt(factors)[place]
    covariance = scattered * np.outer(each, each) + by_scales
    if fit.standard is None:
        return replace(fit, covariance=covariance)
    known = {name: k for k, name in enumerate(names)}
    usual, added = float(np.mean(factors)), np.diag(change) / recordings
    widening = np.ones(len(fit.standard.names))
    for k, name in enumerate(fit.standard.names):
        own, at = fit.standard.covariance[k, k], known.get(name.of_all)
        widening[k] = usual if at is None else factors[at] * (1.0 + (added[at] / own if own > 0.0 else 0.0))
    return replace(fit, covariance=covariance, standard=_widened(fit.standard, np.sqrt(widening)))


def _widened(fit: StandardFit, factor: Array) -> StandardFit:
    """Fit of standard parameters whose deviations and intervals are multiplied by factors, shape (p,)."""
    low, high = fit.intervals.T
    bounded = (low == 0.0) & (high > 0.0)  # physics forbids negative values
    ends = fit.values[:, None] + factor[:, None] * (fit.intervals - fit.values[:, None])
    ends[bounded, 0] = 0.0
    return replace(fit, covariance=fit.covariance * np.outer(factor, factor), intervals=ends)


def scatter_factors(
    values: Array, variance: Array, left_out: Sequence[LeftOut], recordings: int, change: Array
) -> Array:
    """Factor on the variance of each parameter that follows from the scatter between recordings, shape (b,).

    The factor is at least 1.

    Args:
        values: Estimate from all recordings, shape (b,).
        variance: Variance of each parameter, shape (b,).
        left_out: Estimates without one recording or several.
        recordings: Number of all training recordings.
        change: Variance of each parameter of one recording by the change of friction and offsets, shape (b,).
    """
    squares: list[Array] = []
    for each in left_out:
        other = np.diag(each.fit.covariance)
        difference = np.maximum(other - variance, SMALLEST_DIFFERENCE * other)
        difference += change * (1.0 / (recordings - len(each.recordings)) - 1.0 / recordings)
        ratio = (each.fit.values - values) ** 2 / np.where(difference > 0.0, difference, np.inf)
        squares.append(np.minimum(ratio, LARGEST))
    table = np.array(squares)
    common = max(1.0, float(table.mean()))
    own = (PRIOR_RECORDINGS * common + table.sum(axis=0)) / (PRIOR_RECORDINGS + len(table))
    return np.maximum(1.0, own)
