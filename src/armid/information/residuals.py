"""Measured less predicted torque on the output grid, filtered and as recorded, from a second pass over a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.information.filtering import in_band
from armid.information.hysteresis_states import with_hysteresis_states
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import ObservedRun
from armid.model.dynamics import DynamicsModel
from armid.values import Array


@dataclass(frozen=True, eq=False, slots=True)
class Comparison:
    """Measured and predicted torque of one run on its output grid, M rows.

    Attributes:
        measured: Filtered measured torque, shape (M, n) [N·m or N].
        predicted: Predicted torque through the same filter, shape (M, n).
        measured_raw: Measured torque as recorded, shape (M, n).
        predicted_raw: Predicted torque without a filter, shape (M, n).
        mask: Rows in use, shape (M, n).
    """

    measured: Array
    predicted: Array
    measured_raw: Array
    predicted_raw: Array
    mask: NDArray[np.bool_]

    @property
    def residual(self) -> Array:
        """Measured less predicted in the band, shape (M, n)."""
        return self.measured - self.predicted

    @property
    def residual_raw(self) -> Array:
        """Measured less predicted as recorded, shape (M, n)."""
        return self.measured_raw - self.predicted_raw


def compare(model: DynamicsModel, standard: Array, run: ObservedRun, band: Band) -> Comparison:
    """Compare the torque of a run with that of a model.

    Args:
        model: Arm and torque terms.
        standard: Standard parameters, or others with the same torque, shape (p,).
        run: The run.
        band: Filter of both sides, or of the torque alone where `band.columns` is false.

    Returns:
        Both torques; rows with unknown hysteresis states are masked.

    Raises:
        ArmidError: The model has hysteresis, and the run's samples are not consecutive.
    """
    run = with_hysteresis_states(model, run, band)
    predicted = model.torque(run.motion, standard)
    rows = run.rows
    if band.is_open or not run.consecutive:
        return Comparison(run.torque[rows], predicted[rows], run.torque[rows], predicted[rows], run.mask)
    measured = in_band(run.torque, run.rate, band)
    smooth = in_band(predicted, run.rate, band) if band.columns else predicted
    return Comparison(measured[rows], smooth[rows], run.torque[rows], predicted[rows], run.mask)
