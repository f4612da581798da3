"""Error of the predicted torque on another recording, compared with the error that noise and parameters explain.

Noise σ of a joint and variance v of the predicted torque by the parameters explain the variance σ² + v of the torque
error. Model error adds to it, the more the further a row is from the training motion. With model error, the variance
is taken as

    (σ² + v) max(1, v / (U v̄))^P (1 + B d),

with the mean v̄ of v over the training rows, and the largest distance d of a joint's position from its training
range, relative to this range. The variance by the change of friction and offsets from one recording to another is
added (`armid.estimation.uncertainty.recording_change`). On another recording, the RMS error of a joint still differs
from its standard deviation by a factor, because friction, offsets and sensors change otherwise than assumed. The
logarithm of the factor is taken as normally distributed, with a mean for the arm, a deviation between recordings, and
a deviation between the joints of one recording.

The deviations were measured on the recordings of eight arms: each recording, or each part of an arm's only recording,
was predicted by a model of the others (`benchmarks/bands.py`). Where an arm has several recordings, its own left-out
recordings determine the mean. Left-out parts of a single recording do not: over the arms, their factor was not
correlated with the factor on another recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from armid.checked_array import Array, array
from armid.estimation.fit_result import Fit
from armid.estimation.uncertainty.recording_change import RecordingChange, mean_parameter_variance
from armid.information.information import Information
from armid.measurement.observations import Observations

FAR = 4.0
"""Ratio U of the variance v of the predicted torque to its mean over the training rows, above which a row counts as
unlike the training motion. The covariance describes noise; where the motion differs, the error of the model acts on
the parameters as well. The constants U, P and B were chosen with the recordings of eight arms; each recording was
predicted by a model without it. Without these constants, the intervals of a model from a single recording contained
63 % of the rows of one arm, and 30 % of the rows of one of its joints; with them, 91 % and 72 %."""

GROWTH = 0.8
"""Exponent P in the module's formula: additional growth of the variance of the torque error with the variance v."""

OUTSIDE = 8.0
"""Factor B in the module's formula: growth of the variance of the torque error with the distance of a position from
the training range, relative to this range."""

SMALL_RANGE = 0.1
"""Range [rad or m] that is added to the training range of a joint before a distance is divided by it, because a joint
that stood still in training has no range."""

BETWEEN_ARMS = 0.2
"""Standard deviation between arms of the mean logarithm of the factor (RMS error divided by its predicted standard
deviation), used before any recording of the arm was left out; measured over the eight arms. The largest means, up to
0.5, were those of arms whose single training recording had another speed."""

BETWEEN_RECORDINGS = 0.25
"""Standard deviation, between the recordings of one arm, of the mean logarithm of the factor; measured values are
0.06 to 0.26."""

PRIOR_RECORDINGS = 3.0
"""Weight of the values `BETWEEN_RECORDINGS` and `BETWEEN_JOINTS`, as an equivalent number of left-out recordings."""

BETWEEN_JOINTS = 0.4
"""Standard deviation, between the joints of one recording, of the logarithm of the factor; measured values are 0.17
to 0.6."""

OTHER_MOTION = 0.45
"""Additional standard deviation of the logarithm of the error on another recording if its motion is not yet known."""

NINETY = 1.6448536269514722
"""Quantile 0.95 of the normal distribution, for two-sided 90 % intervals."""


@dataclass(frozen=True, eq=False, slots=True)
class PredictionError:
    """Facts about the training recordings that determine how far a prediction for another recording can be trusted.

    Attributes:
        recordings: Number of training recordings.
        parameter_variance: Variance of the predicted torque that the uncertainty of the parameters causes, mean over
            the training rows of each joint, shape (n,) [(N·m)² or N²].
        positions: Smallest and largest position of each joint in the training rows, shape (n, 2) [rad or m].
        log_factor: Mean of the logarithm of the factor: RMS error on another recording divided by the standard
            deviation with model error.
        log_deviation: Standard deviation of the logarithm of the factor for a joint of another recording.
        without_effect: Part of the covariance of the parameters that causes no error of the predicted torque, shape
            (b, b); empty if there is none. It contains the uncertainty of the torque scales, such as drive gains,
            because the measured torque of another recording has the same scales. It contains the misfit of the prior,
            which describes the error of single links; for the error of torques, the weight of the prior with the
            smallest held-out error is decisive. If recordings are left out in turn, it also contains systematic
            errors and the scatter between recordings, because the left-out errors contain their effect. Systematic
            errors are the same in other recordings, so that most of their effect cancels.
        change: Change of friction and offsets from the training recordings to another one.
    """

    recordings: int
    parameter_variance: Array
    positions: Array
    log_factor: float = 0.0
    log_deviation: float = float(np.sqrt(BETWEEN_ARMS**2 + BETWEEN_RECORDINGS**2 + BETWEEN_JOINTS**2))
    without_effect: Array = field(default_factory=lambda: np.zeros((0, 0)), metadata={"stored": "by_scales"})
    change: RecordingChange = field(default_factory=RecordingChange)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameter_variance", array(self.parameter_variance, (None,), "parameter_variance"))
        n = len(self.parameter_variance)
        object.__setattr__(self, "positions", array(self.positions, (n, 2), "positions"))
        object.__setattr__(self, "without_effect", array(self.without_effect, (None, None), "without_effect"))

    def effective(self, covariance: Array) -> Array:
        """Covariance (b, b) of the parameters without the part that causes no error of the predicted torque."""
        return covariance - self.without_effect if self.without_effect.size else covariance


