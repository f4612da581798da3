"""Products of regressor columns and of residuals in frequency bands, for which all rows are read a second time.

Residuals are not white, and the effect of noise at a frequency depends on the columns at that frequency. So products
of the Fourier coefficients of columns and residuals are summed over narrow frequency bands.

If the motion repeats, its periods are averaged first (folded into one period). Model errors repeat with the motion,
so averaging does not reduce them. The mean of the periods, treated as one recording, shows the size of the model
errors.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.covariance_choice_thresholds import SAME_POSITIONS
from armid.information.base_regressor_layout import ColumnSource
from armid.information.kept_rows import Batch, kept_rows
from armid.maths.signals.fourier_transform import frequencies, spectrum
from armid.measurement.observations import ObservedRun

MAX_RATE = 100.0
"""Largest row rate for the products [Hz]; it covers the spectrum of an arm's motion. Rows at higher rates are
averaged."""

SEGMENT = 8192
"""Number of rows of a segment after averaging. A segment is longer than the correlation time of an arm's noise."""

LOWEST_BAND_SIZE = 8.0
"""Number of real numbers of the spectrum of a recording that the lowest frequency band contains: four complex
coefficients."""

PER_OCTAVE = 3
"""Number of frequency bands per octave; they are narrow enough to resolve the edge of a filter."""

PARTS = 10
"""Number of parts into which a segment is divided in time, to compare the variances of the residual in these
parts."""


@dataclass(frozen=True, eq=False, slots=True)
class GatheredBands:
    """M consecutive rows of one segment.

    Each row may be an average, if the row rate is high or if periods are folded.

    A row that replaces m rows of a joint is the sum of these rows divided by √m, so that products and the variance of
    white noise do not change.

    Attributes:
        columns: W regressor columns joint by joint, zero in masked rows, shape (W, M).
        residual: Residuals, shape (n, M) [N·m or N].
        counts: Mask of rows in use, shape (n, M).
        rate: Row rate [Hz].
        squares: Sum of squared residuals before averaging, shape (n,).
        within: Sum of squared differences between periods, and number of rows of these differences, shape (2, n).
    """

    columns: Array
    residual: Array
    counts: NDArray[np.bool_]
    rate: float
    squares: Array
    within: Array


@dataclass(frozen=True, eq=False, slots=True)
class BandProducts:
    """Products of the W columns of n joints, and of their residuals, in E frequency bands.

    Attributes:
        parameters: Indices of the parameters of each joint's k_j columns, shapes (k_j,).
        edges: Lower edge of each band [Hz], shape (E,).
        frequency: Mean frequency of each band [Hz], shape (E,).
        count: Number of real numbers in the spectrum of each pair of joints in each band, shape (E, n, n).
        products: Products of two columns, summed over each band, shape (E, W, W).
        moments: Products of the residuals of two joints, summed over each band, shape (E, n, n) [N²·m² or N²].
        parts: Sum of squared residuals and number of rows in each of the P parts of the time, shape (P, 2, n).
        squares: Sum of squared residuals of all rows, shape (n,).
        within: Sum of squared differences between periods, and number of rows of these differences, shape (2, n);
            zero without periods.
        averaged: True if rows are averages of neighbouring rows or of several periods.
    """

    parameters: tuple[NDArray[np.int32], ...]
    edges: Array
    frequency: Array
    count: Array
    products: Array
    moments: Array
    parts: Array
    squares: Array
    within: Array
    averaged: bool

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.parameters)

    @property
    def offset(self) -> NDArray[np.int64]:
        """Index of the first column of each joint, and at the end the number of all columns, shape (n + 1,)."""
        return np.cumsum([0, *(len(own) for own in self.parameters)])


def gather_bands(problem: EstimationProblem, values: Array) -> Iterator[GatheredBands]:
    """Yields regressor columns and residuals, segment by segment, averaged over neighbouring rows and over periods.

    Args:
        problem: Problem with its samples.
        values: Values of the parameters, shape (b,), or separate values for each joint's torque, shape (n, b).
    """
    model, base, observations = problem.require_samples("cover")
    information = problem.information
    values = np.broadcast_to(values, (information.n, information.count))
    every = kept_rows(model, base, observations)
    source = every.source
    widths = [len(joint.parameters) for joint in information.joints]
    for index, run in enumerate(every.observations.runs):
        parameters = column_numbers(source, information.names, run)
        places = [
            start + np.searchsorted(joint.parameters, own)
            for start, joint, own in zip(np.cumsum([0, *widths]), information.joints, parameters, strict=False)
        ]
        chunks = _with_residuals(every.of_run(index), source, parameters, values)
        yield from _gather_run(run, chunks, places, widths)


