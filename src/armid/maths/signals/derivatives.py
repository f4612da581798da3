"""Derivatives of sampled signals: by central differences, or exactly for periodic signals."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.maths.signals.fourier_transform import frequencies, inverse, spectrum


def central_difference(x: Array, rate: float, order: int = 1, *, periodic: bool = False) -> Array:
    """First or second derivative [unit of `x` / s or / s²] by the three-point formula, in the shape of `x`.

    The relative error of the three-point formula for the second derivative is (ω/rate)²/12. If the formula for the
    first derivative were applied twice, only every second sample would be used. The error would then be four times as
    large, and frequencies in the upper half of the band would have little effect.

    Args:
        x: Signals, shape (N, ...).
        rate: Sample rate [Hz].
        order: Order of the derivative, 1 or 2.
        periodic: If true, the signals are one or more whole periods, and differences wrap around. Otherwise one-sided
            formulas of the same order are used at the two ends.
    """
    if order not in (1, 2):
        raise ArmidError(f"The order of the derivative must be 1 or 2; found {order}.")
    if periodic:
        forward, backward = np.roll(x, -1, axis=0), np.roll(x, 1, axis=0)
        return (forward - backward) * (rate / 2) if order == 1 else (forward - 2 * x + backward) * rate**2
    if len(x) < 4:
        raise ArmidError(
            f"Central differences need at least 4 samples; found {len(x)}.", remedy="give a longer signal."
        )
    result = np.empty_like(x)
    if order == 1:
        result[1:-1] = (x[2:] - x[:-2]) * (rate / 2)
        result[0] = (-3 * x[0] + 4 * x[1] - x[2]) * (rate / 2)
        result[-1] = (3 * x[-1] - 4 * x[-2] + x[-3]) * (rate / 2)
        return result
    result[1:-1] = (x[2:] - 2 * x[1:-1] + x[:-2]) * rate**2
    result[0] = (2 * x[0] - 5 * x[1] + 4 * x[2] - x[3]) * rate**2
    result[-1] = (2 * x[-1] - 5 * x[-2] + 4 * x[-3] - x[-4]) * rate**2
    return result


def periodic_derivative(x: Array, rate: float, order: int = 1) -> Array:
    """Exact derivative, of the given order, of signals (N, ...) that contain a whole number of periods."""
    jw = (2j * np.pi * rate * frequencies(len(x))).reshape(-1, *(1,) * (x.ndim - 1))
    return inverse(spectrum(x) * jw**order, len(x))
