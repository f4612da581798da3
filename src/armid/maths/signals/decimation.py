"""Decimation and interpolation of signals by whole factors, with linear-phase filters.

Time is axis 0 of a signal, shape (N,) or (N, ...), unless stated otherwise.
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.maths.signals.zero_phase_filters import extended, windowed_sinc

DECIMATION_ATTENUATION = 100.0
"""Stop-band attenuation of the decimation filter [dB]. Aliases are attenuated by a factor of 1e-5, to less than
16-bit resolution."""

DECIMATION_PASS_BAND = 0.5
"""Upper end of the pass band of the decimation filter, divided by the new Nyquist frequency. In the pass band, the
gain differs from one by at most 2e-5, and there are no aliases."""

OVERSAMPLING = 8.0
"""Smallest allowed ratio of the sample rate after decimation to the cut-off of the low-pass filter. The gain of the
decimation is then one up to twice the cut-off. At this frequency, a zero-phase Butterworth filter of order four has a
gain of 0.4 %."""


def decimation_filter(
    step: int, *, pass_band: float = DECIMATION_PASS_BAND, attenuation: float = DECIMATION_ATTENUATION
) -> Array:
    """Linear-phase low-pass filter for a decimation to every `step`-th sample; taps of shape (2h+1,).

    The gain is one up to `pass_band` times the new Nyquist frequency, and frequencies that alias into this band are
    attenuated. Aliases of the transition band fall only into the transition band, so it may be twice as wide as for a
    filter that attenuates all frequencies above the new Nyquist frequency.

    Args:
        step: Number of samples from one kept sample to the next.
        pass_band: Upper end of the pass band, divided by the new Nyquist frequency, in (0, 1).
        attenuation: Attenuation of aliases [dB]. In the pass band, the gain differs from one by at most twice this
            factor.
    """
    if not (step >= 1 and 0 < pass_band < 1):
        raise ArmidError(
            f"Decimation by {step} with a pass band of {pass_band} times the new Nyquist frequency is impossible.",
            remedy="decimate by a smaller factor, or lower the cut-off.",
        )
    if step == 1:
        return np.ones(1)
    width = (1.0 - pass_band) / step  # from pass to stop band, cycles a sample
    attenuation += 2.0  # Kaiser's formula for the length overestimates by up to 1.5 dB
    half = int(np.ceil((attenuation - 7.95) / (14.36 * width) / 2))
    return windowed_sinc(half, 0.5 / step, attenuation)


def decimation_step(rate: float, cutoff: float, step: int) -> int:
    """Largest divisor of `step` by which a signal may be decimated before a low-pass filter with the given cut-off.

    The sample rate and the cut-off are in Hz. After the decimation, the rate is at least `OVERSAMPLING` times the
    cut-off.
    """
    allowed = [d for d in range(1, step + 1) if step % d == 0 and rate >= d * OVERSAMPLING * cutoff]
    return max(allowed, default=1)


def coarsest_step(rate: float, cutoff: float) -> int:
    """Largest factor by which a signal that is low-pass filtered at a cut-off may be decimated, at least 1.

    The sample rate and the cut-off are in Hz. After the decimation, the rate is at least `OVERSAMPLING` times the
    cut-off.
    """
    return max(1, int(rate / (OVERSAMPLING * cutoff)))


def decimate(x: Array, taps: Array, step: int, offset: int = 0, *, periodic: bool = False) -> Array:
    """Filters a signal with symmetric taps and keeps the samples `offset`, `offset + step`, ….

    Args:
        x: Signals, shape (N, ...).
        taps: Taps of `decimation_filter`.
        step: Number of samples from one kept sample to the next.
        offset: Index of the first kept sample.
        periodic: If true, the signal is continued periodically, otherwise by odd reflection.

    Returns:
        Filtered samples, shape (ceil((N - offset) / step), ...).
    """
    half = len(taps) // 2
    rows = len(range(offset, len(x), step))
    if half == 0 or rows == 0:
        return x[offset::step] * taps[half]
    whole = extended(np.moveaxis(x, 0, -1), half, half, periodic=periodic)
    whole = np.ascontiguousarray(np.moveaxis(whole, -1, 0))
    windows = np.lib.stride_tricks.sliding_window_view(whole, len(taps), axis=0)[offset::step]
    return windows[:rows] @ taps


def interpolate(x: Array, factor: int, *, periodic: bool = False) -> Array:
    """Interpolates band-limited signals to `factor` times their sample rate, with the filter of `decimation_filter`.

    Args:
        x: Signals, time on the last axis, shape (..., N), without frequencies above half the Nyquist frequency.
        factor: Number of new samples for each given sample.
        periodic: If true, the signals are continued periodically, otherwise by odd reflection.

    Returns:
        Signals of shape (..., factor N). Every `factor`-th sample is a given sample, to the accuracy of the pass
        band.
    """
    if factor == 1:
        return x
    taps = factor * decimation_filter(factor)
    half = len(taps) // 2
    reach = half // factor + 1
    # Row j, column φ: weight of the sample j - reach away for the value φ / factor after a sample.
    place = np.arange(factor)[None, :] - factor * np.arange(-reach, reach + 1)[:, None] + half
    weights = np.where((place >= 0) & (place < len(taps)), taps[np.clip(place, 0, len(taps) - 1)], 0.0)
    whole = extended(x, reach, reach, periodic=periodic)
    windows = np.lib.stride_tricks.sliding_window_view(whole, 2 * reach + 1, axis=-1)
    return (windows @ weights).reshape(*x.shape[:-1], -1)
