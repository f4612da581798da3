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
"""Number of left-out recordings to which the mean over all parameters is equivalent, in the mean of one parameter."""

SMALLEST_DIFFERENCE = 0.1
"""Lower limit of the difference of the variances, as a share of the variance without the recording. The difference of
two estimated variances can be zero or negative."""

LARGEST = 25.0
"""Upper limit of one squared ratio: a single parameter of a single recording must not decide the mean of all."""


def covariance_by_scales(fit: Fit, problem: EstimationProblem) -> Array:
    """Part of the covariance of a fit that uncertain torque scales cause, shape (b, b); zero if scales are exact."""
    if not problem.information.scale_deviation.any():
        return np.zeros_like(fit.covariance)
    own = Uncertainty(fit, problem)
    return scale_covariance(own.whole, fit.weights, own.inverse)


def with_recording_scatter(fit: Fit, left_out: Sequence[LeftOut], by_scales: Array, change: Array) -> Fit:
    """Adds the usual change between recordings to the covariance of a fit, and multiplies it by a larger scatter.

    Args:
        fit: Estimate from all training recordings.
        left_out: Estimates without one recording or several; without any, the fit is returned unchanged.
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
    count = sum(len(each.recordings) for each in left_out)
    own = mean.max(axis=1) < 1.0  # parameters of which each recording has its own; these contain their change
    change = np.where(own[:, None] | own, 0.0, change)
    place = [names.index(copy) for copy in copies]
    scattered = fit.covariance - by_scales + change[np.ix_(place, place)] / count
    variance = np.diag(mean @ (fit.covariance - by_scales) @ mean.T)
    factors = scatter_factors(mean @ fit.values, variance, left_out, np.diag(change))
    each = np.sqrt(factors)[place]
    own = dict(zip(names, np.sqrt(factors), strict=True))
    standard = fit.standard
    if standard is not None:
        usual = float(np.sqrt(np.mean(factors)))
        standard = _widened(standard, np.array([own.get(name.of_all, usual) for name in standard.names]))
    return replace(
        fit,
        covariance=scattered * np.outer(each, each) + by_scales,
        report=fit.report.mapped(np.diag(each)),
        standard=standard,
    )


def _widened(fit: StandardFit, factor: Array) -> StandardFit:
    """Standard parameters whose deviations and intervals are multiplied by a factor for each, shape (p,)."""
    low, high = fit.intervals.T
    bounded = (low == 0.0) & (high > 0.0)  # physics forbids negative values
    ends = fit.values[:, None] + factor[:, None] * (fit.intervals - fit.values[:, None])
    ends[bounded, 0] = 0.0
    return replace(fit, covariance=fit.covariance * np.outer(factor, factor), intervals=ends)


def scatter_factors(values: Array, variance: Array, left_out: Sequence[LeftOut], change: Array) -> Array:
    """Factor of the variance of each parameter by the scatter between recordings, at least 1, shape (b,).

    Args:
        values: Estimate from all recordings, shape (b,).
        variance: Variance of each parameter, shape (b,).
        left_out: Estimates without one recording or several.
        change: Variance of each parameter of one recording by the change of friction and offsets, shape (b,).
    """
    count = sum(len(each.recordings) for each in left_out)
    squares: list[Array] = []
    for each in left_out:
        other = np.diag(each.fit.covariance)
        difference = np.maximum(other - variance, SMALLEST_DIFFERENCE * other)
        difference += change * (1.0 / max(count - len(each.recordings), 1) - 1.0 / count)
        ratio = (each.fit.values - values) ** 2 / np.where(difference > 0.0, difference, np.inf)
        squares.append(np.minimum(ratio, LARGEST))
    table = np.array(squares)
    common = max(1.0, float(table.mean()))
    own = (PRIOR_RECORDINGS * common + table.sum(axis=0)) / (PRIOR_RECORDINGS + len(table))
    return np.maximum(1.0, own)
