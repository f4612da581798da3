"""Measured less predicted torque on the output grid: a second pass over a run, in the band and as recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.information.band import Band
from armid.information.filtering import filtered_columns, in_band
from armid.information.observations import ObservedRun
from armid.information.setup import ColumnSource
from armid.model.dynamics import DynamicsModel
from armid.values import Array

__all__ = ["Comparison", "columns_on_grid", "compare"]


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
    """
    predicted = model.torque(run.motion, standard)
    rows = run.rows
    if band.is_open or not run.consecutive:
        return Comparison(run.torque[rows], predicted[rows], run.torque[rows], predicted[rows], run.mask)
    measured = in_band(run.torque, run.rate, band)
    smooth = in_band(predicted, run.rate, band) if band.columns else predicted
    return Comparison(measured[rows], smooth[rows], run.torque[rows], predicted[rows], run.mask)


def columns_on_grid(source: ColumnSource, run: ObservedRun, band: Band) -> Array:
    """Columns of every joint on the output grid in the band, torque last, shape (columns, M)."""
    if band.is_open or not run.consecutive or not band.columns:
        motion = run.motion[slice(run.offset, None, run.step)]
        terms = source.term_rows(motion)
        torque = run.torque[run.rows]
        return kernel.columns(source.tree, source.layout, motion.q, motion.dq, motion.ddq, torque, terms)
    return np.concatenate([x for _, x in filtered_columns(source, run, band)], axis=1)
