"""Output grid of a contiguous run: the mask of its rows, and the block to which each row belongs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.signals.zero_phase_filters import edge_samples, low_pass
from armid.measurement.observations import ObservedRun
from armid.measurement.processing.differentiation import motion_filter
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.uniform_runs import Segment
from armid.model.motion import Motion

TRIM = 0.5
"""Default time that is left out at each end of a run if the option `edges` is `drop` [s]."""

LOBE_HALF_WIDTH = 0.5
"""Half-width of the main lobe of the impulse response of a low-pass filter, in periods of its cut-off. A bad sample
affects the rows within this distance. A longer segment of bad samples, such as a contact, affects more distant rows:
as many as the end of a run affects."""

STICKING = 3e-3
"""Largest share of a filter's absolute impulse response that may fall on samples at standstill, for a row that is
used. Friction errors at standstill are a hundred times the noise in the band; with one percent, as at the ends of
runs, intervals covered 93 % instead of 95 %."""

MOST_STILL = 0.75
"""Largest share of a joint's rows that may be left out because of standstill; if the share is larger, the rows are
used. With a usual recording, the other rows still determine the friction of the joint and the gravity torques."""

BLOCK_SECONDS = 1.0
"""Approximate length of a block if the motion does not repeat [s]; it is longer than the correlation time of
residuals in a band of a few hertz."""

BLOCK_ROWS = 25
"""Number of rows in a block if rows are not consecutive: the number of rows in one second at the usual rate."""

Rows = NDArray[np.int64]
Flags = NDArray[np.bool_]


def run_of(
    segment: Segment,
    motion: Motion,
    processing: ProcessingOptions,
    repeats: tuple[float, float] | None = None,
    recording: int = 0,
    *,
    found: bool = False,
) -> ObservedRun | None:
    """Makes the contiguous run of a segment, with rows, mask and blocks; `None` if no row can be used.

    Args:
        segment: Samples of the segment.
        motion: Motion at the samples of the segment.
        processing: Options whose cut-off is a frequency, not `auto`.
        repeats: Period and start of the first repetition [s]; `None` if the motion does not repeat.
        recording: Index of the recording.
        found: True if the repetitions were detected, false if they were stated. If true, blocks are about one second
            long, because methods that leave out blocks need more blocks than there are repetitions.
    """
    samples, rate = segment.samples, segment.rate
    periodic = processing.edges == "periodic"
    circle = samples if repeats is None else min(round(repeats[0] * rate), samples)
    step = _step(processing, rate, circle if periodic else None)
    rows = np.arange(0, samples, step)
    mask = ~_spoiled(segment.bad, rows, processing, rate, step, periodic=periodic)
    margin = edge_margin(processing, rate)
    mask &= ((rows >= margin) & (rows < samples - margin))[:, None]
    mask &= np.abs(motion.dq[rows]) >= processing.slow
    repetition = None
    if repeats is None:
        block = _blocks(rows, rate, samples)
    else:
        repetition, inside = _repetitions(segment, rows, repeats)
        mask &= inside[:, None]
        block = _gapless(_parts(segment.time[rows], repetition, repeats) if found else repetition)
    if not mask.any():
        return None
    which = repetition if found and repetition is not None else None
    return ObservedRun(motion, segment.effort, rate, step, 0, mask, block, recording=recording, repetition=which)


def separate_rows(segment: Segment, motion: Motion, processing: ProcessingOptions, recording: int = 0) -> ObservedRun:
    """Makes the run of samples that are not consecutive: every sample is a row; bad or slow samples are masked."""
    mask = ~segment.bad & (np.abs(motion.dq) >= processing.slow)
    block = np.arange(segment.samples) // BLOCK_ROWS
    return ObservedRun(motion, segment.effort, segment.rate, 1, 0, mask, block, False, recording)


def moving(
    runs: Sequence[ObservedRun], still: Sequence[Flags], processing: ProcessingOptions
) -> tuple[list[ObservedRun], Array]:
    """Masks, for each joint, the rows at standstill in the runs of one recording, if enough other rows remain.

    Args:
        runs: The runs.
        still: For each run, mask of the samples at standstill, shape (N, n).
        processing: Options with which the runs were made.

    Returns:
        The runs, and the share of the rows of each joint that standstill affects, shape (n,). If the share of a joint
        is larger than `MOST_STILL`, its rows are not masked, unless the option `standstill` is `moving`.
    """
    near = [_at_standstill(flags, run, processing) for run, flags in zip(runs, still, strict=True)]
    had = np.sum([run.mask.sum(axis=0) for run in runs], axis=0)
    lost = np.sum([(run.mask & rows).sum(axis=0) for run, rows in zip(runs, near, strict=True)], axis=0)
    share = lost / np.maximum(had, 1)
    masked = (share <= MOST_STILL) | (processing.standstill == "moving")
    return [replace(run, mask=run.mask & ~(rows & masked)) for run, rows in zip(runs, near, strict=True)], share


def edge_margin(processing: ProcessingOptions, rate: float) -> int:
    """Number of samples left out at each end of a run: those of `trim` or those that the end affects, if more.

    Samples that the end affects through a filter are left out only if the option `edges` is `drop`.
    """
    drop = processing.edges == "drop"
    seconds = (TRIM if drop else 0.0) if processing.trim is None else processing.trim
    return max([round(seconds * rate), *(edge_samples(low) for low in _filters(processing, rate) if drop)])


def _step(processing: ProcessingOptions, rate: float, circle: int | None) -> int:
    """Number of samples from row to row; for a periodic run of `circle` samples, a divisor of `circle`."""
    if processing.family == "none" or processing.decimate == 0:
        return 1
    step = max(1, round(rate / processing.decimate))
    if circle is None:
        return step
    return max(d for d in range(1, min(step, circle) + 1) if circle % d == 0)


def _spoiled(
    bad: Flags, rows: Rows, processing: ProcessingOptions, rate: float, step: int, *, periodic: bool
) -> Flags:
    """Mask (M, n) of the rows that bad samples (N, n) affect, directly or through the filters."""
    filters = _filters(processing, rate)
    half = -(-step // 2)
    if not filters:
        return _any_within(bad, rows, half, periodic=periodic)
    lobe = int(np.ceil(LOBE_HALF_WIDTH * rate / min(float(processing.cutoff), processing.motion_cutoff or np.inf)))
    near = _any_within(bad, rows, max(half, lobe), periodic=periodic)
    reach = max(edge_samples(low) for low in filters)
    return near | _any_within(_long(bad, lobe), rows, max(half, reach), periodic=periodic)


def _at_standstill(still: Flags, run: ObservedRun, processing: ProcessingOptions) -> Flags:
    """Mask (M, n) of the rows that samples at standstill (N, n) affect, directly or through the filters."""
    reach = max([-(-run.step // 2), *(edge_samples(low, STICKING) for low in _filters(processing, run.rate))])
    return _any_within(still, run.rows, reach, periodic=processing.edges == "periodic")


def _long(flags: Flags, length: int) -> Flags:
    """Removes from flags (N, n), joint by joint, all segments of true flags with fewer than `length` samples."""
    result = np.zeros_like(flags)
    for j in np.flatnonzero(flags.any(axis=0)):
        borders = np.flatnonzero(np.diff(np.concatenate([[False], flags[:, j], [False]])))
        for begin, end in borders.reshape(-1, 2):
            result[begin:end, j] = end - begin >= length
    return result


def _filters(processing: ProcessingOptions, rate: float) -> list[Array]:
    """Filters of torque and positions for a sample rate; empty for the family `none`."""
    if processing.family == "none":
        return []
    torque = low_pass(processing.family, processing.order, float(processing.cutoff), rate)
    return [low for low in (torque, motion_filter(processing, rate)) if low is not None]


def _any_within(flags: Flags, rows: Rows, reach: int, *, periodic: bool) -> Flags:
    """Mask (M, n) of the rows that have a flagged sample at most `reach` samples away; periodic runs wrap around."""
    found = np.zeros((len(rows), flags.shape[1]), dtype=np.bool_)
    if not flags.any():
        return found
    N = len(flags)
    reach = min(reach, N) if periodic else reach
    for j in range(flags.shape[1]):
        flagged = np.flatnonzero(flags[:, j])
        if periodic:
            flagged = np.concatenate([flagged[flagged >= N - reach] - N, flagged, flagged[flagged < reach] + N])
        found[:, j] = np.searchsorted(flagged, rows + reach, side="right") > np.searchsorted(flagged, rows - reach)
    return found


def _repetitions(segment: Segment, rows: Rows, repeats: tuple[float, float]) -> tuple[Rows, Flags]:
    """Index of the repetition of each row, and mask of the rows in whole repetitions of the segment, (M,) each."""
    period, start = repeats
    tick = 0.5 / segment.rate  # half a sample: rows on the border belong to what follows
    which = np.floor((segment.time[rows] - start + tick) / period).astype(np.int64)
    whole = np.floor((float(segment.time[-1]) - start + 3 * tick) / period)
    return which, (which >= 0) & (which < whole)


def _parts(time: Array, repetition: Rows, repeats: tuple[float, float]) -> Rows:
    """Consecutive numbers of the parts of repetitions, about one second long, in which the rows lie, shape (M,)."""
    period, start = repeats
    count = max(1, round(period / BLOCK_SECONDS))
    inside = np.clip((time - start) / period - repetition, 0.0, 1.0 - 1e-9)
    return repetition * count + np.floor(inside * count).astype(np.int64)


def _blocks(rows: Rows, rate: float, samples: int) -> Rows:
    """Block to which each row belongs; all blocks have the same length of about one second."""
    count = max(1, round(samples / (rate * BLOCK_SECONDS)))
    return _gapless(rows * count // samples)


def _gapless(labels: Rows) -> Rows:
    """Renumbers labels (M,) from 0 without gaps, in the same order."""
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)
