"""Attenuation of the measured torque as a function of frequency, by comparison with the torque of the model.

Dry friction changes by a step at every reversal of a joint, and a step contains all frequencies. If the torque was
low-pass filtered, it lacks the high frequencies, but the columns of the model, which are computed from the motion,
still contain them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.fitted_log import LogState
from armid.information.filtered_rows import all_rows
from armid.maths.signals.fourier_transform import power_spectrum
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import ObservedRun

SEGMENT = 8.0
"""Length of a segment for the spectrum [s]. The lines of the spectrum are then 1/8 Hz apart, and the window spreads
each line over four lines."""

LONGEST = 32.0
"""Length of the part of each run that is used [s]; seven segments that overlap are enough to see a fall by half."""

LOWEST = 0.5
"""Lowest frequency at which the torque is compared [Hz]."""

HALF = 0.5
"""Ratio of amplitudes at the cut-off of a low-pass that filters forwards and backwards."""

STEEP = 0.25
"""Largest ratio of amplitudes at twice the frequency at which it is one half. It is 0.06 for a filter of second order
that filters forwards and backwards and 0.15 for one that filters once. Friction that the model lacks, or that changes
its sign smoothly, lets the ratio fall slowly."""


def half_frequency(state: LogState, joints: NDArray[np.bool_]) -> float | None:
    """Frequency above which the measured torque has less than half of the amplitude of the model's torque [Hz].

    Args:
        state: The log and the model that is fitted to it.
        joints: Joints that are compared, shape (n,); the median of their ratios is used.

    Returns:
        The frequency; `None` if the ratio of the amplitudes does not fall to one half, or falls less steeply than
        with a filter.
    """
    frequency, ratio = _ratios(state, joints)
    return _fall(frequency, np.exp(np.median(ratio, axis=1))) if len(frequency) else None


def half_frequencies(state: LogState, joints: NDArray[np.bool_]) -> Array:
    """Frequencies as `half_frequency` gives them, for each joint (n,) alone; infinite where there is none [Hz]."""
    result = np.full(len(joints), np.inf)
    frequency, ratio = _ratios(state, joints)
    for j, own in zip(np.flatnonzero(joints), ratio.T, strict=True):
        found = _fall(frequency, np.exp(own)) if len(frequency) else None
        result[j] = np.inf if found is None else found
    return result


def _ratios(state: LogState, joints: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Frequencies (F,) [Hz], and logarithm of the ratio of measured to modelled amplitude of k joints (F, k).

    Without a segment that is long enough, F is 0.
    """
    pairs = list(_torques(state, joints))
    if not pairs:
        return np.zeros(0), np.zeros((0, int(joints.sum())))
    rate = pairs[0][2]
    segment = int(SEGMENT * rate)
    power = np.zeros((2, segment // 2 + 1, int(joints.sum())))
    frequency = np.zeros(segment // 2 + 1)
    for measured, modelled, _ in pairs:
        frequency, ours = power_spectrum(measured, rate, segment)
        power += np.stack([ours, power_spectrum(modelled, rate, segment)[1]]) * (len(measured) // segment)
    above = frequency >= LOWEST
    power = np.maximum(power[:, above], np.finfo(float).tiny)
    return frequency[above], 0.5 * np.log(power[0] / power[1])


def _fall(frequency: Array, ratio: Array) -> float | None:
    """Lowest frequency f with a ratio of amplitudes below one half from f to 2 f [Hz].

    The result is `None` if there is no such frequency, or if the ratio at 2 f is not below `STEEP`.
    """
    for k, low in enumerate(frequency):
        octave = ratio[k : int(np.searchsorted(frequency, 2.0 * low, side="right"))]
        if 2.0 * low > frequency[-1]:
            return None
        if octave.max() < HALF:
            return float(low) if octave[-1] < STEEP else None
    return None


def _torques(state: LogState, joints: NDArray[np.bool_]) -> Iterator[tuple[Array, Array, float]]:
    """Measured and modelled torque (N, k) of k joints and sample rate [Hz], for each long segment of a log."""
    offset, values = state.source.layout.offset, state.fit.values
    for run in state.log.runs:
        samples = min(run.motion.samples, int(LONGEST * run.rate))
        if not run.consecutive or samples < 2 * int(SEGMENT * run.rate):
            continue
        x = all_rows(state.source, _first(run, samples), Band())
        modelled = [
            values[state.rows.parameters[j]] @ x[offset[j] : offset[j + 1] - 1] for j in np.flatnonzero(joints)
        ]
        yield run.torque[:samples, joints], np.column_stack(modelled), run.rate


def _first(run: ObservedRun, samples: int) -> ObservedRun:
    """The first samples of a run; in the result, every sample is a row."""
    shape = (samples, run.motion.n)
    return replace(
        run,
        motion=run.motion[slice(0, samples)],
        torque=run.torque[:samples],
        step=1,
        offset=0,
        mask=np.ones(shape, dtype=np.bool_),
        block=np.zeros(samples, dtype=run.block.dtype),
        repetition=None,
    )
