"""Explanation of a misfit by a base that sways: on a vehicle, a gantry, a soft floor or beside a shaking machine.

A base that accelerates adds the acceleration to gravity, in the frame of the base. If it sways with one frequency,
gravity has a sine and a cosine along each axis, which all joints feel according to the weight that they carry.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.doctor.changes.alternatives import weights_by_axis
from armid.doctor.check_input import Explanation
from armid.doctor.fitted_log import LogState
from armid.doctor.remedy_trial import HELPS, RemedyTrial, heldout_error
from armid.doctor.residuals.added_columns import AddedColumns

LOWEST, PERIODS = 0.2, 4.0
"""Lowest frequency [Hz], and smallest number of periods in the log: fewer look like the motion and like drift."""

HIGHEST = 0.8
"""Highest frequency, relative to the cut-off of the band."""

PEAKS, STEPS = 3, 9
"""Number of frequencies with the strongest residual that are fitted, and of those tried about the best one."""

GAP = 2.0
"""Step of the clock [s] from which a log is searched in parts, of which the longest counts as its length."""

PADDED = 4
"""Length of the discrete Fourier transform, relative to that of the log."""

EXPLAINED = 1.7
"""Smallest decrease of the squared residuals, in squared residuals of one joint. In recordings of eight arms, whole
and in halves, some of ten seconds, it is at most 1.2, and 0.2 in logs of the lab; a base that sways with 15 % of
gravity gives 2.6 to 4.1."""

JOINTS = 3
"""Smallest number of joints: a base moves all of them, and fewer cannot give `EXPLAINED`."""

AMPLITUDE, SEVERE = 0.04, 0.08
"""Smallest amplitude that is reported, and that from which the finding is an error, relative to gravity. A clock
whose rate swings looks like an amplitude of 0.03."""

NO_GRAVITY = 1e-3
"""Strength of gravity below which the model has none [m/s²]."""


@dataclass(frozen=True, slots=True, eq=False)
class Sway:
    """Base that sways.

    Attributes:
        frequency: Frequency [Hz].
        decrease: Decrease of the squared residuals, in squared residuals of one joint.
        amplitude: Amplitude along each axis of the base, shape (3,) [m/s²].
        torque: Torque that the sway causes, shape (M, n) [N·m or N].
    """

    frequency: float
    decrease: float
    amplitude: Array
    torque: Array


def explain(code: str, state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a base that sways; `None` if it does not.

    Args:
        code: Code of the finding.
        state: The log.
    """
    strength = float(np.linalg.norm(state.model.robot.gravity))
    whole = max(float(np.ptp(part)) for part in _parts(state.rows.motion.time))
    if state.rows.n < JOINTS or state.log.band.is_open or strength < NO_GRAVITY or whole <= 0.0:
        return None
    sway = _strongest(state, whole)
    if sway is None or sway.decrease < EXPLAINED:
        return None
    after = state.without_torque(sway.torque)
    gain = state.fit.cost - after.fit.cost
    size = float(np.linalg.norm(sway.amplitude))
    if gain <= 0.0 or size < AMPLITUDE * strength:
        return None
    listed = ", ".join(f"{each:.2f}" for each in sway.amplitude)
    return Explanation(
        code,
        gain,
        "error" if size > SEVERE * strength else "warning",
        "",
        f"Gravity in the frame of the base swings at {sway.frequency:.2f} Hz, with an amplitude of ({listed}) m/s² "
        "along x, y, z: the base sways or shakes, or its ground does. Without this, the residual of one model for "
        f"all joints is {1 - np.exp(-gain):.0%} smaller.",
        lambda evidence: "fix the base to firm ground and record again",
        after,
        worse=HELPS,
        trial=RemedyTrial(heldout_error(state.rows), heldout_error(after.rows)),
    )


def _strongest(state: LogState, whole: float) -> Sway | None:
    """Sway that explains most of the residual; `None` if the log is too short or too slow for one."""
    weights = weights_by_axis(state)
    added = AddedColumns(state)
    tried = _peaks(state, weights, whole)
    fitted = [_fitted(state, added, weights, frequency) for frequency in tried]
    best = max(fitted, key=lambda each: each.decrease, default=None)
    if best is None or best.decrease < EXPLAINED / 2.0:
        return best
    near = best.frequency + np.linspace(-0.5, 0.5, STEPS) / whole
    return max((_fitted(state, added, weights, float(each)) for each in near), key=lambda each: each.decrease)


def _peaks(state: LogState, weights: Array, whole: float) -> list[float]:
    """Frequencies at which the residual follows the weights most [Hz], strongest first."""
    rows, fit = state.rows, state.fit
    unit = 1.0 / fit.sigma**2
    along = np.einsum("amj,mj,j->ma", weights, fit.residual, unit)
    power = np.einsum("amj,mj,j->a", weights**2, rows.mask.astype(np.float64), unit)
    length = PADDED * (round(whole * rows.rate) + 1)
    squares, first = np.zeros((length // 2 + 1, 3)), 0
    for part in _parts(rows.motion.time):
        place = np.round((part - part[0]) * rows.rate).astype(np.intp)
        even = np.zeros((int(place[-1]) + 1, 3))
        np.add.at(even, place, along[first : first + len(part)])
        squares += np.abs(np.fft.rfft(even, length, axis=0)) ** 2
        first += len(part)
    spectrum = squares @ (1.0 / np.where(power > 0.0, power, np.inf))
    frequencies = np.arange(len(spectrum)) * rows.rate / length
    spectrum[(frequencies < max(LOWEST, PERIODS / whole)) | (frequencies > HIGHEST * state.log.cutoff)] = 0.0
    peaks = np.flatnonzero((spectrum[1:-1] > spectrum[:-2]) & (spectrum[1:-1] >= spectrum[2:])) + 1
    return [float(frequencies[k]) for k in peaks[np.argsort(-spectrum[peaks])[:PEAKS]]]


def _parts(time: Array) -> list[Array]:
    """Time stamps of the parts of a log between long steps of its clock."""
    return np.split(time, np.flatnonzero(np.diff(time) > GAP) + 1)


def _fitted(state: LogState, added: AddedColumns, weights: Array, frequency: float) -> Sway:
    """Sway with one frequency that explains most of the residual."""
    phase = 2.0 * np.pi * frequency * (state.rows.motion.time - state.rows.motion.time[0])
    columns = np.concatenate([weights * np.cos(phase)[:, None], weights * np.sin(phase)[:, None]])
    decrease, values = added.decrease_of_all(columns)
    return Sway(frequency, decrease, np.hypot(values[:3], values[3:]), np.tensordot(values, columns, 1))
