"""Information of observations, computed in one pass without storing the regressor at the full sampling rate.

Without a filter, the rows of all samples are added to the factors directly. With a filter, the torque and all columns
of the regressor pass the same filter: first a linear-phase decimation in the kernel, then the sharp filter. Both
process one batch of rows after another, so the memory does not grow with the length of the recording. Hysteresis
states are computed before filtering, once for the whole run at the full sampling rate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.checked_array import Array
from armid.errors import ArmidError
from armid.information.base_regressor_layout import ColumnSource, column_source
from armid.information.filtering import filtered_columns, filtered_torque
from armid.information.hysteresis_states import require_consecutive, with_hysteresis_states
from armid.information.information import FactorOrigin, Information, JointFactors, merge, stack, total
from armid.maths.linalg import scaled_condition
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.threads import one_blas_thread

Progress = Callable[[int, int], None]
"""Function that is called to report progress, with the number of processed samples and the number of all samples."""

CHUNK = 8192
"""Number of samples whose columns of torque terms are in memory at a time: 1 MB for a seven-joint arm."""

GRAM_ROWS = 20_000
"""Largest number of rows for which the factors are always computed by QR, which takes milliseconds."""

GRAM_CONDITION = 60.0
"""Largest condition number of the columns, scaled to unit length, for which Cholesky factors of the products of
columns are used in place of QR. Their relative error, ε times the square of this number, is then below 1e-12."""

GRAM_RESIDUAL = 1e-5
"""Smallest ratio of the norm of a joint's residual to the norm of its torque for which Cholesky factors of the
products of columns are used in place of QR. It is √ε with a margin."""


@one_blas_thread
def accumulate_information(
    model: DynamicsModel,
    base: BaseParameters,
    observations: Observations,
    *,
    threads: int = 1,
    progress: Progress | None = None,
) -> Information:
    """Computes the information that observations contain about the base parameters.

    The factors are computed by QR. For long unfiltered recordings, the Cholesky factor of the products of the columns
    is computed first, which is twice as fast. It is used only if condition number and residual prove that it is as
    accurate as QR.

    Args:
        model: Arm and torque terms.
        base: Base parameters of the model.
        observations: Contiguous runs and the band of their filter.
        threads: Number of threads that compute the blocks of unfiltered runs.
        progress: Function that is called to report progress.

    Raises:
        ArmidError: The observations have another number of joints than the model, or no row is in use. For a model
            with hysteresis, also: the samples are not consecutive, or the motion never determines the hysteresis
            states.
    """
    if not any(run.mask.any() for run in observations.runs):
        raise ArmidError(
            "No row of the recordings is in use: all rows are masked or trimmed.",
            remedy="record for longer, trim less, or change the keys `slow`, `saturation` and `exclude` so that they "
            "mask fewer rows.",
        )
    for run in observations.runs:
        if run.motion.n != model.n:
            raise ArmidError(
                f"The motion of a run has {run.motion.n} joints; {model.robot.name} has {model.n}.",
                remedy="give the motion of this arm.",
            )
    source = column_source(model, base)
    long = sum(len(run.block) for run in observations.runs if _is_raw(run, observations.band)) > GRAM_ROWS
    if long:
        information = _inform(source, observations, threads, progress, by_gram=True)
        if _is_exact(information):
            return information
        del information
    return _inform(source, observations, threads, progress, by_gram=False)


def _is_raw(run: ObservedRun, band: Band) -> bool:
    """Checks whether the rows of a run are added to the factors without filtering the regressor columns."""
    return band.is_open or not run.consecutive or not band.columns


def _is_exact(information: Information) -> bool:
    """Checks whether the Cholesky factors of the products of columns are as accurate as factors by QR."""
    whole = total(information)
    torque = np.array([np.linalg.norm(joint.R[0, :, -1]) for joint in whole.joints])
    residual = np.array([abs(joint.R[0, -1, -1]) for joint in whole.joints])
    if (residual < GRAM_RESIDUAL * torque).any():
        return False
    # Weights of joints change the condition number; it is checked for the two sets that estimation uses.
    by_residual = 1.0 / np.where(residual > 0.0, residual, 1.0)
    return all(scaled_condition(stack(whole, weights)[0]) <= GRAM_CONDITION for weights in (None, by_residual))


def _inform(
    source: ColumnSource,
    observations: Observations,
    threads: int,
    progress: Progress | None,
    *,
    by_gram: bool,
) -> Information:
    """Computes the information of all runs; the blocks of all runs are numbered consecutively."""
    samples = sum(run.motion.samples for run in observations.runs)
    done = 0
    parts: list[Information] = []
    for index, given in enumerate(observations.runs):
        run = with_hysteresis_states(source.model, given, observations.band)
        raw = _is_raw(run, observations.band)
        computed = (
            _raw_blocks(source, run, observations.band, threads, by_gram=by_gram)
            if raw
            else _filtered_blocks(source, run, observations.band)
        )
        names = np.unique(run.block[_borders(run)[:-1]])
        factors = [np.zeros((len(names), width, width)) for width in source.layout.widths]
        filled = np.zeros(len(names), dtype=np.bool_)
        for R, block, samples_done in computed:
            _collect(kernel.unpack_factors(source.layout, R), np.searchsorted(names, block), factors, filled)
            if progress is not None:
                progress(done + samples_done, samples)
        done += run.motion.samples
        method = "products" if raw and by_gram else "qr"
        parts.append(_of_run(source, run, index, factors, method))
    whole = merge(parts)
    require_consecutive(source.model, observations, whole.rows.sum(axis=0))
    return whole


def _collect(
    new: tuple[Array, ...], blocks: NDArray[np.intp], factors: list[Array], filled: NDArray[np.bool_]
) -> None:
    """Stores the factors of ranges of rows, ordered by block.

    If a block has several ranges of rows, their factors are merged.

    Args:
        new: For each joint, the factors of all ranges, shape (ranges, k + 1, k + 1).
        blocks: Index of the block to which each range belongs, shape (ranges,).
        factors: For each joint, the factors of all blocks, shape (blocks, k + 1, k + 1); changed in place.
        filled: Mask of the blocks that already have factors, shape (blocks,); changed in place.
    """
    for number, k in enumerate(blocks):
        for joint, R in enumerate(new):
            whole = factors[joint]
            whole[k] = kernel.factor_columns(np.vstack([whole[k], R[number]]).T)[0] if filled[k] else R[number]
        filled[k] = True


def _of_run(source: ColumnSource, run: ObservedRun, index: int, factors: list[Array], method: str) -> Information:
    """Information of one run, made from the factors of its joints, which are removed from the list `factors`."""
    borders = _borders(run)
    names, which = np.unique(run.block[borders[:-1]], return_inverse=True)
    rows = np.zeros((len(names), source.tree.n), dtype=np.int64)
    masked = not run.mask.all()  # counting takes milliseconds; most runs have no mask
    for k, (begin, end) in zip(which, pairwise(borders), strict=True):
        rows[k] += run.mask[begin:end].sum(axis=0) if masked else end - begin
    return Information(
        source.names,
        tuple(JointFactors(parameters, factors.pop(0)) for parameters in source.layout.parameters),
        rows,
        np.full(len(names), index),
        np.full(len(names), run.recording),
        made_by=FactorOrigin(kernel.in_use(), method),
    )


def _borders(run: ObservedRun) -> NDArray[np.intp]:
    """Borders between successive rows of different blocks: k first rows and the number of rows, shape (k + 1,)."""
    changes = np.flatnonzero(run.block[1:] != run.block[:-1]) + 1
    return np.concatenate([[0], changes, [len(run.block)]])


@dataclass(frozen=True, slots=True)
class _RowRange:
    """Rows `begin` to `end - 1` of the output grid, all of which belong to the block `block`."""

    begin: int
    end: int
    block: int


def _row_ranges(run: ObservedRun) -> list[_RowRange]:
    """Divides the output grid into ranges of rows of one block each, with at most CHUNK rows."""
    return [
        _RowRange(a, min(a + CHUNK, end), int(run.block[begin]))
        for begin, end in pairwise(_borders(run).tolist())
        for a in range(begin, end, CHUNK)
    ]


def _batches(ranges: list[_RowRange]) -> Iterator[list[_RowRange]]:
    """Groups successive ranges of rows into batches of at most CHUNK rows."""
    batch: list[_RowRange] = []
    for rows in ranges:
        if batch and rows.end - batch[0].begin > CHUNK:
            yield batch
            batch = []
        batch.append(rows)
    if batch:
        yield batch


def _raw_blocks(
    source: ColumnSource, run: ObservedRun, band: Band, threads: int, *, by_gram: bool
) -> Iterator[tuple[Array, NDArray[np.int64], int]]:
    """Yields, for each batch of an unfiltered run, the factors of its ranges of rows.

    With them come the block of each range and the number of samples processed so far.
    """
    one_sided = run.consecutive and not band.is_open and not band.columns
    torque = filtered_torque(run, band) if one_sided else run.torque
    masked = not run.mask.all()
    for batch in _batches(_row_ranges(run)):
        a, b = batch[0].begin, batch[-1].end
        rows = slice(run.offset + a * run.step, run.offset + (b - 1) * run.step + 1, run.step)
        motion = run.motion[rows]
        bounds = np.array([a, *(each.end for each in batch)]) - a
        R = kernel.factor(
            source.tree,
            source.layout,
            motion.q,
            motion.dq,
            motion.ddq,
            torque[rows],
            source.term_rows(motion),
            bounds,
            mask=run.mask[a:b] if masked else None,
            by_gram=by_gram,
            threads=threads,
        )
        yield R, np.array([each.block for each in batch]), rows.stop


def _filtered_blocks(
    source: ColumnSource, run: ObservedRun, band: Band
) -> Iterator[tuple[Array, NDArray[np.int64], int]]:
    """Yields, for each batch of a filtered run, the factors of its ranges of rows.

    With them come the block of each range and the number of samples processed so far.
    """
    widths = source.layout.widths.astype(np.int64)
    for begin, x in filtered_columns(source, run, band):
        mask, block = run.mask[begin : begin + x.shape[1]], run.block[begin : begin + x.shape[1]]
        bounds = np.concatenate([[0], np.flatnonzero(np.diff(block)) + 1, [len(block)]])
        R = np.empty((len(bounds) - 1, int((widths**2).sum())))
        column = 0
        for j in range(source.tree.n):
            a, b = source.layout.offset[j], source.layout.offset[j + 1]
            # Masked rows become zero rows, which add no information.
            factors = kernel.factor_columns(x[a:b] * mask[:, j], bounds)
            R[:, column : column + (b - a) ** 2] = factors.reshape(len(factors), -1)
            column += (b - a) ** 2
        yield R, block[bounds[:-1]], run.offset + (begin + x.shape[1]) * run.step
