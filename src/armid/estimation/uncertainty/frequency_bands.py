"""Columns and residuals of recordings by frequency band: a second pass over the rows, compressed to products.

Residuals have a spectrum: friction that the model lacks is slow, sensors hiss, filters cut. How much of each
frequency's noise goes into an estimate depends on how much the columns have of that frequency. Both sides are
therefore kept as products of Fourier coefficients, summed over narrow bands of the frequency axis.

Where the motion repeats, the periods are first put together (`folded`): what a model lacks repeats with the motion
and does not average out, and only the mean of the periods, taken as one recording, shows how large it is.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.estimation.problem import EstimationProblem
from armid.information.column_source import ColumnSource, column_source
from armid.information.hysteresis_states import with_hysteresis_states
from armid.information.regressor_rows import rows
from armid.maths.spectrum import frequencies, spectrum
from armid.measurement.observations import ObservedRun
from armid.values import Array

__all__ = [
    "BandProducts",
    "GatheredBands",
    "band_edges",
    "band_products",
    "gather_bands",
    "has_repetitions",
    "named_columns",
    "residual_moments",
]

ENOUGH_RATE = 100.0
"""Rows a second that show all of a spectrum that an arm's motion reaches [Hz]; denser rows are averaged."""

SEGMENT = 8192
"""Rows transformed at a time, after averaging: longer than noise of an arm remembers."""

NARROW = 8.0
"""Real numbers of a recording's spectrum in the lowest band: four frequencies and their phases."""

PER_OCTAVE = 3
"""Bands an octave, narrow enough for a filter's edge."""

SAME_MOTION = 0.05
"""Largest RMS difference of two periods' positions, over their spread, that is still the same motion: a hundredth is
what controllers leave, and rows that lie up to half a step apart in phase add as much again."""

PIECES = 10
"""Parts of a segment whose variances are compared."""


@dataclass(frozen=True, eq=False, slots=True)
class GatheredBands:
    """Consecutive rows, perhaps averaged, perhaps several periods in one.

    A row that stands for m rows of a joint is their sum over √m, so that products and white noise keep their size.

    Attributes:
        columns: Joint by joint, zero where nothing counts, shape (W, M).
        residual: Shape (n, M) [N·m or N].
        counts: Whether anything counts, shape (n, M).
        rate: Rows a second [Hz].
        squares: Sum of squares of the residual's rows as they were, shape (n,).
        within: Sum of squares and number of rows that the difference between periods has, shape (2, n).
    """

    columns: Array
    residual: Array
    counts: NDArray[np.bool_]
    rate: float
    squares: Array
    within: Array


@dataclass(frozen=True, eq=False, slots=True)
class BandProducts:
    """Products in E bands of the columns of n joints, W altogether, and of residuals.

    Attributes:
        parameters: Parameters of each joint's columns, shapes (k_j,).
        edges: Lower edge of each band [Hz], shape (E,).
        frequency: Mean frequency of each band [Hz], shape (E,).
        count: Real numbers that each pair of joints has in each band, shape (E, n, n).
        products: Of columns, shape (E, W, W).
        moments: Of residuals, shape (E, n, n) [N²·m² or N²].
        pieces: Sum of squares, number of rows of parts of the time, shape (parts, 2, n).
        squares: Sum of squared residuals of all rows, shape (n,).
        within: Sum of squares and number of rows that the difference between periods has, shape (2, n); zero where
            nothing was folded.
        averaged: Whether rows are means, of others beside them or of periods.
    """

    parameters: tuple[NDArray[np.int32], ...]
    edges: Array
    frequency: Array
    count: Array
    products: Array
    moments: Array
    pieces: Array
    squares: Array
    within: Array
    averaged: bool

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.parameters)

    @property
    def offset(self) -> NDArray[np.int64]:
        """First column of each joint, and the number of columns, shape (n + 1,)."""
        return np.cumsum([0, *(len(own) for own in self.parameters)])


def gather_bands(problem: EstimationProblem, values: Array) -> Iterator[GatheredBands]:
    """The rows of a problem with their residuals, averaged to a moderate rate, periods folded.

    Args:
        problem: With its samples.
        values: Of the parameters of the problem's information, shape (b,), or of each joint's torque, shape (n, b).
    """
    model, base, observations = problem.require_samples("cover")
    information = problem.information
    values = np.broadcast_to(values, (information.n, information.count))
    source = column_source(model, base)
    for given in observations.runs:
        run = with_hysteresis_states(model, given, observations.band)
        parameters = named_columns(source, information.names, run)
        places = [np.searchsorted(j.parameters, own) for j, own in zip(information.joints, parameters, strict=True)]
        width = [len(joint.parameters) for joint in information.joints]
        collector = _Collector(run, places, width)
        for begin, x in rows(source, run, observations.band):
            blocks = [x[a:b] for a, b in zip(source.layout.offset, source.layout.offset[1:], strict=False)]
            columns = [block[:-1] for block in blocks]
            residual = [
                block[-1] - each[own] @ block[:-1]
                for block, each, own in zip(blocks, values, parameters, strict=True)
            ]
            yield from collector.take(begin, columns, np.array(residual))
        yield from collector.rest()


