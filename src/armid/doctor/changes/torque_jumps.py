"""Jumps of a torque from one row to the next that stay: a zero set anew, a gain that switches, a sudden load.

Torque of a joint that moves on without a reversal changes little from row to row, apart from noise. A step that
differs from its neighbours by much more than all others, and after which the level stays, is no torque of a smooth
motion. It is found in the torque as it was logged: a filter would hide it, and a fit spreads it over the parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.changes.signal_steps import NEAR, largest_apart, regular_steps, step_excess
from armid.maths.median import median
from armid.measurement.recording import Recording

ONE, SEVERAL = 6.0, 2.3
"""Smallest ratio of a jump to the largest other step, for one jump and for the smallest of several. In the recordings
of eight arms, whole and in halves, it is up to 2.48 for one jump and 1.46 for several, where the joint moves on."""

SMALLEST, SMALLEST_COMMON = 0.1, 0.05
"""Smallest jump of one torque, and of torques that jump together, relative to the torque's standard deviation."""

STAYS = 0.6
"""Smallest share of a jump by which the level of the torque has changed `NEAR` rows later. A spike returns."""

MOST = 12
"""Largest number of jumps of a joint; more are a torque that is logged in coarse steps."""

MOVING = 0.1
"""Smallest speed at a jump, relative to its root mean square: static friction changes at rest and at reversals."""

AROUND = 0.1
"""Time before and after a jump in which a joint must move on [s]: a torque or a position may be late by as much, so
that the step of the friction at a reversal is found that far from it."""

FEWEST = 200
"""Smallest number of rows of a log that is examined."""

TOGETHER, JOINTS = 0.5, 4
"""Share of the torques that must step at the same row, and smallest number of joints."""

USUAL = 0.9
"""Quantile of the steps of a torque with which steps at the same row are compared."""

SMOOTH, STEEP = 0.03, 4.0
"""Time over which accelerations before and after a step are compared [s], and ratio of the squared change of all
joints together to that four such times aside, from which accelerations step: then the torques may step, too."""

COMMON = ((3, 3.5), (6, 2.9))
"""Number of common jumps, and smallest ratio of each to the usual steps. In recordings of eight arms, whole and in
halves, the third one is at most 2.4 and the sixth at most 2.0. Swapped packets give 3.7 and 3.0 on an arm with noisy
currents, 5.9 and 2.8 at 1 kHz, and hundreds on others."""


@dataclass(frozen=True, slots=True)
class TorqueJump:
    """Jumps of the torque of a joint.

    Attributes:
        joint: Index of the joint.
        rows: Last row before each jump, in the order of time.
        sizes: Jumps [N·m or N].
    """

    joint: int
    rows: tuple[int, ...]
    sizes: tuple[float, ...]


def torque_jumps(recording: Recording) -> list[TorqueJump]:
    """Finds the joints whose torque jumps, once or several times, and stays, while the joint moves on."""
    torque = recording.effort
    if torque is None or recording.consecutive is False or len(torque) < FEWEST:
        return []
    excess = step_excess(torque)
    excess[~regular_steps(recording)] = 0.0
    moving = moving_on(recording)
    each = (_jumps_of(torque[:, j], np.where(moving[:, j], excess[:, j], 0.0), j) for j in range(torque.shape[1]))
    return [found for found in each if found is not None]


def common_jumps(recording: Recording) -> NDArray[np.intp]:
    """Last row before each step that most torques take together while the motion is smooth; none if they are few.

    Joints that move on take no such steps: friction reverses on one joint after the other, a load is picked up once,
    and where all joints start, stop or change their accelerations together, the positions show it.
    """
    torque = recording.effort
    if torque is None or recording.consecutive is False or len(torque) < FEWEST or recording.n < JOINTS:
        return np.zeros(0, dtype=np.intp)
    size = np.abs(step_excess(torque))
    size[~regular_steps(recording) | _accelerations_step(recording)] = 0.0
    usual = np.quantile(size, USUAL, axis=0)
    large = moving_on(recording) & (size > SMALLEST_COMMON * np.std(torque, axis=0))
    relative = np.where(large, size / np.where(usual > 0.0, usual, np.inf), 0.0)
    common = np.sort(relative, axis=1)[:, -int(np.ceil(TOGETHER * recording.n))]
    rows = largest_apart(common, max(count for count, _ in COMMON))
    if not any(len(rows) >= count and common[rows[count - 1]] > ratio for count, ratio in COMMON):
        return np.zeros(0, dtype=np.intp)
    return np.sort(rows[common[rows] > min(ratio for _, ratio in COMMON)])


