"""Filtered rows of observations, which are kept between passes if they fit into memory.

Estimators and covariances read the rows several times. Each pass over a long recording computes all columns at the
full sampling rate, but the rows on the output grid are few. They are stored only if all of them fit into `KEPT`
bytes, so the memory does not grow with the length of the recordings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.information.base_regressor_layout import ColumnSource, column_source
from armid.information.filtered_rows import rows
from armid.information.hysteresis_states import with_hysteresis_states
from armid.measurement.observations import Observations
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel

KEPT = 64_000_000
"""Largest size of the rows that are stored between passes [bytes]: about 40 000 rows of a seven-joint arm."""


@dataclass(frozen=True, eq=False, slots=True)
class Batch:
    """Batch of consecutive filtered rows of a run on its output grid, which are computed together.

    Attributes:
        run: Index of the run.
        begin: Index of the first row.
        x: Columns and torque of all joints, shape (columns, M), as `armid.information.filtered_rows.rows` returns
            them.
        mask: Mask of the rows in use, shape (M, n).
        block: Block of each row, shape (M,).
    """

    run: int
    begin: int
    x: Array
    mask: NDArray[np.bool_]
    block: NDArray[np.int64]


class KeptRows:
    """Iterable over the batches of all rows of observations; it can be iterated several times.

    Attributes:
        source: Source of the columns.
        observations: The runs with their samples; rows with unknown hysteresis states are masked.
    """

    def __init__(self, source: ColumnSource, observations: Observations) -> None:
        self.source = source
        runs = tuple(with_hysteresis_states(source.model, run, observations.band) for run in observations.runs)
        self.observations = Observations(runs, observations.band)
        self._kept: list[list[Batch] | None] = [None] * len(runs)
        self._room = KEPT

    def __iter__(self) -> Iterator[Batch]:
        for index in range(len(self._kept)):
            yield from self.of_run(index)

    def of_run(self, index: int) -> Iterator[Batch]:
        """Yields the batches of the run with a given index."""
        found = self._kept[index]
        if found is not None:
            yield from found
            return
        kept: list[Batch] | None = []
        size = 0
        for batch in self._made(index):
            size += batch.x.nbytes
            if kept is not None:
                kept.append(batch)
            if size > self._room:
                kept = None
            yield batch
        if kept is not None and self._kept[index] is None:
            self._kept[index] = kept
            self._room -= size

    def part(self, runs: Sequence[int]) -> KeptRows:
        """Rows of the runs with given indices; rows that are stored already are not computed again."""
        part = object.__new__(KeptRows)
        part.source = self.source
        part.observations = Observations(tuple(self.observations.runs[k] for k in runs), self.observations.band)
        stored = [self._kept[k] for k in runs]
        part._kept = [
            None if batches is None else [replace(batch, run=number) for batch in batches]
            for number, batches in enumerate(stored)
        ]
        part._room = self._room
        return part

    def _made(self, index: int) -> Iterator[Batch]:
        """Yields the batches of a run, computed from the samples."""
        run = self.observations.runs[index]
        for begin, x in rows(self.source, run, self.observations.band):
            end = begin + x.shape[1]
            yield Batch(index, begin, x, run.mask[begin:end], run.block[begin:end])


_SHARED: WeakKeyDictionary[Observations, tuple[DynamicsModel, BaseParameters, KeptRows]] = WeakKeyDictionary()


def kept_rows(model: DynamicsModel, base: BaseParameters, observations: Observations) -> KeptRows:
    """Rows of observations in the base parameters of a model.

    Functions that read the same observations, one after the other, share the rows: the last rows are kept as long as
    the observations exist.

    Args:
        model: Arm and torque terms.
        base: Base parameters of the model.
        observations: Runs and band.
    """
    found = _SHARED.get(observations)
    if found is None or found[0] is not model or found[1] is not base:
        found = model, base, KeptRows(column_source(model, base), observations)
        _SHARED[observations] = found
    return found[2]


def runs_of(
    model: DynamicsModel, base: BaseParameters, observations: Observations, runs: Sequence[int]
) -> Observations:
    """Observations of the runs with given indices, whose rows in the base parameters are those of all observations.

    Args:
        model: Arm and torque terms.
        base: Base parameters of the model.
        observations: Runs and band.
        runs: Indices of the runs.
    """
    part = Observations(tuple(observations.runs[k] for k in runs), observations.band)
    _SHARED[part] = model, base, kept_rows(model, base, observations).part(runs)
    return part
