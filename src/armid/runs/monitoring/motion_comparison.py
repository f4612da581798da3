"""Comparison of a monitored motion with the unseen motion from which the thresholds were computed.

A rate of false alarms is promised for motion like the unseen motion. Most false alarms occur at reversals, where the
error of the friction model is largest, and their size grows with the speed. Both motions are divided into pieces, and
the means over the pieces are compared, so that a short recording is not reported because its motion differs from the
mean by chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding
from armid.runs.monitoring.observer import Observed
from armid.runs.monitoring.thresholds import REST_SPEED

PIECE = 8.0
"""Longest duration of a piece of a motion [s]."""

UNLIKE = 1.5
"""Smallest ratio to the unseen motion of the speed, the torque change or the reversals of a joint that is reported.
On a simulated arm, motion with twice the reversals had 2.0 times the promised false alarms, motion with 1.6 times the
speed 1.3 times, and motion with twice the speed and 1.5 times the reversals 4.3 times."""

BY_CHANCE, BY_FEW = 4.0, 4.0
"""Smallest difference of the means that is reported, in standard errors, with many pieces of the unseen motion, and
its relative increase times the degrees of freedom with few. Three quantities of each joint are compared, and the
pieces of one motion resemble each other."""

FEWEST = 4
"""Smallest number of pieces of the unseen motion for a comparison: fewer do not show how far pieces differ."""

SMALLEST_CHANGE = 1e-3
"""Bound to which a smaller torque change of a joint in the unseen motion is raised, relative to the largest one."""

QUANTITIES = ("speed", "torque change", "reversals per second")
"""Names of the quantities that are compared."""


@dataclass(frozen=True, eq=False, slots=True)
class MotionLevel:
    """Speed, torque change and reversals of the joints in a motion.

    Attributes:
        mean: RMS speed [rad/s or m/s], RMS change of the model's torque within about 0.1 s [N·m or N], and reversals
            per second, means over the pieces of the motion, shape (3, n).
        deviation: Standard deviations between the pieces, shape (3, n); 0 for a single piece.
        pieces: Number of pieces.
    """

    mean: Array
    deviation: Array
    pieces: int


def motion_level(parts: Sequence[Observed]) -> MotionLevel:
    """Computes speed, torque change and reversals of the joints in the usable samples.

    Args:
        parts: External torque along parts of recordings, with usable samples.
    """
    found: list[Array] = []
    for part in parts:
        size = max(2, round(PIECE * part.rate))
        for first in range(0, len(part.time), size):
            rows = slice(first, first + size)
            usable = part.usable[rows]
            if usable.any(axis=0).all() and usable.sum() > 0.5 * size * usable.shape[1]:
                found.append(_level_of_piece(part, rows))
    if not found:  # every part is shorter than a piece
        part = max(parts, key=lambda each: int(each.usable.sum()))
        found.append(_level_of_piece(part, slice(None)))
    deviation = np.std(found, axis=0, ddof=1) if len(found) > 1 else np.zeros_like(found[0])
    return MotionLevel(np.mean(found, axis=0), deviation, len(found))


def _level_of_piece(part: Observed, rows: slice) -> Array:
    """The quantities of `MotionLevel.mean` in some rows of a part, shape (3, n); 0 for a joint that is not usable."""
    usable = part.usable[rows]
    count = np.maximum(usable.sum(axis=0), 1)
    squares = [np.sum(np.where(usable, values[rows], 0.0) ** 2, axis=0) / count for values in (part.dq, part.change)]
    reversals = [reversal_count(dq[own]) for dq, own in zip(part.dq[rows].T, usable.T, strict=True)]
    return np.array([*np.sqrt(squares), np.array(reversals) * part.rate / count])


def reversal_count(dq: Array) -> int:
    """Number of reversals of a joint; speeds below `REST_SPEED` do not count.

    Args:
        dq: Velocities of consecutive samples, shape (N,) [rad/s or m/s].
    """
    return int(np.count_nonzero(np.diff(np.sign(dq[np.abs(dq) > REST_SPEED]))))


def unlike_unseen_motion(
    unseen: MotionLevel, level: MotionLevel, joints: Sequence[str], where: str
) -> tuple[Finding, ...]:
    """Finding that a motion is faster or reverses more often than the unseen motion.

    The result is empty if it does not, or if the unseen motion is too short for a comparison.

    Args:
        unseen: Level of the unseen motion.
        level: Level of the monitored motion.
        joints: Names of the joints.
        where: Name of the recording.
    """
    if unseen.pieces < FEWEST:
        return ()
    error = (
        (1.0 + BY_FEW / (unseen.pieces - 1)) * unseen.deviation * np.sqrt(1.0 / unseen.pieces + 1.0 / level.pieces)
    )
    clear = level.mean - unseen.mean > BY_CHANCE * error
    torque = max(SMALLEST_CHANGE * float(unseen.mean[1].max()), np.finfo(float).tiny)
    smallest = np.array([[REST_SPEED], [torque], [1.0 / (PIECE * unseen.pieces)]])
    ratio = np.where(clear, level.mean / np.maximum(unseen.mean, smallest), 0.0)
    listed = [
        f"{name} {own.max():.3g} times as high ({joints[int(np.argmax(own))]})"
        for name, own in zip(QUANTITIES, ratio, strict=True)
        if own.max() > UNLIKE
    ]
    if not listed:
        return ()
    return (
        Finding(
            "unlike-unseen-motion",
            "warning",
            "",
            f"{where}: the motion differs from the unseen motion from which the thresholds were computed: "
            f"{', '.join(listed)}. More false alarms than promised must be expected.",
            "record motion of this kind without contact, and give it with --reference.",
        ),
    )
