"""Rate at which a correlated signal exceeds high levels: peaks over a threshold, with declustering [Coles2001].

Exceedances that are less than a gap apart form a cluster, and clusters count as independent. Above a level u, the
peaks of the clusters follow a generalised Pareto distribution, so that clusters exceed a level z with the rate

    λ(z) = N/T (1 + ξ (z - u)/σ)^(-1/ξ)

where N clusters above u were seen in the time T. The shape ξ and the scale σ are estimated by probability-weighted
moments [Hosking1987].
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
"""Number of clusters that the prior knowledge ξ = 0 is worth. It holds for squares of Gaussian noise; squares of model
errors have a positive shape. Few peaks determine the shape badly: its standard deviation is about 1/√N."""

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
    """

    level: float
    clusters: int
    seconds: float
    scale: float
    shape: float

    def exceeded_with(self, rate: float) -> float:
        """Level that clusters exceed with a given rate [1/s]; at least the level u."""
        ratio = max(self.clusters / (self.seconds * rate), 1.0)
        if self.shape < 1e-6:
            return self.level + self.scale * float(np.log(ratio))
        return self.level + self.scale * float(np.expm1(self.shape * np.log(ratio))) / self.shape

    def log_deviation(self, rate: float) -> float:
        """Standard deviation of the logarithm of the true rate at the level for a given rate [1/s].

        The number of clusters, the scale and the shape contribute 1/N, L²/N and L⁴/4N, where L is the logarithm of
        the ratio of the rate above u to the given rate.
        """
        L = max(float(np.log(self.clusters / (self.seconds * rate))), 0.0)
        return float(np.sqrt((1.0 + L**2 + 0.25 * L**4) / self.clusters))


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
    if len(peaks) <= wanted:
        return None
    level = float(peaks[-wanted - 1])
    over = [cluster_peaks(x, level, max(1, round(gap * rate))) for x, rate, _ in observed]
    excess = np.sort(np.concatenate(over)) - level
    n = len(excess)
    if n < LEAST_CLUSTERS:
        return None
    shape = _shape(excess) * n / (n + SHAPE_PRIOR)
    shape = float(np.clip(shape, *SHAPE_LIMITS))
    return Tail(level, n, seconds, float(excess.mean()) * (1.0 - shape), shape)


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
