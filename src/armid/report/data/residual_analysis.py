"""Dependence of the residual of a joint: shares of its variance, chance taken off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from armid.measurement.processing.options import ProcessingOptions
from armid.report.data.friction_at_reversals import HALF_WINDOW, since_reversal
from armid.report.data.recording_data import RecordingData, joined
from armid.values import Array

__all__ = ["MUCH", "ResidualShares", "explained", "residual_shares"]

BINS = 12
"""Classes of velocity, position and time: coarse enough for a dozen rows in each of short recordings."""


MUCH = 0.2
"""Share of the residual's variance that is worth a law of its own."""


@dataclass(frozen=True, slots=True)
class ResidualShares:
    """Shares of a residual's variance, 0 to 1; NaN where there is nothing to judge by.

    Attributes:
        velocity: That follow from the velocity.
        position: From the position and the direction of motion.
        reversal: From the time since the last reversal, in the direction of motion.
    """

    velocity: float
    position: float
    reversal: float


def residual_shares(evidence: Sequence[RecordingData], processing: ProcessingOptions, j: int) -> ResidualShares:
    """Return what the residual of a joint depends on, over several recordings."""
    if not evidence:
        return ResidualShares(np.nan, np.nan, np.nan)
    residual, dq, q = joined(evidence, "residual", j), joined(evidence, "dq", j), joined(evidence, "q", j)
    since = np.concatenate([_since(each, j) for each in evidence])
    share = min(_independent(each, processing) for each in evidence)
    forward = (dq > 0.0).astype(np.intp)
    way = np.where(dq > 0.0, 1.0, -1.0)
    return ResidualShares(
        explained(residual, classes(dq), share),
        explained(residual, classes(q) * 2 + forward, share),
        explained(
            np.where(np.isfinite(since), way * residual, np.nan), classes(np.minimum(since, HALF_WINDOW)), share
        ),
    )


def explained(values: Array, label: NDArray[np.intp], independent: float) -> float:
    """Share of the variance of values (M,) that their class explains: the correlation ratio, adjusted for chance.

    Args:
        values: NaN is left out.
        label: Class of each value, shape (M,).
        independent: Share of the values that are independent of each other.

    Returns:
        From 0, no more than chance, to 1; NaN where there are fewer independent values than classes.
    """
    known = np.isfinite(values)
    values, label = values[known], label[known]
    _, label = np.unique(label, return_inverse=True)
    groups = int(label.max(initial=-1)) + 1
    count = independent * len(values)
    total = float(np.sum((values - values.mean()) ** 2)) if len(values) else 0.0
    if count <= groups + 1 or total == 0.0:
        return np.nan
    mean = np.bincount(label, values) / np.bincount(label)
    within = float(np.sum((values - mean[label]) ** 2))
    return max(0.0, 1.0 - within / total * (count - 1.0) / (count - groups))


def classes(x: Array) -> NDArray[np.intp]:
    """Class of each value, the range in equal parts; what is not finite has a class of its own."""
    known = x[np.isfinite(x)]
    if not len(known) or np.ptp(known) == 0.0:
        return np.zeros(len(x), dtype=np.intp)
    edges = np.linspace(known.min(), known.max(), BINS + 1)[1:-1]
    return np.where(np.isfinite(x), np.digitize(x, edges), BINS).astype(np.intp)


def _since(evidence: RecordingData, j: int) -> Array:
    if not evidence.is_consecutive:
        return np.full(len(evidence.time), np.nan)
    runs = pairwise(evidence.starts)
    return np.concatenate([since_reversal(evidence.time[a:b], evidence.dq[a:b, j]) for a, b in runs])


def _independent(evidence: RecordingData, processing: ProcessingOptions) -> float:
    """Rows that a band leaves independent: two a cycle of its cut-off."""
    if processing.family == "none" or not evidence.is_consecutive:
        return 1.0
    return min(1.0, 2.0 * float(processing.cutoff) * float(np.median(np.diff(evidence.time))))
