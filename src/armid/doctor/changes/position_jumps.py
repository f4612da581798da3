"""Jumps of a position from one row to the next that stay: a slip or a stuck bit of an encoder, a zero set anew.

A joint moves by nearly the same angle from row to row. A step that differs from its neighbours by many times the
usual difference, and that no step back follows, is no motion of the arm. A joint may jump several times: the
differences of its steps then fall by a large factor from those of the jumps to the largest other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.doctor.changes.signal_steps import NEAR, largest_apart, regular_steps, step_excess
from armid.measurement.recording import Recording

CERTAIN = 6.0
"""Smallest ratio of a jump to the largest difference between a step and its neighbours elsewhere. In the recordings
of eight arms it is up to 5.1, where the differences are above `SMALLEST`."""

SMALLEST = 5e-3
"""Smallest jump that is reported [rad or m]; it biases a weight by half a percent."""

NOTICED = 5.0
"""Smallest displacement of another joint, in its usual differences, by which lost rows would be noticed."""

MOST = 0.05
"""Largest number of jumps of a joint, as a share of the rows. A stuck bit of a tenth of a radian jumps in 2 to 5 % of
the rows of a fast motion; where rows were lost, other joints jump, too."""

ALONE = 0.9
"""Smallest share of several jumps of a joint at which no other joint jumps."""

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
    """Finds the joints whose position jumps, once or several times, and stays.

    Rows that were lost without a gap in the time make all joints jump. Jumps are therefore reported only if other
    joints move at that time, and do not jump.
    """
    q = recording.q
    if recording.consecutive is False or len(q) < FEWEST or q.shape[1] < 2:
        return []
    steps, excess = np.diff(q, axis=0), step_excess(q)
    excess[~regular_steps(recording)] = 0.0
    found: list[Jump] = []
    for j in range(q.shape[1]):
        jumps = _jumps(excess[:, j], j)
        if jumps and np.mean([_alone(each, steps, excess) for each in jumps]) >= ALONE:
            found += jumps
    return found


def without_jumps(recording: Recording, jumps: Sequence[Jump]) -> Recording:
    """The recording with the positions after each jump moved back by the jump."""
    if not jumps:
        return recording
    q = recording.q.copy()
    for each in jumps:
        q[each.row + 1 :, each.joint] -= each.size
    return replace(recording, q=q)


def _jumps(excess: Array, j: int) -> list[Jump]:
    """The jumps of joint j, in the order of time; empty if its differences (M,) are all of about the same size."""
    size = np.abs(excess)
    rows = largest_apart(size, int(MOST * len(size)) + 2)
    heights = np.append(size[rows], 0.0)
    smaller = heights[1:].copy()
    smaller[0] = np.delete(size, slice(max(rows[0] - NEAR, 0), rows[0] + NEAR + 1)).max(initial=0.0)
    clear = (heights[:-1] > SMALLEST) & (heights[:-1] >= CERTAIN * smaller)
    clear[1:] &= smaller[1:] > 0.0  # several equal steps of a channel that stands still in between are its resolution
    clear[max(len(rows) - 1, 1) :] = False
    count = int(np.flatnonzero(clear)[-1]) + 1 if clear.any() else 0
    return [Jump(j, int(row), float(excess[row])) for row in np.sort(rows[:count])]


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
