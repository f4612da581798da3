"""Resampling, bandwidth and delay of sampled signals.

Signals run along axis 0: shape (N,) or (N, ...).
"""

from __future__ import annotations

import numpy as np

from armid.errors import ArmidError
from armid.maths.spectrum import frequencies, inverse, spectrum
from armid.maths.spline import spline
from armid.values import Array

MOTION_ENERGY = 0.99
"""Share of the velocity's energy that lies in the band of the motion."""

NOISE_RATIO = 10.0
"""Ratio of a frequency's power to the noise above which it belongs to the motion."""

MOTION_FACTOR = 10.0
"""Automatic cut-off over the band of the motion. Inertial torques have products of three sines, and so three times
its highest frequency; friction has higher ones at reversals; and a zero-phase Butterworth filter of order four is
flat to 2e-4 only up to a third of its cut-off."""

CUTOFF_RANGE = (2.0, 0.1)
"""Limits of the automatic cut-off: the lower one [Hz], because friction reverses quickly on slow motions too; the
upper one over the sample rate, so that central differences have ten samples in each period."""

NEWTON_STEPS = 20
"""Largest number of Newton steps; three are usual, since a correlation is nearly a parabola at its maximum."""

DELAY_PRECISION = 1e-9
"""Change of the delay that ends the iteration [samples], far below the effect of noise."""


def resample(time: Array, x: Array, grid: Array, *, longest: float = np.inf) -> Array:
    """Interpolates signals with uneven sample times at other times, by a cubic spline.

    On the clocks of three recorded arms, with motion up to a tenth of the rate, its error is 40 times smaller than
    that of Akima's spline and 100 times smaller than that of a shape-preserving or linear one; a quintic spline gains
    nothing above the noise and overshoots long steps.

    Args:
        time: Increasing sample times, shape (N,) [s].
        x: Signals, shape (N, ...).
        grid: Times of the result, shape (M,) [s], within `time`.
        longest: Longest step that may be bridged [s].

    Raises:
        ArmidError: Time does not increase, a step is longer than `longest`, or the grid exceeds the recorded time.
    """
    steps = np.diff(time)
    if not (steps > 0).all():
        raise ArmidError(f"Time must increase; it does not after sample {int(np.argmin(steps > 0))}.")
    if len(steps) and steps.max() > longest:
        raise ArmidError(
            f"There is a gap of {steps.max():g} s after sample {int(steps.argmax())}; only {longest:g} s can be "
            "bridged.",
            remedy="split the signal there.",
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

    The band of a joint's motion contains `MOTION_ENERGY` of the energy of its velocity. Frequencies count up to the
    first one where the power of the position falls below `NOISE_RATIO` times the noise, which is the mean of the
    upper half of the spectrum, where no arm moves. The cut-off is `MOTION_FACTOR` times the widest band of all
    joints, within `CUTOFF_RANGE`.

    Args:
        q: Positions at an even rate, shape (N, n) [rad].
        rate: Samples a second [Hz].
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
    """Delay of `x` behind `reference`, both one period, shape (N, n).

    It maximises the circular cross-correlation, summed over the columns: the maximum-likelihood estimate in white
    noise. Whole samples are found by search, the fraction by Newton's method on the exact trigonometric sum.

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
    """Delays one period of a signal by a number of samples, which may have a fraction; shape of `x`."""
    samples = len(x)
    turn = np.exp(-2j * np.pi * frequencies(samples) * delay)
    return inverse(spectrum(x) * turn.reshape((-1,) + (1,) * (x.ndim - 1)), samples)
