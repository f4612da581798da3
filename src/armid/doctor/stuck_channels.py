"""Detection of channels that are stuck at one value while the arm moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.median import median
from armid.measurement.recording import Recording

STUCK_SECONDS, STUCK_SAMPLES = 0.2, 20
"""Shortest time at one value while the arm moves from which a channel counts as stuck, in seconds and samples."""

USUAL = 6.0
"""Smallest ratio of the longest time at one value to the second longest for which a channel counts as stuck.
Coarse converters repeat values at every reversal."""

SWING = 0.1
"""Share of its whole range by which at least one joint must move while a channel is stuck."""

JUMP = 5.0
"""Smallest jump of a position after a stuck segment, as a multiple of the usual step of the position."""


def stuck_segments(recording: Recording, rate: float) -> tuple[tuple[int, str, int, int], ...]:
    """Finds segments in which a channel is stuck: joint, quantity (`q` or `effort`), first and last row of each.

    Args:
        recording: Recording in the robot's convention, with consecutive rows.
        rate: Sample rate [Hz].
    """
    stuck: list[tuple[int, str, int, int]] = []
    effort = recording.effort
    for j in range(recording.n):
        for quantity, values in (("q", recording.q[:, j]), ("effort", None if effort is None else effort[:, j])):
            rows = None if values is None else _stuck(values, recording.valid[:, j], rate, recording.q)
            if values is None or rows is None:
                continue
            a, b = rows
            if quantity == "effort" and _at_extreme(values, a):
                continue
            if quantity == "q" and not _breaks(values, a, b):
                continue
            stuck.append((j, quantity, a, b))
    return tuple(stuck)


def without_stuck(recording: Recording, segments: tuple[tuple[int, str, int, int], ...]) -> Recording:
    """The recording with the rows of stuck segments marked as invalid."""
    valid = recording.valid.copy()
    for _, _, a, b in segments:
        valid[a : b + 1] = False
    return replace(recording, valid=valid) if segments else recording


def _stuck(values: Array, valid: NDArray[np.bool_], rate: float, q: Array) -> tuple[int, int] | None:
    """First and last row of a segment in which a channel is stuck at one value; `None` if there is no such segment.

    The segment must be far longer than every other segment at one value. Segments in which the arm rests do not
    count.

    Args:
        values: Values of the channel, shape (N,).
        valid: Mask of the rows that are used, shape (N,).
        rate: Sample rate [Hz].
        q: Positions of all joints, shape (N, n).
    """
    if np.ptp(values) == 0.0:
        return None
    same = (values[1:] == values[:-1]) & valid[1:] & valid[:-1]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    segments = edges.reshape(-1, 2)
    lengths = segments[:, 1] - segments[:, 0]
    longest: tuple[int, int] | None = None
    for k in np.argsort(-lengths):
        a, b = (int(row) for row in segments[k])
        if longest is None and b - a < max(STUCK_SAMPLES, STUCK_SECONDS * rate):
            return None
        if longest is not None and longest[1] - longest[0] >= USUAL * (b - a):
            return longest
        if (np.ptp(q[a:b], axis=0) >= SWING * np.maximum(np.ptp(q, axis=0), 1e-12)).any():
            if longest is not None:
                return None
            longest = a, b
    return longest


def _at_extreme(values: Array, row: int) -> bool:
    """True if a torque stays at its largest or smallest value, as it does in saturation."""
    return values[row] in (values.max(), values.min())


def _breaks(q: Array, a: int, b: int) -> bool:
    """True if a position jumps after a stuck segment, or moves just before or after it.

    If a joint rests, its position does neither.
    """
    step = np.abs(np.diff(q))
    usual = float(np.quantile(step[step > 0.0], 0.5)) if (step > 0.0).any() else 0.0
    if b + 1 < len(q) and step[b] > JUMP * usual:
        return True
    near = max(3, (b - a) // 20)
    before, behind = step[max(0, a - near) : a], step[b + 1 : b + 1 + near]
    moving = [float(median(x)) for x in (before, behind) if len(x)]
    return bool(moving) and max(moving) > 0.3 * usual
