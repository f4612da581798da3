"""Rows of the regressor of a run, computed in batches in a second pass over the samples.

Robust weights, tests of whiteness and noise spectra need single rows, which cannot be computed from the triangular
factors of the information. The rows are filtered and lie on the output grid; the factors were computed from the same
rows. Only one batch of rows is in memory at a time.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.information.base_regressor_layout import ColumnSource
from armid.information.filtering import filtered_columns, filtered_torque
from armid.information.hysteresis_states import with_hysteresis_states
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import ObservedRun

BATCH = 8192
"""Number of rows in memory at a time: 14 MB for a seven-joint arm."""


def rows(source: ColumnSource, run: ObservedRun, band: Band) -> Iterator[tuple[int, Array]]:
    """Filtered regressor columns and torque of every joint on the output grid, in batches.

    The mask of the run is not applied. For a model with hysteresis, the mask must also exclude the rows with unknown
    states: pass a run from `armid.information.hysteresis_states.with_hysteresis_states` and use its mask.

    Args:
        source: Source of the columns. Joint j has columns `layout.offset[j]` to `layout.offset[j + 1] - 1`; the last
            one of them is its torque.
        run: The run; its hysteresis states are computed if it has none yet.
        band: Filter of torque and columns, or of the torque only if `band.columns` is false.

    Yields:
        Index of the first row of the batch, and columns of all joints at its M rows, shape (columns, M).

    Raises:
        ArmidError: The model has hysteresis, and the samples of the run are not consecutive.
    """
    run = with_hysteresis_states(source.model, run, band)
    if not band.is_open and run.consecutive and band.columns:
        yield from filtered_columns(source, run, band)
        return
    torque = run.torque if band.is_open or not run.consecutive else filtered_torque(run, band)
    for begin in range(0, len(run.rows), BATCH):
        chosen = run.rows[begin : begin + BATCH]
        motion = run.motion[slice(int(chosen[0]), int(chosen[-1]) + 1, run.step)]
        terms = source.term_rows(motion)
        yield (
            begin,
            kernel.columns(source.tree, source.layout, motion.q, motion.dq, motion.ddq, torque[chosen], terms),
        )


def all_rows(source: ColumnSource, run: ObservedRun, band: Band) -> Array:
    """Filtered regressor columns and torque of a whole short run in one array, shape (columns, M)."""
    batches = [x for _, x in rows(source, run, band)]
    return batches[0] if len(batches) == 1 else np.concatenate(batches, axis=1)