def band_products(problem: EstimationProblem, values: Array) -> BandProducts:
    """Everything that the covariance of an estimate needs of the rows.

    Args:
        problem: With its samples.
        values: The estimate, shape (b,), or that of each joint's torque, shape (n, b).
    """
    parameters = tuple(joint.parameters for joint in problem.information.joints)
    n, W = len(parameters), sum(len(own) for own in parameters)
    parts = list(gather_bands(problem, values)) if _is_short(problem) else None
    lengths = [(part.residual.shape[1], part.rate) for part in parts] if parts else _lengths(problem)
    edges = band_edges(lengths)
    E = len(edges)
    products, moments, count = np.zeros((E, W, W)), np.zeros((E, n, n)), np.zeros((E, n, n))
    weighted = np.zeros((E, 2))
    pieces: list[Array] = []
    squares, within = np.zeros(n), np.zeros((2, n))
    for part in parts if parts is not None else gather_bands(problem, values):
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
        pieces.append(_pieces(part))
    used = weighted[:, 1] > 0.0
    averaged = bool(within.any()) or any(_averaging(run) > 1 for run in _runs(problem))
    return BandProducts(
        parameters,
        edges[used],
        weighted[used, 0] / weighted[used, 1],
        count[used],
        products[used],
        moments[used],
        np.concatenate(pieces),
        squares,
        within,
        averaged,
    )


def residual_moments(residual: Array, rate: float, bands: BandProducts) -> Array:
    """Products of one segment's residuals in the bands of others, shape (E, n, n).

    Args:
        residual: Shape (n, M).
        rate: Rows a second [Hz].
        bands: Where the bands are.
    """
    label, real = _labels(residual.shape[1], rate, bands.edges)
    return _products(residual, label, real, len(bands.edges))


def band_edges(lengths: list[tuple[int, float]]) -> Array:
    """Lower edges of the bands [Hz], from what spectra of segments of some lengths and rates can tell apart.

    Args:
        lengths: Rows and rate [Hz] of each segment.
    """
    seconds = sum(rows / rate for rows, rate in lengths)
    step = 1.0 / max(rows / rate for rows, rate in lengths)
    highest = max(rate for _, rate in lengths) / 2.0
    edges = [0.0, max(NARROW / (2.0 * seconds), step)]
    while edges[-1] < highest:
        edges.append(max(edges[-1] * 2.0 ** (1.0 / PER_OCTAVE), edges[-1] + step))
    edges.pop()
    if len(edges) > 2 and highest - edges[-1] < 0.5 * (edges[-1] - edges[-2]):
        edges.pop()  # hardly anything lies above it
    return np.array([0.0, *(np.array(edges[1:]) - step / 2.0)])


def named_columns(source: ColumnSource, names: tuple[str, ...], run: ObservedRun) -> list[NDArray[np.int64]]:
    """Numbers of each joint's columns among parameters, of which each recording may have its own copies."""
    number, copy = {name: k for k, name in enumerate(names)}, f"[{run.recording + 1}]"
    every = np.array([number.get(name, number.get(name + copy, -1)) for name in source.names], dtype=np.int64)
    return [every[own] for own in source.layout.parameters]


