"""Zero-phase filter of a band, which is the same for torque and regressor columns.

If the sample rate is high, the columns are first decimated in the kernel, with a linear-phase filter whose gain is
one in the band. Then the sharp filter of the band is applied. Both steps are the same for torque and columns, so
neither step biases the estimate.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.information.base_regressor_layout import ColumnSource
from armid.kernel.channels.passes import filter_columns, filters_by_recursion
from armid.kernel.channels.passes import zero_phase as zero_phase_differences
from armid.maths.signals.decimation import coarsest_step, decimate, decimation_filter, decimation_step, interpolate
from armid.maths.signals.zero_phase_filters import low_pass, periodic_filter, settling_samples, zero_phase
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import ObservedRun

BATCH = 8192
"""Number of rows that the sharp filter processes at a time: 14 MB for a seven-joint arm."""

CHUNK = 16384
"""Number of samples whose columns of torque terms are in memory at a time."""

OVERLAP = 16
"""Number of additional decimated rows on each side of a batch for the interpolation; its filter needs seven."""


def in_band(x: Array, rate: float, band: Band) -> Array:
    """Filters signals of one run at the full sampling rate with the low-pass of the band, shape (N, ...)."""
    filter = low_pass(band.family, band.order, band.cutoff, rate)
    if filter is None:
        return x
    if band.edges == "periodic":
        return periodic_filter(filter, x)
    if filters_by_recursion(filter, len(x)):
        return zero_phase_differences(filter, x.reshape(len(x), -1), rate, 0)[0].reshape(x.shape)
    return zero_phase(filter, x)


def rows_in_band(run: ObservedRun, x: Array, band: Band) -> Array:
    """Filters signals (N, ...) of a run with the low-pass of the band and takes the rows of the run, (M, ...)."""
    filter = low_pass(band.family, band.order, band.cutoff, run.rate)
    if filter is None or band.edges == "periodic" or not filters_by_recursion(filter, len(x)):
        return in_band(x, run.rate, band)[run.rows]
    kept = filter_columns(filter, x.reshape(len(x), -1).T, run.offset, run.step)
    return np.ascontiguousarray(kept.T).reshape(-1, *x.shape[1:])


def _at_rows(filter: Array, x: Array, first: int = 0, step: int = 1) -> Array:
    """Filters columns (K, N) of one run; the result has every `step`-th sample from `first` on."""
    if not filters_by_recursion(filter, x.shape[1]):
        return zero_phase(filter, x, axis=1, first=first, step=step)
    return filter_columns(filter, x, first, step)


def filtered_torque(run: ObservedRun, band: Band) -> Array:
    """Torque of a run after the filter of the band, at the full sampling rate, shape (N, n) [N·m or N]."""
    return in_band(run.torque, run.rate, band)


def filtered_columns(source: ColumnSource, run: ObservedRun, band: Band) -> Iterator[tuple[int, Array]]:
    """Filtered regressor columns and torque on the output grid, in batches.

    First the columns are decimated to the "early" rows, then the sharp filter of the band is applied. The step
    between early rows is a divisor of the step of the output grid. If the output grid is denser than the band needs,
    the step between early rows is larger instead, and the filtered columns are interpolated.

    Yields:
        Index of the first row of the batch, and columns of all joints at its rows, shape (columns, rows).
    """
    early = decimation_step(run.rate, band.cutoff, run.step)
    factor = _rows_between(run, band) if early == run.step else 1
    early *= factor
    late = max(1, run.step // early)
    first = run.offset if factor > 1 else run.offset % early
    lead = (run.offset - first) // early  # early rows before the first row of the output grid
    filter = low_pass(band.family, band.order, band.cutoff, run.rate / early)
    assert filter is not None  # an open band is not filtered
    columns = _EarlyColumns(source, run, decimation_filter(early), early, first)
    rows = len(run.rows)
    if band.edges == "periodic":
        x = columns.periodic()
        whole = run.motion.samples % early == 0
        x = (periodic_filter if whole else zero_phase)(filter, x, axis=1)
        for begin in range(0, rows, BATCH):
            yield begin, _rows(x, lead, late, factor, begin, min(begin + BATCH, rows), periodic=True)
        return
    overlap = settling_samples(filter) + OVERLAP
    batch = max(1, BATCH // late) * factor
    for start in range(0, rows, batch):
        stop = min(start + batch, rows)
        a = max(0, lead + start * late // factor - overlap)
        b = min(columns.available, lead + (stop - 1) * late // factor + 1 + overlap)
        if factor == 1:
            x = _at_rows(filter, columns.between(a, b), lead + start * late - a, late)
            yield start, np.ascontiguousarray(x[:, : stop - start])
            continue
        x = _at_rows(filter, columns.between(a, b))
        for begin in range(start, stop, BATCH):
            yield begin, _rows(x, lead - a, late, factor, begin, min(begin + BATCH, stop), periodic=False)


def _rows_between(run: ObservedRun, band: Band) -> int:
    """Number of steps of the output grid in the coarsest step that the cut-off of the band allows, at least 1.

    If the edges are periodic, the number is a divisor of the number of rows of a period.
    """
    factor = max(1, coarsest_step(run.rate, band.cutoff) // run.step)
    if band.edges == "periodic":
        while run.motion.samples % (factor * run.step):
            factor -= 1
            if factor <= 1:
                return 1
    return factor


def _rows(x: Array, lead: int, late: int, factor: int, begin: int, end: int, *, periodic: bool) -> Array:
    """Rows `begin` to `end - 1` of the output grid, taken or interpolated from the filtered decimated columns `x`.

    Column `lead` of `x` belongs to row 0. With `factor` 1, every column number `late` is a row; otherwise there are
    `factor` rows for each column.
    """
    if factor == 1:
        start = lead + begin * late
        return np.ascontiguousarray(x[:, start : start + (end - begin - 1) * late + 1 : late])
    a, b = lead + begin // factor, lead + (end - 1) // factor + 1
    low, high = (a - OVERLAP, b + OVERLAP) if periodic else (max(0, a - OVERLAP), min(x.shape[1], b + OVERLAP))
    part = x[:, np.arange(low, high) % x.shape[1]] if periodic else x[:, low:high]
    dense = interpolate(np.ascontiguousarray(part), factor)
    start = (a - low) * factor + begin % factor
    return np.ascontiguousarray(dense[:, start : start + end - begin])


@dataclass(frozen=True, eq=False, slots=True)
class _EarlyColumns:
    """Columns of a run after the first decimation; row r is centred on sample `first` + r · `step`."""

    source: ColumnSource
    run: ObservedRun
    taps: Array
    step: int
    first: int

    @property
    def available(self) -> int:
        """Number of decimated rows of the run."""
        return len(range(self.first, self.run.motion.samples, self.step))

    def between(self, a: int, b: int) -> Array:
        """Decimated rows `a` to `b - 1`, shape (columns, b - a); the run is continued by reflection at its ends."""
        out = self._inside(a, b)
        if len(self.taps) > 1:
            _reflect_ends(self.source, self.run, self.taps, self.step, self.first, a, b, out)
        return out

    def periodic(self) -> Array:
        """All decimated rows, shape (columns, available); beyond its ends, the run is continued periodically."""
        out = self._inside(0, self.available)
        half, N = len(self.taps) // 2, self.run.motion.samples
        lowest, highest = self.first - half, self.first + (self.available - 1) * self.step + half
        if lowest < 0:
            self._add(N + lowest, N, lowest + N, out)
        if highest >= N:
            self._add(0, highest + 1 - N, lowest - N, out)
        return out

    def _inside(self, a: int, b: int) -> Array:
        half = len(self.taps) // 2
        if half == 0:
            return self._undecimated(a, b)
        out = np.zeros((self.source.layout.columns, b - a))
        lowest = self.first + a * self.step - half
        end = min(self.first + (b - 1) * self.step + half + 1, self.run.motion.samples)
        for begin in range(max(lowest, 0), end, CHUNK):
            self._add(begin, min(begin + CHUNK, end), lowest, out)
        return out

    def _undecimated(self, a: int, b: int) -> Array:
        """Columns at the samples `first` + a to `first` + b - 1; the only tap is one."""
        rows = slice(self.first + a, self.first + b)
        part, tree, layout = self.run.motion[rows], self.source.tree, self.source.layout
        terms = self.source.term_rows(part)
        return kernel.columns(tree, layout, part.q, part.dq, part.ddq, self.run.torque[rows], terms)

    def _add(self, begin: int, end: int, first_tap: int, out: Array) -> None:
        """Adds samples `begin` to `end - 1` to the decimated rows `out`.

        The first tap of row 0 of `out` multiplies sample `first_tap`.
        """
        part = self.run.motion[slice(begin, end)]
        kernel.decimate(
            self.source.tree,
            self.source.layout,
            part.q,
            part.dq,
            part.ddq,
            self.run.torque[begin:end],
            self.source.term_rows(part),
            self.taps,
            self.step,
            first_tap - begin,
            out,
        )


def _reflect_ends(
    source: ColumnSource, run: ObservedRun, taps: Array, step: int, first: int, a: int, b: int, out: Array
) -> None:
    """Recomputes in `out` the rows whose filter reaches beyond an end of the run, continued by reflection."""
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
        skip = (first - begin) % step
        made = decimate(x.T, taps, step, skip)
        earliest = (begin + skip - first) // step  # row of the piece's first kept sample, below 0 before the grid
        for r in rows:
            out[:, r - a] = made[r - earliest]
