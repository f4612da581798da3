"""Prediction interval (95 %) of the torque on another recording.

If x is a row of the regressor, Σ the covariance of the parameters and σ the noise of the joint, noise and parameters
explain the variance v + σ² with v = xᵀ Σ x. The variance on another recording is larger by model error and by the
change of friction and offsets, and the standard deviation is multiplied by a lognormal factor
(`armid.estimation.uncertainty.prediction_error`).

The degrees of freedom of v are those of the parameters. The noise has many degrees of freedom, so their number is
taken as infinite. The degrees of freedom of the sum are computed as in [Satterthwaite1946].
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.estimate_record import Estimate
from armid.estimation.fit_result import Fit
from armid.estimation.uncertainty.prediction_error import with_model_error
from armid.information.base_regressor_layout import column_source
from armid.information.filtered_rows import all_rows
from armid.maths.distributions import NORMAL, scale_mixture_quantile, student_quantile
from armid.maths.median import median
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion

SMALLEST_SHARE = 1e-3
"""Lower limit of the share of the variance that comes from the uncertainty of the parameters. It limits the degrees
of freedom of the interval."""

PART = 8192
"""Number of samples whose regressor columns are computed at a time."""


def torque_band(model: DynamicsModel, estimate: Estimate, motion: Motion) -> Array:
    """Half width of the 95 % prediction interval along a motion, shape (N, n) [N·m or N].

    The interval is valid for the torque in the band of the estimate. Sensor noise outside the band is not included.

    Args:
        model: Arm and torque terms of the estimate.
        estimate: The estimate.
        motion: N samples, with hysteresis states if the model has any.
    """
    widths = [band_of_rows(model, estimate, part) for part in _parts(motion)]
    return np.concatenate([np.zeros((0, model.n)), *widths])


def _parts(motion: Motion) -> Iterator[Observations]:
    """Observations of `PART` samples at a time without a filter; the measured torque is zero."""
    for first in range(0, motion.samples, PART):
        part = motion[slice(first, first + PART)]
        rows = np.ones(part.q.shape, dtype=np.bool_)
        run = ObservedRun(part, np.zeros(rows.shape), 1.0, 1, 0, rows, np.zeros(len(rows), dtype=np.int64))
        yield Observations((run,), Band())


def parameter_covariance(estimate: Estimate) -> Array:
    """Covariance (b, b) of the base parameters for the prediction of another recording.

    It contains the uncertainty of the estimate, and the change of parameters between recordings if it is known. If
    the errors on left-out recordings are smaller than expected, it is multiplied by the square of the factor, so that
    the torque of drawn parameters spreads no further than the prediction interval.

    Args:
        estimate: The estimate.
    """
    return min(1.0, _factor(estimate)) ** 2 * np.sum(_covariances(estimate), axis=0)


def _factor(estimate: Estimate) -> float:
    """Standard deviation of the torque error on another recording, divided by the one expected without the factor."""
    training = estimate.prediction
    if training is None:
        return 1.0
    return float(np.exp(training.log_factor)) * scale_mixture_quantile(training.log_deviation) / NORMAL


def _covariances(estimate: Estimate) -> list[Array]:
    """Covariances (b, b) of the base parameters: by uncertainty, then by their change between recordings if known."""
    base, fit, training = estimate.base, estimate.fit, estimate.prediction
    if training is not None:
        fit = replace(fit, covariance=training.effective(fit.covariance))
    covariances = [_covariance_of_means(base, fit)]
    if training is not None and training.change.known:
        covariances.append(_change_of_common(base, fit, training.change.covariance))
    return covariances


def band_of_rows(model: DynamicsModel, estimate: Estimate, observations: Observations, every: int = 1) -> Array:
    """Half width of the 95 % prediction interval on every k-th row of all runs, shape (M, n) [N·m or N].

    Args:
        model: Arm and torque terms of the estimate.
        estimate: The estimate.
        observations: Contiguous runs and the band of their filter.
        every: Number k: the interval is computed on every k-th row.
    """
    fit, training = estimate.fit, estimate.prediction
    share, *by_change = _parameter_variances(model, estimate.base, _covariances(estimate), observations, every)
    variance = share + fit.noise**2
    if training is not None:
        positions = np.concatenate([run.motion.q[run.rows][::every] for run in observations.runs])
        variance = with_model_error(training, share, fit.noise, positions)
        for each in by_change:
            variance = variance + each + training.change.offset**2
    return _half_width(estimate, share, variance)


def torque_error_deviation(model: DynamicsModel, estimate: Estimate, motion: Motion | None = None) -> Array:
    """Standard deviation of the torque error that the base parameters do not cause, shape (n,) [N·m or N].

    The variance of a normal distribution with the 95 % interval of the prediction is the sum of the variance by the
    covariance of the parameters (`parameter_covariance`), and of that by noise, model error and change of offsets.
    The root of the second part is returned, as root mean square over the samples.

    Args:
        model: Arm and torque terms of the estimate.
        estimate: The estimate.
        motion: N samples of a motion; if not given, a motion like the training motion.

    Raises:
        EstimationError: The motion has no samples.
    """
    if motion is None:
        return _torque_error_deviation_in_training(estimate)
    if motion.samples == 0:
        raise EstimationError(
            "The error of the torque cannot be computed for a motion without samples.", remedy="give another motion."
        )
    covariance, variance = parameter_covariance(estimate), np.zeros(model.n)
    for part in _parts(motion):
        whole = (band_of_rows(model, estimate, part) / NORMAL) ** 2
        (by_parameters,) = _parameter_variances(model, estimate.base, [covariance], part, 1)
        variance += np.sum(whole - by_parameters, axis=0)
    return np.sqrt(np.maximum(variance / motion.samples, 0.0))


def _torque_error_deviation_in_training(estimate: Estimate) -> Array:
    """`torque_error_deviation` for a motion like the training motion, from the mean variances of its rows, (n,)."""
    fit, training = estimate.fit, estimate.prediction
    if training is None:
        return fit.noise
    share, change = training.parameter_variance, training.change
    by_change, by_offset = (change.variance, change.offset**2) if change.known else np.zeros((2, len(share)))
    whole = (_half_width(estimate, share, share + fit.noise**2 + by_change) / NORMAL) ** 2
    by_parameters = min(1.0, _factor(estimate)) ** 2 * (share + np.maximum(by_change - by_offset, 0.0))
    return np.sqrt(np.maximum(whole - by_parameters, 0.0))


def _half_width(estimate: Estimate, share: Array, variance: Array) -> Array:
    """Half width of the 95 % prediction interval, shape of the variances [N·m or N].

    Args:
        estimate: The estimate.
        share: Variance of the torque by the uncertainty of the parameters, last axis n.
        variance: Variance of the torque error on another recording, before the lognormal factor, same shape.
    """
    fit = estimate.fit
    explained = np.maximum(share + fit.noise**2, np.finfo(float).tiny)
    free = median(fit.freedom) * (explained / np.maximum(share, SMALLEST_SHARE * explained)) ** 2
    size = np.sqrt(np.maximum(variance, np.finfo(float).tiny))
    return np.asarray(_factor(estimate) * student_quantile(free) * size, dtype=np.float64)


def _covariance_of_means(base: BaseParameters, fit: Fit) -> Array:
    """Covariance (b, b) of the base parameters for the prediction of a recording.

    If a parameter has one value for each recording, its covariance is that of the mean of these values. The variance
    between recordings is added, because the value of a new recording differs from the mean.
    """
    copies = [name.of_all for name in fit.names]
    mean = np.array([[name == copy for copy in copies] for name in base.names], dtype=np.float64)
    count = mean.sum(axis=1)
    mean /= count[:, None]
    spread = np.array(
        [np.var(fit.values[row > 0.0], ddof=1) if k > 1 else 0.0 for row, k in zip(mean, count, strict=True)]
    )
    return mean @ fit.covariance @ mean.T + np.diag(spread)


def _change_of_common(base: BaseParameters, fit: Fit, change: Array) -> Array:
    """Covariance (b, b) of the change between recordings, set to zero for parameters with one value per recording.

    For these parameters, `_covariance_of_means` already contains the variance between recordings.

    Args:
        base: Base parameters.
        fit: The estimate.
        change: Covariance of the change for all base parameters, shape (b, b).
    """
    separate = {name.of_all for name in fit.names if name.recording}
    common = np.array([name not in separate for name in base.names])
    return change * np.outer(common, common)


def _parameter_variances(
    model: DynamicsModel, base: BaseParameters, covariances: Sequence[Array], observations: Observations, every: int
) -> list[Array]:
    """Variance of the predicted torque for each covariance of the parameters, shape (M, n) each [(N·m)² or N²].

    Args:
        model: Arm and torque terms.
        base: Base parameters of the model.
        covariances: Covariances of the base parameters, shape (b, b) each.
        observations: Contiguous runs and the band of their filter.
        every: Number k: the variances are computed on every k-th row, M rows in total.
    """
    source = column_source(model, base)
    sparse = [
        replace(run, step=run.step * every, mask=run.mask[::every], block=run.block[::every], repetition=None)
        for run in observations.runs
    ]
    x = np.concatenate([all_rows(source, run, observations.band) for run in sparse], axis=1)
    variances = [np.empty((x.shape[1], model.n)) for _ in covariances]
    for j, parameters in enumerate(source.layout.parameters):
        y = x[source.layout.offset[j] : source.layout.offset[j + 1] - 1]
        for variance, covariance in zip(variances, covariances, strict=True):
            variance[:, j] = np.einsum("km,km->m", covariance[np.ix_(parameters, parameters)] @ y, y)
    return variances
