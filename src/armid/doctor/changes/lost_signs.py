"""Torques that lose their sign in some rows: they jump to the opposite value and go on there in the opposite sense.

A minus sign is lost where a number does not fit the field of a file, or where a converter takes an amount. The amount
of the torque then goes on while its sign changes from one row to the next, although the joint moves on. No load and
no friction does that several times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.changes.signal_steps import NEAR, regular_steps
from armid.doctor.changes.torque_jumps import FEWEST, moving_on
from armid.measurement.recording import Recording

LEAST = 0.25
"""Smallest amount of the torque at a change of its sign, relative to its standard deviation about zero."""

ALIKE = 0.25
"""Largest difference of the amounts before and after, relative to the step."""

STEEP, USUAL = 5.0, 0.9
"""Smallest ratio of the step to the usual steps next to it, and to this quantile of all steps, which noise has."""

AROUND = 0.25
"""Time before and after a change of the sign in which the joint must move on [s]: friction changes its sign, too."""

SEVERAL = 3
"""Smallest number of changes of the sign. In recordings of eight arms, whole and in halves, there is none."""

STEEPEST, EXACT = 6.0, 0.05
"""Smallest ratio of the step to the largest other step of the torque, and `ALIKE`, for fewer changes: a zero that is
set anew gives the opposite value by chance only."""


@dataclass(frozen=True, slots=True)
class LostSigns:
    """Changes of the sign of a torque whose amount goes on.

    Attributes:
        joint: Index of the joint.
        rows: Last row before each change.
        smallest: Smallest amount of the torque at a change [N·m or N].
    """

    joint: int
    rows: tuple[int, ...]
    smallest: float


def lost_signs(recording: Recording) -> list[LostSigns]:
    """Finds the joints whose torque changes its sign from row to row while its amount goes on."""
    torque = recording.effort
    if torque is None or recording.consecutive is False or len(torque) < FEWEST:
        return []
    used = moving_on(recording, AROUND) & regular_steps(recording)[:, None]
    found = [_changes(torque[:, j], used[:, j], j) for j in range(torque.shape[1])]
    return [each for each in found if each is not None]


def _changes(torque: Array, used: NDArray[np.bool_], j: int) -> LostSigns | None:
    """Changes of the sign of the torque (N,) of joint j; `None` if there are too few.

    Args:
        torque: Torque, shape (N,).
        used: Mask of the steps that count, shape (N - 1,).
        j: Index of the joint.
    """
    size = float(np.sqrt(np.mean(torque**2)))
    step, sums = np.abs(np.diff(torque)), np.abs(torque[1:] + torque[:-1])
    used = used & (step > STEEP * np.quantile(step, USUAL))
    hit = used & (step > 2.0 * LEAST * size) & (sums < ALIKE * step)
    rows = [int(k) for k in np.flatnonzero(hit) if NEAR <= k < len(step) - NEAR and _goes_on(torque, step, int(k))]
    if len(rows) < SEVERAL:
        others = float(np.delete(step, rows).max(initial=0.0))
        rows = [k for k in rows if step[k] > STEEPEST * others and sums[k] < EXACT * step[k]]
    if not rows:
        return None
    return LostSigns(j, tuple(rows), float(np.min(np.abs(torque[rows]))))


def _goes_on(torque: Array, step: Array, k: int) -> bool:
    """True if the torque keeps the opposite level after row k, and its other steps nearby are much smaller."""
    before, after = np.median(torque[k - NEAR + 1 : k + 1]), np.median(torque[k + 1 : k + NEAR + 1])
    beside = np.concatenate([step[k - NEAR : k], step[k + 1 : k + NEAR + 1]])
    usual = float(np.median(beside))  # zero if the torque keeps its values, as coarse ones do
    return abs(before + after) < ALIKE * step[k] and step[k] > STEEP * usual > 0.0
