"""Compensation of a delay of the torque relative to the positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import RecordingError
from armid.maths.median import median
from armid.maths.signals.resampling import resample
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording

BRIDGED = 0.02
"""Longest time step over which torque is interpolated [s]: a tenth of a period at 5 Hz. If `USUAL` median steps are
longer than this, they are the limit."""

USUAL = 2.5
"""Longest time step, in median steps, over which torque is always interpolated: it allows for one lost sample and
some jitter."""

FEWEST = 4
"""Smallest number of samples for a cubic spline; rows in shorter segments between gaps are masked."""


def compensate_delay(recording: Recording, log_format: LogFormat) -> Recording:
    """Shifts the torque of a recording back by its delay.

    Between samples the torque is interpolated by a cubic spline. A row is masked for a joint if its torque would lie
    before the first sample, after the last sample or in a gap. If the motion repeats, the torque at the ends is taken
    from one period earlier or later.

    Args:
        recording: Recording in robot order, on the joint side.
        log_format: Log format that gives the delay, and the period if the motion repeats.

    Raises:
        RecordingError: The rows are not consecutive in time.
    """
    delay = np.broadcast_to(np.asarray(log_format.delay, dtype=np.float64), (recording.n,))
    if not delay.any() or recording.effort is None:
        return recording
    if recording.consecutive is False:
        raise RecordingError(
            "the key `delay` is given, but the rows are not consecutive in time, so a delay cannot be corrected.",
            remedy="leave `delay` out.",
            source=recording.source,
        )
    time = np.arange(recording.samples) / (recording.rate or 1.0) if recording.time is None else recording.time
    effort, valid = recording.effort.copy(), recording.valid.copy()
    for seconds in np.unique(delay[delay != 0.0]):
        late = delay == seconds
        effort[:, late], valid[:, late] = _read_at(
            time, time + seconds, effort[:, late], valid[:, late], log_format.stated_period
        )
    return replace(recording, effort=effort, valid=valid)


def _read_at(
    time: Array, wanted: Array, effort: Array, valid: NDArray[np.bool_], period: float | None
) -> tuple[Array, NDArray[np.bool_]]:
    """Torque (N, k) interpolated at the wanted times (N,), and mask (N, k) of the values that are valid there."""
    if period is not None and time[-1] - time[0] > period:
        wanted = np.where(wanted > time[-1], wanted - period, np.where(wanted < time[0], wanted + period, wanted))
    before = np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, len(time) - 1)
    behind = np.minimum(before + 1, len(time) - 1)
    exact = wanted == time[before]
    nearest = np.where(wanted - time[before] <= time[behind] - wanted, before, behind)
    read, there = effort[nearest], np.zeros(len(time), dtype=np.bool_)
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > max(BRIDGED, USUAL * float(median(steps)))) + 1
    for rows in np.split(np.arange(len(time)), gaps):
        inside = (wanted >= time[rows[0]]) & (wanted <= time[rows[-1]])
        if len(rows) >= FEWEST and inside.any():
            read[inside] = resample(time[rows], effort[rows], wanted[inside])
            there |= inside
    sources = valid[before] & (valid[behind] | exact[:, None])
    return read, valid & sources & there[:, None]
