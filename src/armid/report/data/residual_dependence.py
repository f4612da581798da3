"""Shares of the variance of a joint's residual that depend on velocity, position and reversals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.median import median
from armid.measurement.processing.options import ProcessingOptions
from armid.report.data.friction_at_reversals import HALF_WINDOW, since_reversal
from armid.report.data.recording_data import RecordingData, concatenated

BINS = 12
"""Number of classes of velocity, of position and of time; each class has about a dozen rows in short recordings."""


LARGE_SHARE = 0.2
"""Share of the residual's variance above which a further friction law is suggested."""


REPEATED_SHARE = 0.03
"""Share of the variance of a residual above which the residual counts as dependent on the velocity. It is the share
in each half of the rows that the class means of the other half predict. On simulated logs of a UR5e with the right
friction model the share is below 0.02. With a Stribeck peak of 35 % and load-dependent friction of 2 % that the
model lacks, the share is 0.04 to 0.1 on five of six joints."""


@dataclass(frozen=True, slots=True)
class ResidualShares:
    """Shares of the variance of a residual, 0 to 1; NaN if there are too few rows.

    Attributes:
        velocity: Share of the variance that depends on the velocity.
        position: Share of the variance that depends on position and direction of motion.
        reversal: Share of the variance of the residual, multiplied by the sign of the velocity, that depends on the
            time since the last reversal.
    """

    velocity: float
    position: float
    reversal: float


def residual_shares(recordings: Sequence[RecordingData], processing: ProcessingOptions, j: int) -> ResidualShares:
    """Shares of the variance of the residual of joint `j` over several recordings."""
    if not recordings:
        return ResidualShares(np.nan, np.nan, np.nan)
    residual, dq, q = (
        concatenated(recordings, "residual", j),
        concatenated(recordings, "dq", j),
        concatenated(recordings, "q", j),
    )
    since = np.concatenate([_time_since_reversal(each, j) for each in recordings])
    share = min(_independent_share(each, processing) for each in recordings)
    forward = (dq > 0.0).astype(np.intp)
    direction = np.where(dq > 0.0, 1.0, -1.0)
    return ResidualShares(
        explained(residual, classes(dq), share),
        explained(residual, classes(q) * 2 + forward, share),
        explained(
            np.where(np.isfinite(since), direction * residual, np.nan), classes(np.minimum(since, HALF_WINDOW)), share
        ),
    )


def depends_on_velocity(recordings: Sequence[RecordingData], j: int) -> bool:
    """True if the residual of a joint depends on its velocity by the same law in both halves of the recordings."""
    if not recordings:
        return False
    residual, dq = concatenated(recordings, "residual", j), concatenated(recordings, "dq", j)
    return repeated_share(residual, classes(dq)) > REPEATED_SHARE


def repeated_share(values: Array, label: NDArray[np.intp]) -> float:
    """Share of the variance of one half of the values (M,) that the class means of the other half predict.

    Slow noise can look like a dependence on the class in one half, but has no such effect in the other half.

    Args:
        values: Values; NaN is ignored.
        label: Class of each value, shape (M,).

    Returns:
        The smaller one of the shares of the two halves; negative if the class means predict worse than the mean; NaN
        without values.
    """
    known = np.isfinite(values)
    _, label = np.unique(label[known], return_inverse=True)
    halves = np.array_split(np.arange(int(known.sum())), 2)
    shares: list[float] = []
    for own, other in (halves, halves[::-1]):
        count, group = np.bincount(label[own], minlength=len(label)), label[other]
        mean = np.bincount(label[own], values[known][own], minlength=len(label)) / np.maximum(count, 1)
        measured, predicted = values[known][other], mean[group]
        measured, predicted = (x - x.mean() if len(x) else x for x in (measured, predicted))
        total = float(measured @ measured)
        shares.append(1.0 - float(np.sum((measured - predicted) ** 2)) / total if total else np.nan)
    return float(np.min(shares))


def explained(values: Array, label: NDArray[np.intp], independent: float) -> float:
    """Share of the variance of values (M,) that their classes explain: the correlation ratio, adjusted for chance.

    Args:
        values: Values; NaN is ignored.
        label: Class of each value, shape (M,).
        independent: Share of the values that are independent of each other.

    Returns:
        Share from 0 (no more than by chance) to 1; NaN if there are fewer independent values than classes.
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
    """Class of each value (M,): one of `BINS` classes of equal width, or a further class for values not finite."""
    known = x[np.isfinite(x)]
    if not len(known) or np.ptp(known) == 0.0:
        return np.zeros(len(x), dtype=np.intp)
    edges = np.linspace(known.min(), known.max(), BINS + 1)[1:-1]
    return np.where(np.isfinite(x), np.digitize(x, edges), BINS).astype(np.intp)


def _time_since_reversal(recording: RecordingData, j: int) -> Array:
    if not recording.is_consecutive:
        return np.full(len(recording.time), np.nan)
    runs = pairwise(recording.starts)
    return np.concatenate([since_reversal(recording.time[a:b], recording.dq[a:b, j]) for a, b in runs])


def _independent_share(recording: RecordingData, processing: ProcessingOptions) -> float:
    """Share of rows that are independent after filtering: two rows in each cycle of the cut-off frequency."""
    if processing.family == "none" or not recording.is_consecutive:
        return 1.0
    return min(1.0, 2.0 * float(processing.cutoff) * float(median(np.diff(recording.time))))