def _accelerations_step(recording: Recording) -> NDArray[np.bool_]:
    """Mask of the steps of a recording at which the accelerations of the joints step together, shape (N - 1,)."""
    q, reach = recording.q, max(2, round(SMOOTH * _rate(recording)))
    second = q[2 * reach :] - 2.0 * q[reach:-reach] + q[: -2 * reach]
    change = second[2 * reach :] - second[: -2 * reach]
    power = np.zeros(len(q) - 1)
    if len(change):
        size = np.mean(change**2, axis=0)
        relative = np.mean(change**2 / np.where(size > 0.0, size, np.inf), axis=1)
        power[2 * reach : 2 * reach + len(relative)] = relative[: len(power) - 2 * reach]
    aside = 0.5 * (np.roll(power, 4 * reach) + np.roll(power, -4 * reach))
    step = (power > STEEP * aside) & (power > 1.0)
    return np.any([np.roll(step, shift) for shift in range(-NEAR, NEAR + 1)], axis=0)


def _rate(recording: Recording) -> float:
    """Rows in a second; 0 if unknown."""
    return (recording.rate or 0.0) if recording.time is None else 1.0 / float(median(np.diff(recording.time)))


def moving_on(recording: Recording, around: float = AROUND) -> NDArray[np.bool_]:
    """Mask of the steps around which a joint neither rests nor reverses, shape (N - 1, n).

    Args:
        recording: Recording.
        around: Time before and after a step in which the joint moves on [s].
    """
    steps = np.diff(recording.q, axis=0)
    speed = np.sqrt(np.mean(steps**2, axis=0))
    rows = len(steps)
    far = max(NEAR, round(around * _rate(recording)))
    moving = np.ones_like(steps, dtype=np.bool_)
    for shift in (-far, -far // 2, -NEAR, NEAR, far // 2, far):
        other = steps[np.clip(np.arange(rows) + shift, 0, rows - 1)]
        moving &= (np.abs(other) > MOVING * speed) & (other * steps > 0.0)
    return moving


def _jumps_of(torque: Array, excess: Array, j: int) -> TorqueJump | None:
    """Jumps of the torque (N,) of joint j with the given excess of its steps (N - 1,); `None` if there are none."""
    size = np.abs(excess)
    rows = largest_apart(size, MOST + 1)
    heights = size[rows]
    stay = np.array([_level_change(torque, excess, int(row)) > STAYS for row in rows])
    first_spike = int(np.argmin(stay)) if not stay.all() else len(stay)
    best = 0
    for count in range(1, min(first_spike, len(rows) - 1) + 1):
        smallest, other = heights[count - 1], heights[count]
        if other > 0.0 and smallest > (ONE if count == 1 else SEVERAL) * other:
            best = count
    if not best or heights[best - 1] < SMALLEST * float(np.std(torque)):
        return None
    chosen = np.sort(rows[:best])
    return TorqueJump(j, tuple(map(int, chosen)), tuple(float(excess[row]) for row in chosen))


def _level_change(torque: Array, excess: Array, row: int) -> float:
    """Change of the level of a torque across a jump, without its usual steps, relative to the jump."""
    if excess[row] == 0.0:
        return 0.0
    before, after = torque[max(row - NEAR + 1, 0) : row + 1], torque[row + 1 : row + 1 + NEAR]
    steps = np.diff(torque[max(row - NEAR - 2, 0) : row + NEAR + 4])
    usual = float(np.median(steps)) * NEAR
    return float((np.median(after) - np.median(before) - usual) / excess[row])
