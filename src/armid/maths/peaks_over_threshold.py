"""Rate at which a correlated signal exceeds high levels: peaks over a threshold, with declustering [Coles2001].

Exceedances that are less than a gap apart form a cluster, and clusters count as independent. Above a level u, the
peaks of the clusters follow a generalised Pareto distribution, so that clusters exceed a level z with the rate

    λ(z) = N/T (1 + ξ (z - u)/σ)^(-1/ξ)

where N clusters above u were seen in the time T. The shape ξ and the scale σ are estimated by probability-weighted
moments [Hosking1987]. The level is the lowest one above which the peaks fit this distribution: where reversals of
friction cause peaks of another size than noise does, only the larger ones tell the tail.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array

SLOT_SHARE = 0.1
"""Share of the time slots of one gap whose clusters are used for the tail: a high level has few clusters, a low one
peaks that do not follow the distribution yet."""

MOST_CLUSTERS, LEAST_CLUSTERS = 400, 10
"""Largest number of clusters that are used, and smallest number from which a tail is estimated."""

SHAPE_PRIOR = 40.0
"""Number of clusters that the prior knowledge ξ = 0 is worth. It holds for squares of Gaussian noise; those of model
errors have a positive shape. Few peaks determine the shape badly: its standard deviation is about 1/√N."""

MISFIT = 0.17
"""Cramér-von Mises statistic from which peaks do not fit: 5 % of samples exceed about 0.15 [Choulakian2001]."""

PIECES = 10
"""Number of pieces of the observed time, at least, whose numbers of clusters are compared."""

SHAPE_LIMITS = (0.0, 0.5)
"""Smallest and largest shape. A negative shape would be a promise that a level is never exceeded."""


@dataclass(frozen=True, slots=True)
class Tail:
    """Rate at which clusters of a signal exceed high levels.

    Attributes:
        level: Level u, from which the tail is known.
        clusters: Number N of clusters above this level.
        seconds: Observed time T [s].
        scale: Scale σ of the excess of the peaks.
        shape: Shape ξ.
        dispersion: Variance of the number of clusters in pieces of the time, divided by its mean, at least 1. It
            exceeds 1 where clusters are not independent, for instance because parts of the time differ.
    """

    level: float
    clusters: int
    seconds: float
    scale: float
    shape: float
    dispersion: float = 1.0

    def exceeded_with(self, rate: float) -> float:
        """Level that clusters exceed with a given rate [1/s]; at least the level u."""
        ratio = max(self.clusters / (self.seconds * rate), 1.0)
        if self.shape < 1e-6:
            return self.level + self.scale * float(np.log(ratio))
        return self.level + self.scale * float(np.expm1(self.shape * np.log(ratio))) / self.shape

    def log_deviation(self, rate: float) -> float:
        """Standard deviation of the logarithm of the true rate at the level for a given rate [1/s].

        The number of clusters, the scale and the shape contribute 1/N, L²/N and L⁴/4N, where L is the logarithm of
        the ratio of the rate above u to the given rate, and N the number of clusters divided by their dispersion.
        """
        L = max(float(np.log(self.clusters / (self.seconds * rate))), 0.0)
        return float(np.sqrt((1.0 + L**2 + 0.25 * L**4) * self.dispersion / self.clusters))


def cluster_peaks(signal: Array, level: float, gap: int) -> Array:
    """Peaks of the clusters of a signal (N,) above a level; clusters are at least `gap` samples apart."""
    above = np.flatnonzero(signal > level)
    if not len(above):
        return np.zeros(0)
    first = np.concatenate([[0], np.flatnonzero(np.diff(above) >= gap) + 1])
    return np.maximum.reduceat(signal[above], first)


def fit_tail(signals: Sequence[tuple[Array, float]], gap: float) -> Tail | None:
    """Tail of a nonnegative signal that was observed in several parts.

    Args:
        signals: For each part, its samples (N,) and their rate [Hz]; NaN where the signal was not observed.
        gap: Time between two clusters [s].

    Returns:
        The tail; `None` if there are too few clusters.
    """
    observed = [(np.nan_to_num(x, nan=-np.inf), rate, np.count_nonzero(~np.isnan(x)) / rate) for x, rate in signals]
    seconds = sum(each[2] for each in observed)
    wanted = int(min(MOST_CLUSTERS, SLOT_SHARE * seconds / gap))
    if wanted < LEAST_CLUSTERS:
        return None
    peaks = np.sort(np.concatenate([_slot_peaks(x, round(gap * rate)) for x, rate, _ in observed]))
    split = -(-PIECES // len(observed))
    pieces = [(part, rate) for x, rate, _ in observed for part in np.array_split(x, split)]
    found: Tail | None = None
    while LEAST_CLUSTERS <= wanted < len(peaks):
        at = float(peaks[-wanted - 1])
        over = [cluster_peaks(x, at, max(1, round(gap * rate))) for x, rate in pieces]
        excess = np.sort(np.concatenate(over)) - at
        if len(excess) < LEAST_CLUSTERS:
            break
        found = _tail(at, excess, over, pieces, seconds)
        if _misfit(excess, found) <= MISFIT:
            break
        wanted = wanted * 2 // 3
    return found


def _tail(
    level: float, excess: Array, over: Sequence[Array], pieces: Sequence[tuple[Array, float]], seconds: float
) -> Tail:
    """Tail from the sorted excesses (N,) over a level, and the peaks of each piece."""
    n = len(excess)
    shape = _shape(excess) * n / (n + SHAPE_PRIOR)
    shape = float(np.clip(shape, *SHAPE_LIMITS))
    times = np.array([np.count_nonzero(np.isfinite(x)) / rate for x, rate in pieces])
    counts = np.array([len(each) for each in over])[times > 0.0]
    expected = n * times[times > 0.0] / times.sum()
    dispersion = float(np.sum((counts - expected) ** 2 / expected)) / max(len(counts) - 1, 1)
    return Tail(level, n, seconds, float(excess.mean()) * (1.0 - shape), shape, max(dispersion, 1.0))


def _misfit(excess: Array, tail: Tail) -> float:
    """Cramér-von Mises statistic of sorted excesses (N,) and a tail."""
    n, x = len(excess), excess / tail.scale
    survival = np.exp(-x) if tail.shape < 1e-6 else (1.0 + tail.shape * x) ** (-1.0 / tail.shape)
    steps = (2.0 * np.arange(1, n + 1) - 1.0) / (2.0 * n)
    return float(np.sum((1.0 - survival - steps) ** 2)) + 1.0 / (12.0 * n)


def _slot_peaks(signal: Array, width: int) -> Array:
    """Largest value of each slot of `width` samples, without slots that were not observed."""
    width = max(1, width)
    whole = len(signal) // width * width
    peaks = signal[:whole].reshape(-1, width).max(axis=1) if whole else np.zeros(0)
    return peaks[np.isfinite(peaks)]


def _shape(excess: Array) -> float:
    """Shape of a generalised Pareto distribution by probability-weighted moments of sorted values (N,)."""
    n = len(excess)
    mean = float(excess.mean())
    weighted = float(np.mean(excess * (n - np.arange(1, n + 1)) / (n - 1)))
    return 2.0 - mean / (mean - 2.0 * weighted) if mean > 2.0 * weighted else SHAPE_LIMITS[1]
