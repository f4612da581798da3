"""Automatic cut-off frequency of the low-pass filter, from the band of the motion."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.maths.signals.fourier_transform import frequencies, spectrum

MOTION_ENERGY = 0.99
"""Share of the energy of the velocity that defines the band of the motion."""

NOISE_RATIO = 10.0
"""Smallest ratio of the power at a frequency to the power of the noise with which the frequency belongs to the
motion."""

MOTION_FACTOR = 10.0
"""Ratio of the automatic cut-off to the highest frequency of the band of the motion. Inertial torques contain
products of three sines, so they have up to three times this frequency. Friction has still higher frequencies at
reversals. The gain of a zero-phase Butterworth filter of order four is one, to 2e-4, only up to a third of its
cut-off."""

CUTOFF_RANGE = (2.0, 0.1)
"""Limits of the automatic cut-off. The lower limit is in Hz: friction changes quickly at reversals of slow motions,
too. The upper limit is a share of the sample rate: central differences then have ten samples in each period."""


def automatic_cutoff(q: Array, rate: float) -> float:
    """Automatic cut-off of the low-pass, from the spectrum of the motion [Hz].

    The band of the motion of a joint contains the share `MOTION_ENERGY` of the energy of its velocity. Only
    frequencies below the first one at which the power of the position is less than `NOISE_RATIO` times the noise are
    considered. The noise is the mean of the upper half of the spectrum, which contains no motion of an arm. The
    cut-off is `MOTION_FACTOR` times the widest band of all joints, limited to `CUTOFF_RANGE`.

    Args:
        q: Positions at a constant sample rate, shape (N, n) [rad or m].
        rate: Sample rate [Hz].
    """
    samples = len(q)
    line = np.linspace(q[0], q[-1], samples)  # a drift must not count as a frequency
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(samples) / samples)[:, None]  # Hann
    power = np.abs(spectrum((q - line) * window)) ** 2
    frequency = frequencies(samples) * rate
    low, high = CUTOFF_RANGE[0], CUTOFF_RANGE[1] * rate
    band = 0.0
    for joint in range(q.shape[1]):
        smooth = np.convolve(power[:, joint], np.ones(5) / 5, mode="same")  # the window spreads a line over 4 bins
        quiet = smooth < NOISE_RATIO * power[len(power) // 2 :, joint].mean()
        peak = int(smooth.argmax())
        end = peak + int(np.argmax(quiet[peak:])) if quiet[peak:].any() else len(quiet)
        energy = (power[:end, joint] * frequency[:end] ** 2).cumsum()
        if end and energy[-1] > 0:
            band = max(band, frequency[np.argmax(energy >= MOTION_ENERGY * energy[-1])])
    return float(min(max(low, MOTION_FACTOR * band), high))
