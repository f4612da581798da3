"""Rate at which a correlated signal exceeds high levels: peaks over a threshold, with declustering [Coles2001].

Exceedances that are less than a gap apart form a cluster, and clusters count as independent. Above a level u, the
excesses of the cluster peaks follow a generalised Pareto distribution, so clusters exceed a level z with the rate

    λ(z) = N/T (1 + ξ (z - u)/σ)^(-1/ξ)

where N is the number of clusters above u in the observed time T. The shape ξ and the scale σ are estimated by
probability-weighted moments [Hosking1987]. As u, the lowest level is used above which the peaks fit this
distribution. If, for instance, reversals of friction cause larger peaks than noise does, only the larger peaks
determine the tail.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array

SLOT_SHARE = 0.1
"""Number of clusters that are used for the tail, divided by the number of time slots of one gap each. Above a high
level there are only few clusters; above a low level, the peaks do not follow the distribution."""

MOST_CLUSTERS, LEAST_CLUSTERS = 400, 10
"""Largest and smallest number of clusters from which a tail is estimated."""

SHAPE_PRIOR = 40.0
"""Number of clusters to which the prior knowledge ξ = 0 is equivalent. The prior holds for squares of Gaussian noise;
squares of model errors have a positive shape. Few peaks determine the shape badly: its standard deviation is about
1/√N."""

MISFIT = 0.17
"""Largest Cramér-von Mises statistic at which peaks fit the distribution; 5 % of samples that follow the distribution
exceed about 0.15 [Choulakian2001]."""

PIECES = 10
"""Smallest number of pieces into which the observed time is divided to compare their numbers of clusters."""

SHAPE_LIMITS = (0.0, 0.5)
"""Smallest and largest shape ξ. With a negative shape, the rate above some level would be exactly zero, which data
cannot prove."""


@dataclass(frozen=True, slots=True)
class Tail:
    """Tail of a signal: distribution from which the rate follows at which clusters exceed high levels.

    Attributes:
        level: Level u above which the distribution holds, in the unit of the signal.
        clusters: Number N of clusters above this level.
        seconds: Observed time T [s].
        scale: Scale σ of the excesses of the peaks over u, in the unit of the signal.
        shape: Shape ξ of the distribution.
        dispersion: Variance of the numbers of clusters in pieces of the time, divided by their mean, at least 1. It
            exceeds 1 if clusters are not independent, for instance because parts of the time differ.
    """

    level: float
    clusters: int
    seconds: float
    scale: float
    shape: float
    dispersion: float = 1.0

    def exceeded_with(self, rate: float) -> float:
        """Level that clusters exceed at a given rate [1/s], not less than the level u."""
        ratio = max(self.clusters / (self.seconds * rate), 1.0)
        if self.shape < 1e-6:
            return self.level + self.scale * float(np.log(ratio))
        return self.level + self.scale * float(np.expm1(self.shape * np.log(ratio))) / self.shape

    def log_deviation(self, rate: float) -> float:
        """Standard deviation of the logarithm of the true rate at the level `exceeded_with(rate)`; rate in 1/s.

        The number of clusters, the scale and the shape contribute 1/N, L²/N and L⁴/4N to the variance. Here L is the
        logarithm of the ratio of the rate above u to the given rate, and N the number of clusters divided by their
        dispersion.
        """
        L = max(float(np.log(self.clusters / (self.seconds * rate))), 0.0)
        return float(np.sqrt((1.0 + L**2 + 0.25 * L**4) * self.dispersion / self.clusters))


def cluster_peaks(signal: Array, level: float, gap: int) -> Array:
    """Largest value of each cluster in which a signal (N,) exceeds a level, shape (clusters,).

    A new cluster begins if an exceedance is at least `gap` samples after the one before.
    """
    above = np.flatnonzero(signal > level)
    if not len(above):
        return np.zeros(0)
    first = np.concatenate([[0], np.flatnonzero(np.diff(above) >= gap) + 1])
    return np.maximum.reduceat(signal[above], first)


def fit_tail(signals: Sequence[tuple[Array, float]], gap: float) -> Tail | None:
    """Estimates the tail of a nonnegative signal that was observed in several parts.

    Args:
        signals: For each part, its samples (N,) and their rate [Hz]; samples are NaN where the signal was not
            observed.
        gap: Smallest time between two clusters [s].

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
    """Tail estimated from the sorted excesses (N,) over a level and from the cluster peaks in each piece."""
    n = len(excess)
    shape = _shape(excess) * n / (n + SHAPE_PRIOR)
    shape = float(np.clip(shape, *SHAPE_LIMITS))
    times = np.array([np.count_nonzero(np.isfinite(x)) / rate for x, rate in pieces])
    counts = np.array([len(each) for each in over])[times > 0.0]
    expected = n * times[times > 0.0] / times.sum()
    dispersion = float(np.sum((counts - expected) ** 2 / expected)) / max(len(counts) - 1, 1)
    return Tail(level, n, seconds, float(excess.mean()) * (1.0 - shape), shape, max(dispersion, 1.0))


def _misfit(excess: Array, tail: Tail) -> float:
    """Cramér-von Mises statistic of the difference between sorted excesses (N,) and the distribution of a tail."""
    n, x = len(excess), excess / tail.scale
    survival = np.exp(-x) if tail.shape < 1e-6 else (1.0 + tail.shape * x) ** (-1.0 / tail.shape)
    steps = (2.0 * np.arange(1, n + 1) - 1.0) / (2.0 * n)
    return float(np.sum((1.0 - survival - steps) ** 2)) + 1.0 / (12.0 * n)


def _slot_peaks(signal: Array, width: int) -> Array:
    """Largest value in each slot of `width` successive samples; slots without observed samples are left out."""
    width = max(1, width)
    whole = len(signal) // width * width
    peaks = signal[:whole].reshape(-1, width).max(axis=1) if whole else np.zeros(0)
    return peaks[np.isfinite(peaks)]


def _shape(excess: Array) -> float:
    """Shape ξ of a generalised Pareto distribution from sorted excesses (N,), by probability-weighted moments."""
    n = len(excess)
    mean = float(excess.mean())
    weighted = float(np.mean(excess * (n - np.arange(1, n + 1)) / (n - 1)))
    return 2.0 - mean / (mean - 2.0 * weighted) if mean > 2.0 * weighted else SHAPE_LIMITS[1]