def _with_residuals(
    batches: Iterator[Batch], source: ColumnSource, parameters: list[NDArray[np.int64]], values: Array
) -> Iterator[tuple[int, list[Array], Array]]:
    """Yields for each batch of M rows the first row, the columns of each joint j (k_j, M) and residuals (n, M)."""
    for batch in batches:
        blocks = [batch.x[a:b] for a, b in itertools.pairwise(source.layout.offset)]
        residual = [
            block[-1] - joint_values[own] @ block[:-1]
            for block, joint_values, own in zip(blocks, values, parameters, strict=True)
        ]
        yield batch.begin, [block[:-1] for block in blocks], np.array(residual)


def band_products(problem: EstimationProblem, values: Array) -> BandProducts:
    """Computes the products of columns and residuals in all frequency bands.

    Args:
        problem: Problem with its samples.
        values: The estimate, shape (b,), or separate values for each joint's torque, shape (n, b).
    """
    parameters = tuple(joint.parameters for joint in problem.information.joints)
    n, W = len(parameters), sum(len(own) for own in parameters)
    lengths = _lengths(problem)
    is_short = sum(rows for rows, _ in lengths) <= SEGMENT  # all rows fit in memory and are computed only once
    gathered = list(gather_bands(problem, values)) if is_short else None
    edges = band_edges(lengths)
    E = len(edges)
    products, moments, count = np.zeros((E, W, W)), np.zeros((E, n, n)), np.zeros((E, n, n))
    weighted = np.zeros((E, 2))
    parts: list[Array] = []
    squares, within = np.zeros(n), np.zeros((2, n))
    for part in gathered if gathered is not None else gather_bands(problem, values):
        M = part.residual.shape[1]
        hertz = frequencies(M) * part.rate
        label, real = _labels(M, part.rate, edges)
        share = (part.counts[:, None] & part.counts[None]).mean(axis=2)
        products += _products(part.columns, label, real, E)
        moments += _products(part.residual, label, real, E)
        weighted += np.stack([np.bincount(label, real * hertz, E), np.bincount(label, real, E)], axis=1)
        count += np.bincount(label, real, E)[:, None, None] * share
        squares += part.squares
        within += part.within
        parts.append(_part_variances(part))
    used = weighted[:, 1] > 0.0
    averaged = bool(within.any()) or any(_averaging(run) > 1 for run in _runs(problem))
    return BandProducts(
        parameters,
        edges[used],
        weighted[used, 0] / weighted[used, 1],
        count[used],
        products[used],
        moments[used],
        np.concatenate(parts),
        squares,
        within,
        averaged,
    )


def residual_moments(residual: Array, rate: float, bands: BandProducts) -> Array:
    """Products of the residuals of two joints in a segment, summed over each of E frequency bands, shape (E, n, n).

    Args:
        residual: Residuals of the segment, shape (n, M).
        rate: Row rate [Hz].
        bands: Products that define the bands.
    """
    label, real = _labels(residual.shape[1], rate, bands.edges)
    return _products(residual, label, real, len(bands.edges))


def band_edges(lengths: list[tuple[int, float]]) -> Array:
    """Lower edges of the bands [Hz], from the frequency resolution of segments of given lengths and rates.

    Args:
        lengths: Number of rows and row rate [Hz] of each segment.
    """
    seconds = sum(rows / rate for rows, rate in lengths)
    step = 1.0 / max(rows / rate for rows, rate in lengths)
    highest = max(rate for _, rate in lengths) / 2.0
    edges = [0.0, max(LOWEST_BAND_SIZE / (2.0 * seconds), step)]
    while edges[-1] < highest:
        edges.append(max(edges[-1] * 2.0 ** (1.0 / PER_OCTAVE), edges[-1] + step))
    edges.pop()
    if len(edges) > 2 and highest - edges[-1] < 0.5 * (edges[-1] - edges[-2]):
        edges.pop()  # hardly anything lies above it
    return np.array([0.0, *(np.array(edges[1:]) - step / 2.0)])


