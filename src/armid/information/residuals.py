"""Measured less predicted torque on the output grid: a second pass over a run, in the band and as recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.information.filtering import in_band
from armid.information.hysteresis_states import with_hysteresis_states
from armid.measurement.band import Band
from armid.measurement.observations import ObservedRun
from armid.model.dynamics import DynamicsModel
from armid.values import Array

__all__ = ["Comparison", "compare"]


@dataclass(frozen=True, eq=False, slots=True)
class Comparison:
    """Torque of one run on its output grid, M rows.

    Attributes:
        measured: In the band, shape (M, n) [N·m or N].
        predicted: In the same band, shape (M, n).
        measured_raw: As recorded, shape (M, n).
        predicted_raw: As the model says it, shape (M, n).
        mask: Which rows count, shape (M, n).
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
    """Compare a run with a model.

    Args:
        model: Arm and torque terms.
        standard: Standard parameters, or any with the same torque, shape (p,).
        run: The run.
        band: Filter of both sides; of the torque alone where the band says so.

    Returns:
        Both torques; where the model has a memory, rows before it is known do not count.

    Raises:
        ArmidError: The model has a memory, and the run's samples do not follow each other in time.
    """
    run = with_hysteresis_states(model, run, band)
    predicted = model.torque(run.motion, standard)
    rows = run.rows
    if band.is_open or not run.consecutive:
        return Comparison(run.torque[rows], predicted[rows], run.torque[rows], predicted[rows], run.mask)
    measured = in_band(run.torque, run.rate, band)
    smooth = in_band(predicted, run.rate, band) if band.columns else predicted
    return Comparison(measured[rows], smooth[rows], run.torque[rows], predicted[rows], run.mask)
