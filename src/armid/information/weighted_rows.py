"""Information from weighted rows, computed in a new pass over the samples after each change of the weights.

Every pass computes the rows again, in batches. The rows are stored between passes only if all of them fit into `KEPT`
bytes. The memory therefore does not grow with the length of the recordings, and short recordings are filtered only
once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.checked_array import Array
from armid.information.base_regressor_layout import ColumnSource
from armid.information.filtered_rows import rows
from armid.information.hysteresis_states import with_hysteresis_states
from armid.information.information import FactorOrigin, Information, JointFactors, merge
from armid.measurement.observations import Observations, ObservedRun

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


Weigh = Callable[[Batch, int], Array]
"""Function that returns the weight of each row of a batch for one joint, shape (M,). Masked rows are never used."""


class WeightedRows:
    """Iterable over the batches of all rows of observations; it can be iterated several times.

    Attributes:
        source: Source of the columns.
        observations: The runs with their samples; rows with unknown hysteresis states are masked.
    """

    def __init__(self, source: ColumnSource, observations: Observations) -> None:
        self.source = source
        runs = tuple(with_hysteresis_states(source.model, run, observations.band) for run in observations.runs)
        self.observations = Observations(runs, observations.band)
        self._kept: list[Batch] | None = None

    def __iter__(self) -> Iterator[Batch]:
        if self._kept is not None:
            yield from self._kept
            return
        kept: list[Batch] | None = []
        room = KEPT
        for batch in self._made():
            room -= batch.x.nbytes
            if kept is not None:
                kept.append(batch)
            if room < 0:
                kept = None
            yield batch
        self._kept = kept

    def _made(self) -> Iterator[Batch]:
        """Yields all batches, computed from the samples."""
        for index, run in enumerate(self.observations.runs):
            for begin, x in rows(self.source, run, self.observations.band):
                end = begin + x.shape[1]
                yield Batch(index, begin, x, run.mask[begin:end], run.block[begin:end])


def weighted_information(every: WeightedRows, weigh: Weigh, *, blocks: bool = True) -> Information:
    """Information of the rows, each multiplied by the square root of its weight.

    Args:
        every: All rows of the observations.
        weigh: Function that returns the weights of the rows of a batch, for one joint at a time.
        blocks: If true, the blocks stay separate; otherwise every run is one block, which is faster.

    Returns:
        Information of the weighted rows. Its field `rows` is the number of rows, independent of their weights.
    """
    runs = every.observations.runs
    names = [np.unique(run.block) if blocks else np.zeros(1, dtype=np.int64) for run in runs]
    widths = every.source.layout.widths
    factors = [[np.zeros((len(own), width, width)) for width in widths] for own in names]
    for batch in every:
        number = np.searchsorted(names[batch.run], batch.block) if blocks else np.zeros_like(batch.block)
        _add(every.source, batch, weigh, number, factors[batch.run])
    return merge([_of_run(every.source, *each) for each in zip(range(len(runs)), runs, names, factors, strict=True)])


def _add(source: ColumnSource, batch: Batch, weigh: Weigh, number: NDArray[np.int64], factors: list[Array]) -> None:
    """Weights the rows of a batch and adds them to the factors of their blocks; `number` is the block of each row."""
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(number)) + 1, [len(number)]])
    for j, whole in enumerate(factors):
        a, b = source.layout.offset[j], source.layout.offset[j + 1]
        root = np.sqrt(weigh(batch, j) * batch.mask[:, j])
        pieces = kernel.factor_columns(batch.x[a:b] * root, bounds)
        for k, R in zip(number[bounds[:-1]], pieces, strict=True):
            whole[k] = kernel.factor_columns(np.vstack([whole[k], R]).T)[0] if whole[k].any() else R


def _of_run(
    source: ColumnSource, index: int, run: ObservedRun, names: NDArray[np.int64], factors: list[Array]
) -> Information:
    """Information of one run, made from the factors of its joints and blocks, whose numbers are `names`."""
    number = np.searchsorted(names, run.block) if len(names) > 1 else np.zeros(len(run.block), dtype=np.intp)
    counted = np.zeros((len(names), source.tree.n), dtype=np.int64)
    np.add.at(counted, number, run.mask)
    joints = tuple(JointFactors(p, R) for p, R in zip(source.layout.parameters, factors, strict=True))
    return Information(
        source.names,
        joints,
        counted,
        np.full(len(names), index),
        np.full(len(names), run.recording),
        made_by=FactorOrigin(kernel.in_use(), "qr of weighted rows"),
    )
