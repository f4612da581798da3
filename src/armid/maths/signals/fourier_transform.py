"""Real Fourier transform along axis 0.

The transforms are those of NumPy, because the import of SciPy takes longer than most transforms.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array

BLACKMAN_HARRIS = (0.35875, -0.48829, 0.14128, -0.01168)
"""Coefficients of the four-term Blackman-Harris window [Harris1978], whose side lobes are below -92 dB."""


def spectrum(x: Array) -> NDArray[np.complex128]:
    """Real FFT along axis 0, shape (N // 2 + 1, ...), of signals of shape (N, ...)."""
    return np.asarray(np.fft.rfft(x, axis=0), dtype=np.complex128)


def inverse(spectrum: NDArray[np.complex128], samples: int) -> Array:
    """Signals of shape (samples, ...) from their real FFT along axis 0."""
    return np.asarray(np.fft.irfft(spectrum, samples, axis=0), dtype=np.float64)


def frequencies(samples: int) -> Array:
    """Frequencies of the rows of `spectrum`, shape (samples // 2 + 1,) [cycles per sample]."""
    return np.arange(samples // 2 + 1) / samples


def fast_length(samples: int) -> int:
    """Smallest length with a fast transform (a product of twos, threes and fives) that is at least `samples`."""
    best = 1 << max(samples - 1, 0).bit_length()
    five = 1
    while five < best:
        three = five
        while three < best:
            best = min(best, three << max(-(-samples // three) - 1, 0).bit_length())
            three *= 3
        five *= 5
    return best


def power_spectrum(x: Array, rate: float, segment: int) -> tuple[Array, Array]:
    """Power spectral density, averaged over segments that overlap by half [Welch1967].

    The mean of each segment is subtracted, and a Blackman-Harris window is applied.

    Args:
        x: Signals, shape (N, n), N ≥ `segment`.
        rate: Sample rate [Hz].
        segment: Number L of samples in a segment.

    Returns:
        Frequencies, shape (L // 2 + 1,) [Hz]; one-sided density, shape (L // 2 + 1, n) [square of the unit / Hz].
    """
    phase = 2.0 * np.pi * np.arange(segment) / segment
    window = np.cos(np.outer(phase, np.arange(len(BLACKMAN_HARRIS)))) @ np.array(BLACKMAN_HARRIS)[:, None]
    step = segment // 2
    power = np.zeros((segment // 2 + 1, x.shape[1]))
    begins = range(0, len(x) - segment + 1, step)
    for begin in begins:
        piece = x[begin : begin + segment]
        power += np.abs(spectrum((piece - piece.mean(axis=0)) * window)) ** 2
    power *= 2.0 / (len(begins) * rate * (window**2).sum())
    power[0] /= 2.0
    if segment % 2 == 0:
        power[-1] /= 2.0
    return frequencies(segment) * rate, power
