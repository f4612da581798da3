"""Jumps of a position from one row to the next that stay: an encoder that slips, or a zero that is set anew.

A joint moves by nearly the same angle from row to row. A step that differs from its neighbours by many times the
usual difference, and that no step back follows, is no motion of the arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.median import median
from armid.measurement.recording import Recording

CERTAIN = 6.0
"""Smallest ratio of a jump to the largest difference between a step and its neighbours elsewhere. In the recordings
of eight arms it is up to 5.1, where the differences are above `SMALLEST`."""

SMALLEST = 5e-3
"""Smallest jump that is reported [rad or m]; it biases a weight by half a percent."""

NEAR = 4
"""Number of rows on either side of a jump that are not compared with it, because it changes their neighbours."""

EVEN = 1.5
"""Largest time between two rows, in usual steps, across which positions are compared."""

NOTICED = 5.0
"""Smallest displacement of another joint, in its usual differences, by which lost rows would be noticed."""

FEWEST = 50
"""Smallest number of rows of a log that is examined."""


@dataclass(frozen=True, slots=True)
class Jump:
    """Jump of the position of a joint.

    Attributes:
        joint: Index of the joint.
        row: Last row before the jump.
        size: Jump [rad or m].
    """

    joint: int
    row: int
    size: float


def position_jumps(recording: Recording) -> list[Jump]:
    """Finds the joints whose position jumps once and stays.

    Rows that were lost without a gap in the time make all joints jump. A jump is therefore reported only if other
    joints move at that time, and do not jump.
    """
    q = recording.q
    if recording.consecutive is False or len(q) < FEWEST or q.shape[1] < 2:
        return []
    steps = np.diff(q, axis=0)
    usual = np.stack([steps[:-4], steps[1:-3], steps[3:-1], steps[4:]])
    excess = np.zeros_like(steps)
    excess[2:-2] = steps[2:-2] - np.median(usual, axis=0)
    excess[~_regular(recording)] = 0.0
    found = [_jump(excess, j) for j in range(q.shape[1])]
    return [each for each in found if each is not None and _alone(each, steps, excess)]


def without_jumps(recording: Recording, jumps: Sequence[Jump]) -> Recording:
    """The recording with the positions after each jump moved back by the jump."""
    if not jumps:
        return recording
    q = recording.q.copy()
    for each in jumps:
        q[each.row + 1 :, each.joint] -= each.size
    return replace(recording, q=q)


def _regular(recording: Recording) -> NDArray[np.bool_]:
    """Mask of the steps between rows that are valid and follow each other in time, shape (N - 1,)."""
    valid = np.atleast_1d(recording.valid if recording.valid.ndim == 1 else recording.valid.all(axis=1))
    used = valid[1:] & valid[:-1]
    if recording.time is None:
        return used
    step = np.diff(recording.time)
    return used & (step < EVEN * float(median(step)))


def _jump(excess: Array, j: int) -> Jump | None:
    """The jump of joint j; `None` if it has none, or several differences of about the same size."""
    size = np.abs(excess[:, j])
    row = int(np.argmax(size))
    elsewhere = np.delete(size, slice(max(row - NEAR, 0), row + NEAR + 1))
    if size[row] < max(SMALLEST, CERTAIN * float(elsewhere.max(initial=0.0))):
        return None
    return Jump(j, row, float(excess[row, j]))


def _alone(jump: Jump, steps: Array, excess: Array) -> bool:
    """True if other joints move at a jump, so that lost rows would show in them, and do not jump."""
    near = slice(max(jump.row - NEAR, 0), jump.row + NEAR + 1)
    step = np.median(steps[near], axis=0)
    rows_lost = abs(jump.size) / max(abs(float(step[jump.joint])), np.finfo(float).tiny)
    usual = np.median(np.abs(excess), axis=0) + np.finfo(float).tiny
    expected = min(rows_lost, len(steps)) * np.abs(step)
    others = np.arange(len(step)) != jump.joint
    noticed = others & (expected > NOTICED * usual)
    still = np.abs(excess[jump.row]) < 0.5 * expected
    return bool(noticed.any() and still[noticed].all())
