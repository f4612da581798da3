"""Response of measured positions to commands: correlation, lag and scale of each pair of a command and a joint."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.median import median
from armid.maths.signals.zero_phase_filters import butterworth, zero_phase
from armid.measurement.recording import Recording

CUTOFF = 4.0
"""Cut-off of the low-pass filter of commands and positions before they are compared [Hz]."""

FASTEST = 200.0
"""Largest rate of the grid on which they are compared [Hz]."""

EARLIEST, LATEST = -0.5, 1.0
"""Lags of a position behind its command that are tried [s]."""

AS_GOOD = 0.98
"""Share of the largest correlation from which a peak nearer to zero is taken: a periodic motion has several."""

MOVES = 0.03
"""Range of a signal from which a joint counts as moving [rad or m]."""

FEWEST = 50
"""Smallest number of rows that are compared."""

SHORTEST = 2.0
"""Shortest log that is compared [s]."""


@dataclass(frozen=True, eq=False)
class CommandResponse:
    """Commands and positions of n joints on one grid.

    Attributes:
        rate: Rate of the grid [Hz].
        command: Commands, shape (N, n) [rad or m].
        q: Positions, shape (N, n) [rad or m].
    """

    rate: float
    command: Array
    q: Array

    @cached_property
    def moves(self) -> NDArray[np.bool_]:
        """Mask of the joints whose command and position move, shape (n,)."""
        return (np.ptp(self.command, axis=0) > MOVES) & (np.ptp(self.q, axis=0) > MOVES)

    @cached_property
    def _speeds(self) -> tuple[Array, Array]:
        """Speeds of commands and positions within the band, shape (N, n) each."""
        sections = butterworth(2, min(CUTOFF, 0.2 * self.rate), self.rate)
        both = (zero_phase(sections, x) for x in (self.command, self.q))
        command, q = (np.gradient(x, 1.0 / self.rate, axis=0) for x in both)
        return command, q

    def correlation(self, i: int, j: int, rows: slice = slice(None)) -> tuple[float, float]:
        """Correlation of the speed of command i and that of joint j at the best lag, and this lag [s].

        A negative correlation is that of a motion in the opposite direction.
        """
        a, b = self._speeds[0][rows, i], self._speeds[1][rows, j]
        size = float(np.linalg.norm(a) * np.linalg.norm(b))
        if not size > 0.0:
            return 0.0, 0.0
        length = 2 * len(a)
        spectrum = np.conj(np.fft.rfft(a, length)) * np.fft.rfft(b, length)
        every = np.fft.irfft(spectrum, length) / size
        first, last = (round(each * self.rate) for each in (EARLIEST, LATEST))
        first, last = max(first, 1 - len(a)), min(last, len(a) - 1)
        lags = np.arange(first, last + 1)
        values = every[lags]
        strength = np.abs(values)
        inner = strength[1:-1]
        peaks = 1 + np.flatnonzero((inner >= strength[:-2]) & (inner >= strength[2:]))
        good = peaks[strength[peaks] >= AS_GOOD * strength.max()]
        k = int(good[np.argmin(np.abs(lags[good]))]) if len(good) else int(np.argmax(strength))
        shift = 0.0
        if 0 < k < len(strength) - 1:
            before, here, after = strength[k - 1 : k + 2]
            bend = before - 2.0 * here + after
            shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
        return float(values[k]), float((lags[k] + shift) / self.rate)

    @cached_property
    def table(self) -> Array:
        """Correlation of each command with each joint at its best lag, shape (n, n)."""
        n = self.q.shape[1]
        return np.array([[self.correlation(i, j)[0] for j in range(n)] for i in range(n)])

    @cached_property
    def lags(self) -> Array:
        """Lag of each joint behind its command, shape (n,) [s]."""
        return np.array([self.correlation(j, j)[1] for j in range(self.q.shape[1])])

    def aligned(self, i: int, j: int) -> tuple[Array, Array]:
        """Command i and position j, shifted by their lag."""
        shift = round(self.correlation(i, j)[1] * self.rate)
        end = len(self.q) - abs(shift)
        if shift >= 0:
            return self.command[:end, i], self.q[shift:, j]
        return self.command[-shift:, i], self.q[:end, j]

    def slope(self, j: int) -> float:
        """Change of the position over that of the command, once the lag is taken out."""
        a, b = self.aligned(j, j)
        a, b = a - a.mean(), b - b.mean()
        return float(a @ b) / max(float(a @ a), 1e-300)


def command_response(recording: Recording, rate: float) -> CommandResponse | None:
    """Commands and positions on a uniform grid; `None` without commands, or if the log is too short."""
    if recording.command is None or recording.consecutive is False:
        return None
    rows = (recording.valid & np.isfinite(recording.q) & np.isfinite(recording.command)).all(axis=1)
    time = np.arange(recording.samples) / rate if recording.time is None else recording.time
    rows &= np.isfinite(time)
    rows[1:] &= np.diff(time) > 0.0
    t = time[rows]
    if len(t) < FEWEST or not t[-1] - t[0] > SHORTEST or not (np.diff(t) > 0.0).all():
        return None
    step = max(float(median(np.diff(t))), 1.0 / FASTEST)
    grid = np.arange(t[0], t[-1], step)
    if len(grid) < FEWEST or len(grid) > 20 * len(t):
        return None
    q, command = (
        np.column_stack([np.interp(grid, t, x) for x in values[rows].T])
        for values in (recording.q, recording.command)
    )
    return CommandResponse(1.0 / step, command, q)
