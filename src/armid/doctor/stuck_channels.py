"""Stretches in which a channel sticks at one value while the arm moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.measurement.recording import Recording
from armid.values import Array

__all__ = ["longest", "stuck_stretches", "without_stuck"]

STUCK_SECONDS, STUCK_SAMPLES = 0.2, 20
"""A channel sticks when it keeps one value for so long while the arm moves."""

USUAL = 6.0
"""Times the next longest stretch that this must be: coarse converters keep a value at every reversal."""

SWING = 0.1
"""Share of its own span that a stuck torque would have had to move by while it stuck, seen from its joint's
motion."""

JUMP = 5.0
"""Usual steps that a position jumps when it comes loose."""


def stuck_stretches(recording: Recording, rate: float) -> tuple[tuple[int, str, int, int], ...]:
    """Joint, quantity (`q` or `effort`), first and last row of each.

    Args:
        recording: In the robot's terms, its rows in time.
        rate: Samples a second [Hz].
    """
    found: list[tuple[int, str, int, int]] = []
    effort = recording.effort
    for j in range(recording.n):
        for what, values in (("q", recording.q[:, j]), ("effort", None if effort is None else effort[:, j])):
            rows = None if values is None else _stuck(values, recording.valid[:, j], rate)
            if values is None or rows is None:
                continue
            a, b = rows
            moved = np.ptp(recording.q[a:b], axis=0) / np.maximum(np.ptp(recording.q, axis=0), 1e-12)
            if what == "effort" and (moved.max() < SWING or _at_extreme(values, a)):
                continue
            if what == "q" and (moved.max() < SWING or not _breaks(values, a, b)):
                continue
            found.append((j, what, a, b))
    return tuple(found)


def without_stuck(recording: Recording, stretches: tuple[tuple[int, str, int, int], ...]) -> Recording:
    """The recording with their rows not counted."""
    valid = recording.valid.copy()
    for _, _, a, b in stretches:
        valid[a : b + 1] = False
    return replace(recording, valid=valid) if stretches else recording


def longest(same: Array) -> tuple[int, int]:
    """First and last row of the longest stretch in which every row repeats the one before."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    if not len(edges):
        return 0, 0
    pairs = edges.reshape(-1, 2)
    a, b = pairs[int(np.argmax(pairs[:, 1] - pairs[:, 0]))]
    return int(a), int(b)


def _stuck(values: Array, valid: NDArray[np.bool_], rate: float) -> tuple[int, int] | None:
    """Rows of a stretch of one value that is far longer than any other, if there is one."""
    if np.ptp(values) == 0.0:
        return None
    same = (values[1:] == values[:-1]) & valid[1:] & valid[:-1]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    if not len(edges):
        return None
    pairs = edges.reshape(-1, 2)
    lengths = np.sort(pairs[:, 1] - pairs[:, 0])
    longest, next_longest = int(lengths[-1]), int(lengths[-2]) if len(lengths) > 1 else 0
    if longest < max(STUCK_SAMPLES, STUCK_SECONDS * rate) or longest < USUAL * next_longest:
        return None
    a, b = pairs[int(np.argmax(pairs[:, 1] - pairs[:, 0]))]
    return int(a), int(b)


def _at_extreme(values: Array, row: int) -> bool:
    """Tell whether a torque stays at its largest value, which is saturation."""
    return values[row] in (values.max(), values.min())


def _breaks(q: Array, a: int, b: int) -> bool:
    """Tell whether the motion stops or goes on with a jump, as no joint does."""
    step = np.abs(np.diff(q))
    usual = float(np.quantile(step[step > 0.0], 0.5)) if (step > 0.0).any() else 0.0
    if b + 1 < len(q) and step[b] > JUMP * usual:
        return True
    near = max(3, (b - a) // 20)
    before, behind = step[max(0, a - near) : a], step[b + 1 : b + 1 + near]
    moving = [float(np.median(x)) for x in (before, behind) if len(x)]
    return bool(moving) and max(moving) > 0.3 * usual