def column_numbers(source: ColumnSource, names: tuple[str, ...], run: ObservedRun) -> list[NDArray[np.int64]]:
    """Indices of the parameters that belong to the columns of each joint, among `names`.

    If recordings have separate copies of parameters, the copies for the recording of the run are taken.
    """
    number, copy = {name: k for k, name in enumerate(names)}, f"[{run.recording + 1}]"
    every = np.array([number.get(name, number.get(name + copy, -1)) for name in source.names], dtype=np.int64)
    return [every[own] for own in source.layout.parameters]


def find_periods(run: ObservedRun) -> NDArray[np.int64] | None:
    """Finds the periods of a motion that repeats.

    Returns:
        First row of each period, then the number of rows of the shortest period. `None` if the repetitions of the run
        are not periods of one motion. If no repetitions are stored with the run, its blocks are tested instead.
    """
    label = run.block if run.repetition is None else run.repetition
    borders = np.flatnonzero(np.diff(label, prepend=-1, append=-1))
    begins, ends = borders[:-1], borders[1:]
    used = np.array([run.mask[a:b].any() for a, b in zip(begins, ends, strict=True)])
    begins, lengths = begins[used], (ends - begins)[used]
    if len(begins) < 2 or np.ptp(lengths) > 1 or not run.consecutive:
        return None
    q = run.motion.q[run.rows]
    length = int(lengths.min())
    periods = np.stack([q[a : a + length] for a in begins])
    spread = np.sqrt(np.mean((periods[0] - periods[0].mean(axis=0)) ** 2))
    difference = np.sqrt(np.mean((periods - periods.mean(axis=0)) ** 2, axis=(1, 2)))
    if not (difference <= SAME_POSITIONS * spread).all():
        return None
    return np.append(begins, length)


def _gather_run(
    run: ObservedRun,
    chunks: Iterator[tuple[int, list[Array], Array]],
    places: list[NDArray[np.intp]],
    widths: list[int],
) -> Iterator[GatheredBands]:
    """Yields the averaged rows of one run, segment by segment, or folded into one period if the motion repeats."""
    averaging = _averaging(run)
    segments, folded = _segments(run, averaging)
    rate = run.rate / (run.step * averaging)
    sums, current = _Sums(places, widths, segments[0][1], averaging), 0
    for begin, columns, residual in chunks:
        end = begin + residual.shape[1]
        while current < len(segments):
            origin, length = segments[current]
            a, b = max(begin, origin), min(end, origin + length)
            if a < b:
                part = slice(a - begin, b - begin)
                sums.add(a - origin, [x[:, part] for x in columns], residual[:, part], run.mask[a:b].T)
            if end < origin + length:
                break
            current += 1
            if not folded:
                yield sums.gathered(rate, 1)
                if current < len(segments):
                    sums = _Sums(places, widths, segments[current][1], averaging)
    if folded:
        yield sums.gathered(rate, len(segments))


