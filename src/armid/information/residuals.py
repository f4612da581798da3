"""Residuals: measured minus predicted torque of a run on its output grid, filtered and as recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.information.filtering import in_band
from armid.information.hysteresis_states import with_hysteresis_states
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import ObservedRun
from armid.model.dynamics_model import DynamicsModel


@dataclass(frozen=True, eq=False, slots=True)
class Comparison:
    """Measured and predicted torque of one run at the M rows of its output grid.

    Attributes:
        measured: Measured torque after the filter, shape (M, n) [N·m or N].
        predicted: Predicted torque after the same filter, shape (M, n) [N·m or N].
        measured_raw: Measured torque as recorded, without a filter, shape (M, n) [N·m or N].
        predicted_raw: Predicted torque without a filter, shape (M, n) [N·m or N].
        mask: Mask of the rows in use, shape (M, n).
    """

    measured: Array
    predicted: Array
    measured_raw: Array
    predicted_raw: Array
    mask: NDArray[np.bool_]

    @property
    def residual(self) -> Array:
        """Measured minus predicted torque after the filter, shape (M, n) [N·m or N]."""
        return self.measured - self.predicted

    @property
    def residual_raw(self) -> Array:
        """Measured minus predicted torque without a filter, shape (M, n) [N·m or N]."""
        return self.measured_raw - self.predicted_raw


def compare(model: DynamicsModel, standard: Array, run: ObservedRun, band: Band) -> Comparison:
    """Compares the measured torque of a run with the torque that a model predicts.

    Args:
        model: Arm and torque terms.
        standard: Standard parameters, or other values that give the same torque, shape (p,).
        run: Contiguous run with the motion and the measured torque.
        band: Filter of measured and predicted torque, or of the measured torque only if `band.columns` is false.

    Returns:
        Measured and predicted torque; rows with unknown hysteresis states are masked.

    Raises:
        ArmidError: The model has hysteresis, and the samples of the run are not consecutive.
    """
    run = with_hysteresis_states(model, run, band)
    predicted = model.torque(run.motion, standard)
    rows = run.rows
    if band.is_open or not run.consecutive:
        return Comparison(run.torque[rows], predicted[rows], run.torque[rows], predicted[rows], run.mask)
    measured = in_band(run.torque, run.rate, band)
    smooth = in_band(predicted, run.rate, band) if band.columns else predicted
    return Comparison(measured[rows], smooth[rows], run.torque[rows], predicted[rows], run.mask)
