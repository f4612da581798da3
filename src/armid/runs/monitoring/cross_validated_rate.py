"""Rate of false alarms by cross-validation: thresholds are computed without a part of the unseen motion.

The alarms on this part are then counted. Levels, tails and the variant of the threshold are all chosen with the peaks
of the motion from which the thresholds are made. Other motion therefore has more alarms than the tails predict. On
three simulated arms with three sets of 15 minutes each, an hour of other motion had 1.23 times the predicted alarms
in the mean, and at most 1.84 times; cross-validation on the 15 minutes gave 1.00 to 1.36 times.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.peaks_over_threshold import Tail
from armid.runs.monitoring.observer import Observed
from armid.runs.monitoring.thresholds import Thresholds, alarm_rows, find_thresholds, usable_seconds
from armid.study.progress import Progress, no_progress

FOLDS = 10
"""Number of folds of the cross-validation, and smallest number of pieces into which the unseen motion is divided."""

EXPECTED = 25.0
"""Smallest expected number of alarms on the unseen motion for the cross-validation: with fewer alarms, the ratio of
counted to expected alarms is too uncertain. For a lower rate, the ratio at this number is used."""


def validated_thresholds(
    unseen: Sequence[Observed], friction: Array, per_hour: float, excess: float
) -> tuple[Thresholds, tuple[Tail | None, ...]]:
    """Computes thresholds for a rate of false alarms on other motion than that from which they are computed.

    Args:
        unseen: Residuals of unseen motion without contact.
        friction: Dry friction of each joint, shape (n,) [N·m or N].
        per_hour: False alarms per hour, of the whole arm.
        excess: Rate by cross-validation divided by the rate that the tails predict, as computed by `rate_excess`.

    Returns:
        The thresholds, whose rates are those on other motion, and the tail of each joint's residual; `None` for a
        joint if the motion is too short.
    """
    found, tails = find_thresholds(unseen, friction, per_hour / excess)
    return replace(found, rate=per_hour, smallest=found.smallest * excess), tails


def rate_excess(
    unseen: Sequence[Observed], friction: Array, per_hour: float, *, progress: Progress = no_progress
) -> float:
    """Rate of false alarms by cross-validation divided by the rate for which thresholds are made, at least 1.

    Args:
        unseen: Residuals of unseen motion without contact.
        friction: Dry friction of each joint, shape (n,) [N·m or N].
        per_hour: False alarms per hour for which the thresholds are made.
        progress: Callback that is called after each fold.
    """
    hours = usable_seconds(unseen) / 3600.0
    rate = max(per_hour, EXPECTED / hours)
    pieces = -(-FOLDS // len(unseen))
    alarms = 0
    for fold in range(FOLDS):
        inside = [_in_fold(each, k * pieces, pieces, fold) for k, each in enumerate(unseen)]
        rest = [_only(each, ~rows) for each, rows in zip(unseen, inside, strict=True)]
        thresholds, _ = find_thresholds(rest, friction, rate)
        alarms += sum(
            count_alarms(thresholds, _only(each, rows))
            for each, rows in zip(unseen, inside, strict=True)
            if rows.any()
        )
        progress("Cross-validate the rate of false alarms", (fold + 1) / FOLDS)
    return max(alarms / (rate * hours), 1.0)


def count_alarms(thresholds: Thresholds, observed: Observed) -> int:
    """Number of alarms that thresholds give along a contiguous part of a recording."""
    over = (np.abs(observed.external) > thresholds.along(observed)) & observed.usable
    return len(alarm_rows(over, observed.rate))


def _in_fold(observed: Observed, first: int, pieces: int, fold: int) -> NDArray[np.bool_]:
    """Mask (N,) of the samples of a contiguous part that belong to a fold.

    Args:
        observed: The part with N samples.
        first: Number of the first piece of this part.
        pieces: Number of consecutive pieces into which the part is divided.
        fold: Index of the fold; piece k belongs to fold k modulo `FOLDS`.
    """
    number = first + np.arange(len(observed.time)) * pieces // len(observed.time)
    return number % FOLDS == fold


def _only(observed: Observed, rows: NDArray[np.bool_]) -> Observed:
    return replace(observed, usable=observed.usable & rows[:, None])