class _Sums:
    """Sums of columns and residuals, over groups of neighbouring rows and over all periods of a motion.

    Attributes:
        places: Rows of `columns` that belong to each joint's columns.
        widths: Number of columns of each joint.
        averaging: Number of rows that are averaged into one.
        columns: Sums of the W columns for M averaged rows, shape (W, M).
        residual: Sums of the residuals, shape (n, M).
        count: Number of rows in each sum, shape (n, M).
        squares: Sum of squared residuals, shape (n,).
        period_squares: Sum over the periods of (mean residual)² · number of rows, shape (n,).
    """

    def __init__(self, places: list[NDArray[np.intp]], widths: list[int], length: int, averaging: int) -> None:
        self.places, self.widths, self.averaging = places, widths, averaging
        M, n = -(-length // averaging), len(widths)
        self.columns, self.residual, self.count = (np.zeros((k, M)) for k in (sum(widths), n, n))
        self.squares, self.period_squares = np.zeros(n), np.zeros(n)

    def add(self, first: int, columns: list[Array], residual: Array, mask: NDArray[np.bool_]) -> None:
        """Adds rows to the sums; `first` is the index of the first added row in the segment."""
        group = np.arange(first, first + residual.shape[1]) // self.averaging
        starts = np.flatnonzero(np.diff(group, prepend=-1))
        into = slice(group[0], group[-1] + 1)
        for j, x in enumerate(columns):
            used = x if mask[j].all() else x * mask[j]
            summed = used if self.averaging == 1 else np.add.reduceat(used, starts, axis=1)
            self.columns[self.places[j], into] += summed
        used = residual * mask
        summed = np.add.reduceat(used, starts, axis=1)
        count = np.add.reduceat(mask.astype(np.float64), starts, axis=1)
        self.residual[:, into] += summed
        self.count[:, into] += count
        self.squares += (used**2).sum(axis=1)
        self.period_squares += (summed**2 / np.maximum(count, 1.0)).sum(axis=1)

    def gathered(self, rate: float, periods: int) -> GatheredBands:
        """The sums as averaged rows, scaled so that products and the level of white noise keep their size."""
        scale = 1.0 / np.sqrt(np.maximum(self.count, 1.0))
        residual = self.residual * scale
        within = np.zeros((2, len(self.widths)))
        if periods > 1:
            within[0] = self.period_squares - (residual**2).sum(axis=1)
            within[1] = (self.count > 0).sum(axis=1) * (periods - 1)
        columns = self.columns * np.repeat(scale, self.widths, axis=0)
        return GatheredBands(columns, residual, self.count > 0.0, rate, self.squares, within)


def _segments(run: ObservedRun, rows_per_mean: int) -> tuple[list[tuple[int, int]], bool]:
    """First row and number of rows of each segment of a run, and true if the segments are periods to be averaged."""
    periods = find_periods(run)
    if periods is not None:
        return [(int(a), int(periods[-1])) for a in periods[:-1]], True
    total, longest = len(run.rows), SEGMENT * rows_per_mean
    count = -(-total // longest)
    borders = [k * total // count for k in range(count + 1)]
    return [(a, b - a) for a, b in itertools.pairwise(borders)], False


def _averaging(run: ObservedRun) -> int:
    """Number of rows of a run that are averaged into one row."""
    return max(1, int(run.rate / (run.step * MAX_RATE)))


def _runs(problem: EstimationProblem) -> tuple[ObservedRun, ...]:
    return () if problem.observations is None else problem.observations.runs


def _lengths(problem: EstimationProblem) -> list[tuple[int, float]]:
    """Number of rows and row rate [Hz] of each segment that `gather_bands` yields."""
    lengths: list[tuple[int, float]] = []
    for run in _runs(problem):
        rows_per_mean = _averaging(run)
        segments, folded = _segments(run, rows_per_mean)
        lengths += [
            (-(-length // rows_per_mean), run.rate / (run.step * rows_per_mean))
            for _, length in segments[: 1 if folded else None]
        ]
    return lengths


def _labels(count: int, rate: float, edges: Array) -> tuple[NDArray[np.intp], Array]:
    """Index of the frequency band of each coefficient in the spectrum of `count` rows, and size of the coefficient.

    The size is 1 for a real coefficient and 2 for a complex one.
    """
    label = np.searchsorted(edges, frequencies(count) * rate, side="right") - 1
    real = np.full(len(label), 2.0)
    real[0] = 1.0
    real[-1] = 1.0 if count % 2 == 0 else 2.0
    return label, real


def _products(signals: Array, label: NDArray[np.intp], real: Array, bands: int) -> Array:
    """Products of the spectra of every two of k signals (k, M), summed over each frequency band, (bands, k, k)."""
    result = np.zeros((bands, len(signals), len(signals)))
    x = spectrum(signals.T) * np.sqrt(real / signals.shape[1])[:, None]
    for a, b in itertools.pairwise(np.flatnonzero(np.diff(label, prepend=-1, append=-1))):
        stacked = np.concatenate([x[a:b].real, x[a:b].imag])
        result[label[a]] = stacked.T @ stacked
    return result


def _part_variances(part: GatheredBands) -> Array:
    """Sum of squared residuals and number of rows in each of the P parts of the time, shape (P, 2, n)."""
    M = part.residual.shape[1]
    starts = np.unique(np.arange(PARTS) * M // PARTS)
    squares = np.add.reduceat(part.residual**2, starts, axis=1)
    counts = np.add.reduceat(part.counts.astype(np.float64), starts, axis=1)
    return np.stack([squares, counts]).transpose(2, 0, 1)
