"""Parts of a recording in which commands and measured positions follow each other without a gap."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import RecordingError
from armid.input_boundary import within
from armid.measurement.recording import Recording

GAP_STEPS = 2.5
"""Length of a time step, in median steps, above which a recording is split: the commands in between are not known."""

SHORTEST = 1.0
"""Shortest run that is used [s]. A servo forgets its unknown initial state in a few tenths of a second."""

FEWEST = 20
"""Smallest number of samples of a run, so that it can be divided."""

STEP_DIGITS = 6
"""Significant digits of the step of a grid, so that recordings of one controller have equal steps."""

VELOCITY_SAMPLES = 5
"""Smallest number of samples to which a line is fitted for the initial velocity. Two samples with an encoder of 12
bit would give errors of 0.1 rad/s."""

VELOCITY_TIME = 0.03
"""Shortest time over which this line is fitted [s]."""


@dataclass(frozen=True, eq=False, slots=True)
class ServoRun:
    """Commands and positions on a uniform grid, N samples of n joints.

    Attributes:
        step: Time from one sample of the grid to the next [s].
        start: Time of the first sample [s].
        q: Measured positions at the samples of the grid, shape (N, n) [rad or m].
        dq: Velocities at the first sample, shape (n,) [rad/s or m/s].
        command_time: Times of the commands as recorded, shape (M,) [s].
        command: Commands, each held until the next one, shape (M, n) [rad or m].
        source: Name of the recording.
    """

    step: float
    start: float
    q: Array
    dq: Array
    command_time: Array
    command: Array
    source: str = ""

    @property
    def samples(self) -> int:
        """Number of samples N of the grid."""
        return len(self.q)

    @property
    def seconds(self) -> float:
        """Length of the run [s]."""
        return self.step * (self.samples - 1)

    @property
    def time(self) -> Array:
        """Times of the samples of the grid, shape (N,) [s]."""
        return np.asarray(self.start + self.step * np.arange(self.samples), dtype=np.float64)

    def held(self, time: Array) -> Array:
        """Command at given times, shape (len(time), n) [rad or m]."""
        last = np.clip(np.searchsorted(self.command_time, time, side="right") - 1, 0, len(self.command) - 1)
        return self.command[last]

    def part(self, begin: int, end: int) -> ServoRun:
        """Run of the samples begin … end - 1 of the grid."""
        q = self.q[begin:end]
        return replace(self, start=self.start + begin * self.step, q=q, dq=_first_velocity(q, self.step))


def _first_velocity(q: Array, step: float) -> Array:
    """Slope of the first samples, shape (n,)."""
    first = q[: max(VELOCITY_SAMPLES, round(VELOCITY_TIME / step))]
    t = step * (np.arange(len(first)) - 0.5 * (len(first) - 1))
    return np.asarray(t @ first / max(float(t @ t), 1e-300), dtype=np.float64)


def servo_runs(recording: Recording) -> tuple[ServoRun, ...]:
    """Runs of a recording in the robot's convention, on a grid with the median step of its clock.

    Measured positions are interpolated linearly where time stamps are not on the grid; commands keep their own times.

    Raises:
        RecordingError: The recording has no command or no clock, or no part of it is long enough.
    """
    if recording.command is None:
        raise RecordingError(
            f"{recording.source or 'The recording'} has no commanded positions.",
            remedy="name the columns of the command, for instance --columns 'command=cmd{}'; without a "
            "command, a servo cannot be identified.",
            source=recording.source,
        )
    time = _clock(recording)
    finite = np.isfinite(recording.q) & np.isfinite(recording.command)
    use = np.asarray((recording.valid & finite).all(axis=1), dtype=np.bool_)
    found: list[ServoRun] = []
    for rows in _consecutive(time, use):
        t = time[rows]
        if len(t) < FEWEST or t[-1] - t[0] < SHORTEST:
            continue
        step = float(f"{float(np.median(np.diff(t))):.{STEP_DIGITS}g}")
        samples = int((t[-1] - t[0]) / step * (1.0 + 1e-9)) + 1
        where = f"the uniform grid of {recording.source or 'a recording'}"
        within("resampled", samples / len(t), where, RecordingError)
        grid = t[0] + step * np.arange(samples)
        q = np.column_stack([np.interp(grid, t, x) for x in recording.q[rows].T])
        command = array(recording.command[rows], (len(t), recording.n), "command")
        found.append(ServoRun(step, float(t[0]), q, _first_velocity(q, step), t, command, recording.source))
    if not found:
        raise RecordingError(
            f"{recording.source or 'The recording'} has no part of {SHORTEST:g} s without a gap in which position "
            "and command are known.",
            remedy="give a longer recording, or check its clock with `armid doctor`.",
            source=recording.source,
        )
    return tuple(found)


def _clock(recording: Recording) -> Array:
    """Times of the samples, from the clock or the rate of the log format, shape (N,) [s]."""
    if recording.time is not None:
        return recording.time
    if recording.rate is None:
        raise RecordingError(
            f"{recording.source or 'The recording'} has no clock.",
            remedy="give its sample rate, for instance --rate 50.",
            source=recording.source,
        )
    return np.arange(recording.samples) / recording.rate


def _consecutive(time: Array, use: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Numbers of consecutive used rows without a gap or a step back in time; of equal times, the last row counts."""
    rows = np.flatnonzero(use & np.append(np.diff(time) != 0.0, True))
    steps = np.diff(time[rows])
    typical = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    borders = np.flatnonzero((steps <= 0.0) | (steps > GAP_STEPS * typical))
    return np.split(rows, borders + 1)
