"""Information from weighted rows, computed in a new pass over the rows after each change of the weights."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.checked_array import Array
from armid.information.base_regressor_layout import ColumnSource
from armid.information.information import FactorOrigin, Information, JointFactors, merge
from armid.information.kept_rows import Batch, KeptRows
from armid.measurement.observations import ObservedRun

Weigh = Callable[[Batch, int], Array]
"""Function that returns the weight of each row of a batch for one joint, shape (M,). Masked rows are never used."""


def weighted_information(every: KeptRows, weigh: Weigh, *, blocks: bool = True) -> Information:
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
