"""Real Fourier transform along axis 0: SciPy's, with the types it does not declare."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.values import Array

__all__ = ["fast_length", "frequencies", "inverse", "spectrum"]


def spectrum(x: Array) -> NDArray[np.complex128]:
    """Real FFT of signals (N, ...), shape (N // 2 + 1, ...)."""
    from scipy import fft  # a third of a second to import

    return np.asarray(fft.rfft(x, axis=0), dtype=np.complex128)


def inverse(spectrum: NDArray[np.complex128], samples: int) -> Array:
    """Signals (samples, ...) of a real FFT."""
    from scipy import fft

    return np.asarray(fft.irfft(spectrum, samples, axis=0), dtype=np.float64)


def frequencies(samples: int) -> Array:
    """Frequencies of the rows of `spectrum`, shape (samples // 2 + 1,) [cycles a sample]."""
    return np.arange(samples // 2 + 1) / samples


def fast_length(samples: int) -> int:
    """The smallest length from `samples` on whose transform is fast."""
    from scipy import fft

    length: Any = fft.next_fast_len(samples, real=True)
    return int(length)
