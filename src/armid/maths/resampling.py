"""Resampling, automatic cut-off and delay of sampled signals.

Time is axis 0 of every signal: shape (N,) or (N, ...).
"""

from __future__ import annotations

import numpy as np

from armid.errors import ArmidError
from armid.maths.spectrum import frequencies, inverse, spectrum
from armid.maths.spline import spline
from armid.values import Array

MOTION_ENERGY = 0.99
"""Share of the energy of the velocity that defines the band of the motion."""

NOISE_RATIO = 10.0
"""Ratio of power to noise at a frequency above which this frequency belongs to the motion."""

MOTION_FACTOR = 10.0
"""Ratio of the automatic cut-off to the highest frequency of the band of the motion. Inertial torques contain
products of three sines, so they have up to three times this frequency. Friction has still higher frequencies at
reversals. The gain of a zero-phase Butterworth filter of order four is one, to 2e-4, only up to a third of its
cut-off."""

CUTOFF_RANGE = (2.0, 0.1)
"""Limits of the automatic cut-off. The lower limit is in Hz: friction changes quickly at reversals of slow motions,
too. The upper limit is a share of the sample rate: central differences then have ten samples in each period."""

NEWTON_STEPS = 20
"""Largest number of Newton steps; three are usual, because a correlation is nearly a parabola at its maximum."""

DELAY_PRECISION = 1e-9
"""Change of the delay [samples] below which the iteration ends; it is far below the effect of noise."""


def resample(time: Array, x: Array, grid: Array, *, longest: float = np.inf) -> Array:
    """Interpolates signals with uneven sample times by a cubic spline.

    With the sample times of recordings of three arms, and motion up to a tenth of the sample rate, the error of the
    cubic spline is 40 times smaller than that of Akima's spline, and 100 times smaller than that of shape-preserving
    or linear interpolation. A quintic spline is not better within the noise, and it overshoots at long steps.

    Args:
        time: Increasing sample times, shape (N,) [s].
        x: Signals, shape (N, ...).
        grid: Times of the result, shape (M,) [s], within `time`.
        longest: Longest step between samples over which signals are interpolated [s].

    Raises:
        ArmidError: The time does not increase, a step is longer than `longest`, or the grid exceeds the recorded
            time.
    """
    steps = np.diff(time)
    if not (steps > 0).all():
        raise ArmidError(
            f"The time must increase from sample to sample; it does not after sample {int(np.argmin(steps > 0))}."
        )
    if len(steps) and steps.max() > longest:
        raise ArmidError(
            f"There is a gap of {steps.max():g} s after sample {int(steps.argmax())}; signals are interpolated over "
            f"at most {longest:g} s.",
            remedy="split the signal at this gap.",
        )
    margin = 1e-9 * (time[-1] - time[0])  # allows for rounding of the grid
    if len(grid) and (grid[0] < time[0] - margin or grid[-1] > time[-1] + margin):
        raise ArmidError(
            f"The grid {grid[0]:g} … {grid[-1]:g} s exceeds the recorded time {time[0]:g} … {time[-1]:g} s.",
            remedy="choose a grid within the recording.",
        )
    return spline(time, x, np.clip(grid, time[0], time[-1]))


def automatic_cutoff(q: Array, rate: float) -> float:
    """Automatic cut-off of the low-pass, from the spectrum of the motion [Hz].

    The band of the motion of a joint contains the share `MOTION_ENERGY` of the energy of its velocity. Only
    frequencies below the first one at which the power of the position is less than `NOISE_RATIO` times the noise are
    considered. The noise is the mean of the upper half of the spectrum, where no arm moves. The cut-off is
    `MOTION_FACTOR` times the widest band of all joints, limited to `CUTOFF_RANGE`.

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


def periodic_delay(reference: Array, x: Array) -> float:
    """Delay of `x` relative to `reference`, each one period of a periodic signal, shape (N, n).

    The delay maximises the sum over the columns of the circular cross-correlation. In white noise this is the
    maximum-likelihood estimate. The integer part in samples is found by search, the fraction by Newton's method on
    the exact trigonometric sum.

    Returns:
        Delay in samples, in [-N/2, N/2).
    """
    samples = len(x)
    first, second = (spectrum(signal - signal.mean(axis=0)) for signal in (reference, x))
    cross = (first.conj() * second).sum(axis=1)
    delay = float(np.argmax(inverse(cross, samples)))
    w = 2.0 * np.pi * frequencies(samples)
    for _ in range(NEWTON_STEPS):
        turned = cross * np.exp(1j * w * delay)
        slope, curvature = -(w * turned.imag).sum(), -(w**2 * turned.real).sum()
        if curvature >= 0:  # without motion there is no delay
            break
        change = -slope / curvature
        if abs(change) > 1.0:  # the maximum is within a sample of the one found by search
            break
        delay += change
        if abs(change) < DELAY_PRECISION:
            break
    return float((delay + samples / 2) % samples - samples / 2)


def periodic_shift(x: Array, delay: float) -> Array:
    """Delays one period of a periodic signal by a number of samples, which need not be an integer.

    The result has the shape of `x`.
    """
    samples = len(x)
    turn = np.exp(-2j * np.pi * frequencies(samples) * delay)
    return inverse(spectrum(x) * turn.reshape((-1,) + (1,) * (x.ndim - 1)), samples)
