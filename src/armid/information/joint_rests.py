"""Rests of single joints at the full sampling rate, and the rows that they influence.

Processing leaves out standstill between motions, which it distinguishes from a smooth passage through zero speed. A
joint that creeps at 0.01 rad/s for a second while others move counts as moving there. But at such a speed friction
can be any torque up to its bound, so selection would add terms near standstill only to fit the torque in these rests.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.maths.signals.zero_phase_filters import edge_samples, low_pass
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import ObservedRun

REST = 0.5
"""Shortest rest of a joint [s]. During such a time, friction in a gear relaxes, and a controller moves the joint by
less than the resolution of its encoder. The torque at rest is then no longer the torque at the end of the last
motion."""

CREEP = 0.05
"""Ratio of a joint's speed to its RMS speed in the run, below which the joint rests. Creep of 0.01 rad/s was observed
on joints that otherwise move at 0.5 rad/s."""


def rests(run: ObservedRun) -> list[NDArray[np.intp]]:
    """First sample and end (exclusive) of each rest of each joint: n arrays of shape (rests, 2)."""
    speed = np.abs(run.motion.dq)
    slow = speed < CREEP * np.sqrt(np.mean(speed**2, axis=0))
    result: list[NDArray[np.intp]] = []
    for j in range(speed.shape[1]):
        ends = np.flatnonzero(np.diff(slow[:, j], prepend=False, append=False)).reshape(-1, 2)
        result.append(ends[ends[:, 1] - ends[:, 0] >= REST * run.rate])
    return result


def resting_rows(run: ObservedRun, band: Band) -> NDArray[np.bool_]:
    """Mask of the rows that a rest of a joint influences through the filter, shape (M, n)."""
    if not run.consecutive:
        return np.zeros(run.mask.shape, dtype=np.bool_)
    reach = filter_reach(run, band)
    resting = np.zeros((run.motion.samples, run.mask.shape[1]), dtype=np.bool_)
    for j, ends in enumerate(rests(run)):
        for begin, end in ends:
            resting[max(begin - reach, 0) : end + reach, j] = True
    return resting[run.rows]


def filter_reach(run: ObservedRun, band: Band) -> int:
    """Number of samples on each side of a wrong sample to which the filter of the columns spreads its error."""
    filter = low_pass(band.family, band.order, band.cutoff, run.rate) if band.columns else None
    return 0 if filter is None else edge_samples(filter)
