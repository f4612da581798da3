"""Delay of a periodic signal and its correction.

Time is axis 0 of every signal: shape (N,) or (N, ...).
"""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.maths.signals.fourier_transform import frequencies, inverse, spectrum

NEWTON_STEPS = 20
"""Largest number of Newton steps for a delay; three are usual, because a correlation is nearly a parabola at its
maximum."""

DELAY_PRECISION = 1e-9
"""Change of the delay [samples] below which the iteration ends; it is far below the effect of noise."""


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
    """Delays a periodic signal by a number of samples, which need not be an integer.

    `x` contains one period. The result has the shape of `x`.
    """
    samples = len(x)
    turn = np.exp(-2j * np.pi * frequencies(samples) * delay)
    return inverse(spectrum(x) * turn.reshape((-1,) + (1,) * (x.ndim - 1)), samples)