def has_repetitions(run: ObservedRun) -> NDArray[np.int64] | None:
    """First rows of the periods of a motion that repeats, and the shortest one's number of rows at the end.

    Blocks are the periods where repetitions are not known.

    Returns:
        `None` where the blocks are no periods of one motion.
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
    apart = np.sqrt(np.mean((periods - periods.mean(axis=0)) ** 2, axis=(1, 2)))
    if not (apart <= SAME_MOTION * spread).all():
        return None
    return np.append(begins, length)


class _Collector:
    """Puts the rows of one run together: averaged, in segments or folded into one period."""

    def __init__(self, run: ObservedRun, places: list[NDArray[np.intp]], width: list[int]) -> None:
        self.run, self.places, self.width = run, places, width
        self.of = np.repeat(np.arange(len(width)), width)
        self.each = _averaging(run)
        self.stretches, self.folded = _stretches(run, self.each)
        self.at = 0
        self._clear()

    def _clear(self) -> None:
        length = -(-self.stretches[self.at][1] // self.each) if self.at < len(self.stretches) else 0
        n = len(self.width)
        self.sums = np.zeros((len(self.of), length))
        self.residual = np.zeros((n, length))
        self.count = np.zeros((n, length))
        self.squares = np.zeros(n)
        self.apart = np.zeros(n)

    def take(self, begin: int, columns: list[Array], residual: Array) -> Iterator[GatheredBands]:
        """Take rows that follow those taken; gives what is complete."""
        end = begin + residual.shape[1]
        while self.at < len(self.stretches):
            origin, length = self.stretches[self.at]
            a, b = max(begin, origin), min(end, origin + length)
            if a < b:
                self._add(
                    a - origin, [x[:, a - begin : b - begin] for x in columns], residual[:, a - begin : b - begin]
                )
            if end < origin + length:
                return
            self.at += 1
            if not self.folded:
                yield self._gathered(1)
                self._clear()

    def rest(self) -> Iterator[GatheredBands]:
        """Return what folding has put together."""
        if self.folded:
            yield self._gathered(len(self.stretches))

    def _add(self, first: int, columns: list[Array], residual: Array) -> None:
        """Add rows whose first is row `first` of their stretch."""
        origin = self.stretches[self.at][0] + first
        length = residual.shape[1]
        mask = self.run.mask[origin : origin + length].T
        group = np.arange(first, first + length) // self.each
        starts = np.flatnonzero(np.diff(group, prepend=-1))
        into = group[starts]
        column = 0
        for j, x in enumerate(columns):
            kept = x if mask[j].all() else x * mask[j]
            summed = kept if self.each == 1 else np.add.reduceat(kept, starts, axis=1)
            self.sums[column + self.places[j], into[0] : into[-1] + 1] += summed
            column += self.width[j]
        kept = residual * mask
        summed = np.add.reduceat(kept, starts, axis=1)
        count = np.add.reduceat(mask.astype(np.float64), starts, axis=1)
        self.residual[:, into] += summed
        self.count[:, into] += count
        self.squares += (kept**2).sum(axis=1)
        self.apart += (summed**2 / np.maximum(count, 1.0)).sum(axis=1)

    def _gathered(self, periods: int) -> GatheredBands:
        """Return what was added, with rows scaled to keep products and white noise at their size."""
        scale = 1.0 / np.sqrt(np.maximum(self.count, 1.0))
        residual = self.residual * scale
        within = np.zeros((2, len(self.width)))
        if periods > 1:
            within[0] = self.apart - (residual**2).sum(axis=1)
            within[1] = (self.count > 0).sum(axis=1) * (periods - 1)
        return GatheredBands(
            self.sums * scale[self.of],
            residual,
            self.count > 0.0,
            self.run.rate / (self.run.step * self.each),
            self.squares.copy(),
            within,
        )


def _stretches(run: ObservedRun, each: int) -> tuple[list[tuple[int, int]], bool]:
    """First row and number of rows of what is taken together, and whether all of it goes into one."""
    periods = has_repetitions(run)
    if periods is not None:
        return [(int(a), int(periods[-1])) for a in periods[:-1]], True
    total, longest = len(run.rows), SEGMENT * each
    parts = -(-total // longest)
    borders = [k * total // parts for k in range(parts + 1)]
    return [(a, b - a) for a, b in itertools.pairwise(borders)], False


def _averaging(run: ObservedRun) -> int:
    """Rows that are averaged into one."""
    return max(1, int(run.rate / (run.step * ENOUGH_RATE)))


def _runs(problem: EstimationProblem) -> tuple[ObservedRun, ...]:
    return () if problem.observations is None else problem.observations.runs


def _is_short(problem: EstimationProblem) -> bool:
    """Tell whether all rows fit in memory together, so that they need to be made only once."""
    return sum(rows for rows, _ in _lengths(problem)) <= SEGMENT


def _lengths(problem: EstimationProblem) -> list[tuple[int, float]]:
    """Rows and rate of what `gather_bands` will give."""
    found: list[tuple[int, float]] = []
    for run in _runs(problem):
        each = _averaging(run)
        parts, folded = _stretches(run, each)
        found += [(-(-length // each), run.rate / (run.step * each)) for _, length in parts[: 1 if folded else None]]
    return found


def _labels(count: int, rate: float, edges: Array) -> tuple[NDArray[np.intp], Array]:
    """Band of each coefficient of the spectrum of so many rows, and how many real numbers each is."""
    label = np.searchsorted(edges, frequencies(count) * rate, side="right") - 1
    real = np.full(len(label), 2.0)
    real[0] = 1.0
    real[-1] = 1.0 if count % 2 == 0 else 2.0
    return label, real


def _products(signals: Array, label: NDArray[np.intp], real: Array, bands: int) -> Array:
    """Products of signals (k, M) in each band, shape (bands, k, k)."""
    result = np.zeros((bands, len(signals), len(signals)))
    x = spectrum(signals.T) * np.sqrt(real / signals.shape[1])[:, None]
    for a, b in itertools.pairwise(np.flatnonzero(np.diff(label, prepend=-1, append=-1))):
        parts = np.concatenate([x[a:b].real, x[a:b].imag])
        result[label[a]] = parts.T @ parts
    return result


def _pieces(part: GatheredBands) -> Array:
    """Sum of squares and number of rows of parts of the time, shape (parts, 2, n)."""
    M = part.residual.shape[1]
    starts = np.unique(np.arange(PIECES) * M // PIECES)
    squares = np.add.reduceat(part.residual**2, starts, axis=1)
    counts = np.add.reduceat(part.counts.astype(np.float64), starts, axis=1)
    return np.stack([squares, counts]).transpose(2, 0, 1)
