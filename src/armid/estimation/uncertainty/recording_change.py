"""Change of friction and offsets between recordings, for the prediction of a recording that is made on another day.

Friction changes with temperature, load history and grease, and torque sensors and currents have other offsets after
each start. One recording does not contain these changes, so usual changes are assumed: all friction of a joint is
multiplied by one factor, and its torque gets another offset. If several recordings were left out in turn, their
errors contain the changes. These errors correct the assumed size of all errors together
(`armid.estimation.uncertainty.prediction_error`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armid.checked_array import Array, array
from armid.estimation.friction_per_recording import changing_parameters
from armid.information.information import Information, total
from armid.measurement.observations import Observations
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Offset

FRICTION = 0.06
"""Relative standard deviation of the friction of a joint between recordings. On four arms with several recordings, it
was 0.01 to 0.45 for joints with considerable friction, and 0.06 in the median; between the five recordings of one day
of one of the arms, it was 0.01."""

OFFSET = 0.004
"""Standard deviation of the offset of a joint torque between recordings, as a share of the range of the torque. On
four arms with several recordings it was 0.001 to 0.09, and 0.005 in the median; a part of it is the uncertainty of
the estimates."""


@dataclass(frozen=True, eq=False, slots=True)
class RecordingChange:
    """Variance of the torque by the change of friction and offsets from the training recordings to another one.

    Attributes:
        covariance: Covariance of the base parameters by the change of friction and offsets, shape (b, b).
        offset: Standard deviation of the torque offset of each joint whose model has no offset, 0 for other joints,
            shape (n,) [N·m or N].
        variance: Variance of the torque by both, mean over the training rows of each joint, shape (n,) [(N·m)² or
            N²].
    """

    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    offset: Array = field(default_factory=lambda: np.zeros(0))
    variance: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def known(self) -> bool:
        """True if the change was computed; false in runs of earlier versions, which did not store it."""
        return bool(self.covariance.size)

    def __post_init__(self) -> None:
        object.__setattr__(self, "covariance", array(self.covariance, (None, None), "covariance"))
        object.__setattr__(self, "offset", array(self.offset, (None,), "offset"))
        object.__setattr__(self, "variance", array(self.variance, (None,), "variance"))


def recording_change(
    model: DynamicsModel, base: BaseParameters, values: Array, information: Information, observations: Observations
) -> RecordingChange:
    """Computes the usual change of friction and offsets between recordings, from the estimated friction of an arm.

    Args:
        model: Arm and torque terms.
        base: Base parameters of the model.
        values: Estimated base parameters, shape (b,).
        information: Factors of the training recordings, in the base parameters.
        observations: The training recordings.
    """
    kinds = np.array([parameter.kind for parameter in model.parameters])[base.kept]
    friction = changing_parameters(model)[base.kept] & (kinds != Offset.name)
    joint = np.array([name.number or 0 for name in base.names])
    changed = FRICTION * np.where(friction, values, 0.0)
    covariance = np.outer(changed, changed) * (joint[:, None] == joint)
    offset = OFFSET * torque_range(observations)
    for k in np.flatnonzero(kinds == Offset.name):
        covariance[k, k] = offset[joint[k] - 1] ** 2
        offset[joint[k] - 1] = 0.0
    return RecordingChange(covariance, offset, mean_parameter_variance(information, covariance) + offset**2)


def torque_range(observations: Observations) -> Array:
    """Largest minus smallest measured torque of each joint in the rows in use, shape (n,) [N·m or N]."""
    low, high = np.inf, -np.inf
    for run in observations.runs:
        torque = run.torque[run.rows]
        low = np.minimum(low, np.where(run.mask, torque, np.inf).min(axis=0))
        high = np.maximum(high, np.where(run.mask, torque, -np.inf).max(axis=0))
    return np.maximum(np.asarray(high - low), 0.0)


def mean_parameter_variance(information: Information, covariance: Array) -> Array:
    """Variance of the predicted torque, mean over the rows of each joint, shape (n,) [(N·m)² or N²].

    Args:
        information: Factors of the rows.
        covariance: Covariance of the base parameters, shape (b, b).
    """
    whole = total(information)
    variance = np.zeros(whole.n)
    for j, joint in enumerate(whole.joints):
        R = joint.R[0, :, :-1]
        own = covariance[np.ix_(joint.parameters, joint.parameters)]
        variance[j] = np.sum((R @ own) * R) / max(int(whole.rows[0, j]), 1)
    return np.maximum(variance, 0.0)