@dataclass(frozen=True, eq=False, slots=True)
class ExpectedError:
    """Expected RMS torque error of each joint on another recording whose motion is similar to the training motion.

    Attributes:
        rms: Expected RMS error, shape (n,) [N·m or N].
        low: Lower end of the 90 % interval, shape (n,) [N·m or N].
        high: Upper end of the 90 % interval, shape (n,) [N·m or N].
    """

    rms: Array
    low: Array
    high: Array


def prediction_error(
    information: Information,
    fit: Fit,
    observations: Observations,
    change: RecordingChange,
    by_scales: Array | None = None,
    *,
    left_out: bool = True,
) -> PredictionError:
    """Collects the facts about training recordings for prediction intervals, before any recording is left out.

    Args:
        information: Factors of the training recordings, in the parameters of the fit.
        fit: Estimate with its covariance.
        observations: The training recordings.
        change: Change of friction and offsets to another recording.
        by_scales: Part of the covariance by uncertain torque scales, shape (b, b); `None` if the scales are exact.
        left_out: True if recordings are left out in turn, whose errors contain the effect of systematic errors.
    """
    parts = [fit.report.by_misfit, *([fit.report.by_systematic] if left_out else [])]
    parts = [part for part in (by_scales, *parts) if part is not None and part.size]
    without_effect = np.sum(parts, axis=0) if parts else np.zeros((0, 0))
    covariance = fit.covariance - without_effect if parts else fit.covariance
    return PredictionError(
        len(np.unique(information.recording)),
        mean_parameter_variance(information, covariance),
        position_range(observations),
        change=change,
        without_effect=without_effect,
    )


def with_model_error(training: PredictionError, share: Array, noise: Array, positions: Array) -> Array:
    """Variance of the torque error by noise, parameters and model error on M rows, shape (M, n) [(N·m)² or N²].

    Args:
        training: Facts about the training recordings.
        share: Variance v of the predicted torque by the parameters, shape (M, n) or (n,) [(N·m)² or N²].
        noise: Standard deviation σ of the torque about the model, shape (n,) [N·m or N].
        positions: Joint positions, shape (M, n) [rad or m].
    """
    tiny = np.finfo(float).tiny
    unlike = np.maximum(1.0, share / np.maximum(FAR * training.parameter_variance, tiny)) ** GROWTH
    low, high = training.positions.T
    distance = np.maximum(np.maximum(low - positions, positions - high), 0.0) / (high - low + SMALL_RANGE)
    outside = 1.0 + OUTSIDE * distance.max(axis=1, keepdims=True)
    return np.maximum((noise**2 + share) * unlike * outside, tiny)


def position_range(observations: Observations) -> Array:
    """Smallest and largest position of each joint in the rows in use, shape (n, 2) [rad or m]."""
    used = [run.motion.q[run.rows][run.mask.any(axis=1)] for run in observations.runs]
    q = np.concatenate(used)
    return np.stack([q.min(axis=0), q.max(axis=0)], axis=1)


def updated(error: PredictionError, log_factors: Sequence[Array]) -> PredictionError:
    """Updates the distribution of the factor with the errors on left-out recordings of the arm.

    The factor is the RMS error of a joint on another recording divided by its predicted standard deviation.
    Mean and deviation are those of the posterior for normal distributions: the mean of the arm has the prior mean 0
    and the deviation `BETWEEN_ARMS`. The deviations between recordings and between joints are those of the left-out
    recordings, combined with `PRIOR_RECORDINGS` further recordings that have the deviations `BETWEEN_RECORDINGS` and
    `BETWEEN_JOINTS`.

    Args:
        error: Facts about the training recordings.
        log_factors: Logarithm of the factor on each left-out recording, for each of its joints that have rows.
    """
    known = [each for each in log_factors if len(each)]
    if not known:
        return error
    each = np.array([joints.mean() for joints in known])
    squares = PRIOR_RECORDINGS * BETWEEN_RECORDINGS**2 + float(np.sum((each - each.mean()) ** 2))
    between = squares / (PRIOR_RECORDINGS + len(each) - 1)
    precision = BETWEEN_ARMS**-2 + len(each) / between
    mean = each.sum() / between / precision
    shown = [joints.var(ddof=1) for joints in known if len(joints) > 1]
    joints = (PRIOR_RECORDINGS * BETWEEN_JOINTS**2 + sum(shown)) / (PRIOR_RECORDINGS + len(shown))
    deviation = np.sqrt(1.0 / precision + between + joints)
    return replace(error, log_factor=float(mean), log_deviation=float(deviation))


def expected_error(error: PredictionError, noise: Array) -> ExpectedError:
    """RMS torque error that is expected on another recording, before that recording is known.

    Args:
        error: Facts about the training recordings.
        noise: Standard deviation of the torque of each joint about the model, shape (n,) [N·m or N].
    """
    change = error.change.variance if error.change.known else 0.0
    center = np.exp(error.log_factor) * np.sqrt(noise**2 + error.parameter_variance + change)
    factor = float(np.exp(NINETY * np.hypot(error.log_deviation, OTHER_MOTION)))
    return ExpectedError(center, center / factor, center * factor)
