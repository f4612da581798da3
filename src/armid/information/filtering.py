"""The band applied: torque and regressor columns through one zero-phase filter.

At a high rate the columns are first decimated inside the kernel's stream by a linear-phase filter that is flat over
the band, then filtered sharply. Both steps act alike on torque and columns, so neither biases the estimate.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armid import kernel
from armid.information.band import Band
from armid.information.observations import ObservedRun
from armid.information.setup import ColumnSource
from armid.maths.signals import (
    decimate,
    decimation_filter,
    decimation_step,
    low_pass,
    periodic_filter,
    settling_samples,
    zero_phase,
)
from armid.values import Array

__all__ = ["filtered_columns", "filtered_torque", "in_band"]

SEGMENT = 8192
"""Rows that the sharp filter works on at a time: 14 MB for a seven-joint arm."""

CHUNK = 16384
"""Samples whose term columns are held at a time."""


def in_band(x: Array, rate: float, band: Band) -> Array:
    """Signals (N, ...) of one run at full rate, filtered as the band says."""
    filter = low_pass(band.family, band.order, band.cutoff, rate)
    if filter is None:
        return x
    return periodic_filter(filter, x) if band.edges == "periodic" else zero_phase(filter, x)


def filtered_torque(run: ObservedRun, band: Band) -> Array:
    """The run's torque through the band, at full rate, shape (N, n)."""
    return in_band(run.torque, run.rate, band)


def filtered_columns(source: ColumnSource, run: ObservedRun, band: Band) -> Iterator[tuple[int, Array]]:
    """Columns and torque on the output grid, filtered, a segment at a time.

    Yields:
        First row of the segment, and its columns (columns, rows).
    """
    early = decimation_step(run.rate, band.cutoff, run.step)
    late = run.step // early
    filter = low_pass(band.family, band.order, band.cutoff, run.rate / early)
    assert filter is not None  # an open band is not filtered
    taps = decimation_filter(early)
    first = run.offset % early
    available = len(range(first, run.motion.samples, early))
    lead = (run.offset - first) // early  # early rows before the first row of the output grid
    rows = len(run.rows)
    if band.edges == "periodic":
        x = _early_columns(source, run, taps, early, first, 0, available, periodic=True)
        whole = run.motion.samples % early == 0
        x = (periodic_filter if whole else zero_phase)(filter, x, axis=1)
        yield 0, np.ascontiguousarray(x[:, lead::late][:, :rows])
        return
    overlap = settling_samples(filter)
    segment = max(1, SEGMENT // late)
    for begin in range(0, rows, segment):
        end = min(begin + segment, rows)
        a = max(0, lead + begin * late - overlap)
        b = min(available, lead + (end - 1) * late + 1 + overlap)
        x = zero_phase(filter, _early_columns(source, run, taps, early, first, a, b, periodic=False), axis=1)
        start = lead + begin * late - a
        yield begin, np.ascontiguousarray(x[:, start : start + (end - begin - 1) * late + 1 : late])


def _early_columns(
    source: ColumnSource,
    run: ObservedRun,
    taps: Array,
    step: int,
    first: int,
    a: int,
    b: int,
    *,
    periodic: bool,
) -> Array:
    """Columns after the first decimation: rows a to b - 1, row r centred on sample first + r step."""
    half = len(taps) // 2
    N = run.motion.samples
    out = np.zeros((source.layout.columns, b - a))
    centre = first + a * step  # sample under the centre of row a
    lowest, highest = centre - half, first + (b - 1) * step + half
    for begin in range(max(lowest, 0), min(highest + 1, N), CHUNK):
        _accumulate(source, run, begin, min(begin + CHUNK, highest + 1, N), taps, step, lowest, out)
    if periodic:
        if lowest < 0:
            _accumulate(source, run, N + lowest, N, taps, step, lowest + N, out)
        if highest >= N:
            _accumulate(source, run, 0, highest + 1 - N, taps, step, lowest - N, out)
    elif half:
        _reflect_ends(source, run, taps, step, first, a, b, out)
    return out


def _accumulate(
    source: ColumnSource,
    run: ObservedRun,
    begin: int,
    end: int,
    taps: Array,
    step: int,
    first_tap: int,
    out: Array,
) -> None:
    """Add samples begin to end - 1 to the decimated rows; row 0 has its first tap over sample `first_tap`."""
    part = run.motion[slice(begin, end)]
    kernel.decimate(
        source.tree, source.layout, part.q, part.dq, part.ddq, run.torque[begin:end], source.term_rows(part),
        taps, step, first_tap - begin, out,
    )  # fmt: skip


def _reflect_ends(
    source: ColumnSource, run: ObservedRun, taps: Array, step: int, first: int, a: int, b: int, out: Array
) -> None:
    """Rows whose taps reach past an end of the run are made again with the end reflected."""
    half = len(taps) // 2
    N = run.motion.samples
    length = min(N, 2 * half + 1 + half)
    for at_start in (True, False):
        rows = [r for r in range(a, b) if (first + r * step < half if at_start else first + r * step > N - 1 - half)]
        if not rows:
            continue
        begin = 0 if at_start else N - length
        part = run.motion[slice(begin, begin + length)]
        x = kernel.columns(
            source.tree, source.layout, part.q, part.dq, part.ddq,
            run.torque[begin : begin + length], source.term_rows(part),
        )  # fmt: skip
        made = decimate(x.T, taps, step, (first - begin) % step)
        offset = -(-(begin - first) // step) if begin > first else 0  # row that the piece's first kept sample is
        for r in rows:
            out[:, r - a] = made[r - offset]
