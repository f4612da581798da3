"""The regressor's rows of a run, a segment at a time, for what factors cannot say: a second pass over the samples.

Robust weights, whiteness and bands need rows one by one. They come in the band and on the output grid, exactly those
that went into the factors, and never all at once.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armid import kernel
from armid.information.column_source import ColumnSource
from armid.information.filtering import filtered_columns, filtered_torque
from armid.information.hysteresis_states import with_hysteresis_states
from armid.measurement.band import Band
from armid.measurement.observations import ObservedRun
from armid.values import Array

__all__ = ["all_rows", "rows"]

SEGMENT = 8192
"""Rows held at a time: 14 MB for a seven-joint arm."""


def rows(source: ColumnSource, run: ObservedRun, band: Band) -> Iterator[tuple[int, Array]]:
    """Columns and torque of every joint on the output grid in the band, a segment at a time.

    Which rows count is not said here, and where the model has a memory it is fewer than the run's own mask says:
    give a run that has passed `armid.information.hysteresis_states.with_hysteresis_states`, and use its mask.

    Args:
        source: Makes the columns; joint j has rows `layout.offset[j]` to `layout.offset[j + 1] - 1`, torque last.
        run: The run; what the model remembers of it is followed here where that has not been done.
        band: Filter of both sides, or of the torque alone where the band says so.

    Yields:
        First row of the segment, and its columns, shape (columns, M).

    Raises:
        ArmidError: The model has a memory, and the run's samples do not follow each other in time.
    """
    run = with_hysteresis_states(source.model, run, band)
    if not band.is_open and run.consecutive and band.columns:
        yield from filtered_columns(source, run, band)
        return
    torque = run.torque if band.is_open or not run.consecutive else filtered_torque(run, band)
    for begin in range(0, len(run.rows), SEGMENT):
        chosen = run.rows[begin : begin + SEGMENT]
        motion = run.motion[slice(int(chosen[0]), int(chosen[-1]) + 1, run.step)]
        terms = source.term_rows(motion)
        yield (
            begin,
            kernel.columns(source.tree, source.layout, motion.q, motion.dq, motion.ddq, torque[chosen], terms),
        )


def all_rows(source: ColumnSource, run: ObservedRun, band: Band) -> Array:
    """All rows at once, shape (columns, M); for runs that are known to be short."""
    return np.concatenate([x for _, x in rows(source, run, band)], axis=1)
