"""Zero-phase filters of sampled signals, and band-limited derivatives.

A *filter* is an array, and its shape gives its kind: second-order sections, shape (k, 6), which are applied forwards
and backwards, or symmetric FIR taps, shape (2h+1,), which are centred on the sample. Both kinds have zero phase and a
real gain, so the same routine applies both. The signal is continued at its ends, by odd reflection or periodically,
and multiplied by the gain in the frequency domain. The result is that of the forward-backward recursion without its
initial transient. The time does not depend on the order, and a factor jω gives band-limited derivatives.

Time is axis 0 of a signal, shape (N,) or (N, ...), unless stated otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.maths.signals.fourier_transform import fast_length, frequencies, inverse, spectrum

BLOCK = 40_000
"""Number of values that are filtered at a time; with this number, the intermediate arrays fit into the cache of a
core."""

SETTLED = 1e-9
"""Ratio to which the slowest mode of a filter has decayed when the filter counts as settled. The effect of the
reflected end is then below the rounding of 32-bit logs."""

EDGE = 1e-2
"""Largest share of the absolute impulse response of a filter that may lie beyond the end of the run, for a row that
is used. Beyond the end, the signal is continued by reflection with the correct value and slope, so the error is far
less than this share."""

FIR_ATTENUATION = 60.0
"""Stop-band attenuation of `fir` [dB]. It is a factor of 0.001, below the noise of joint torques; a larger
attenuation would need a longer impulse response."""


# Filters -------------------------------------------------------------------------------------------------------


def butterworth(order: int, cutoff: float, rate: float) -> Array:
    """Butterworth low-pass filter as second-order sections, shape (k, 6).

    Sections are used because the transfer function of a high order at a low cut-off overflows in double precision.

    Args:
        order: Order of one pass. The filter is applied forwards and backwards, which doubles the slope [dB/octave].
        cutoff: Cut-off [Hz]; the gain there is -3 dB for one pass and -6 dB for both passes.
        rate: Sample rate [Hz].

    Raises:
        ArmidError: The cut-off is not between zero and half the sample rate, or the order is less than one.
    """
    _check_cutoff(order, cutoff, rate)
    # Poles on a circle in the left half plane, moved to the unit disk by the bilinear transform, which maps
    # infinity, where all zeros lie, to -1; the cut-off is warped beforehand. Each section passes zero frequency.
    k = np.arange(order // 2)
    analog = np.tan(np.pi * cutoff / rate) * np.exp(0.5j * np.pi * (1.0 + (2 * k + 1) / order))
    pole = (1.0 + analog) / (1.0 - analog)
    a1, a2 = -2.0 * pole.real, np.abs(pole) ** 2
    one = np.ones(len(k))
    g = (one + a1 + a2) / 4.0
    sections = np.stack([g, 2.0 * g, g, one, a1, a2], axis=1)
    if order % 2:
        real = np.tan(np.pi * cutoff / rate)
        real = (1.0 - real) / (1.0 + real)
        single = np.array([[(1.0 - real) / 2.0, (1.0 - real) / 2.0, 0.0, 1.0, -real, 0.0]])
        sections = np.concatenate([single, sections])
    return sections


def fir(periods: float, cutoff: float, rate: float) -> Array:
    """FIR low-pass filter: windowed sinc as long as `periods` periods of the cut-off, taps of shape (2h+1,).

    The gain is -6 dB at the cut-off, like that of both passes of `butterworth`, and exactly one at zero frequency.
    Cut-off and sample rate are in Hz.
    """
    _check_cutoff(periods, cutoff, rate)
    half = max(1, round(0.5 * periods * rate / cutoff))
    return windowed_sinc(half, cutoff / rate, FIR_ATTENUATION)


def low_pass(family: str, order: int, cutoff: float, rate: float) -> Array | None:
    """Low-pass filter of a family, order and cut-off [Hz] for a sample rate [Hz]; `None` for the family `none`."""
    if family == "none":
        return None
    return (butterworth if family == "butterworth" else fir)(order, cutoff, rate)


def gain(filter: Array, frequency: Array) -> Array:
    """Real gain of a zero-phase filter at frequencies of any shape [cycles per sample].

    For second-order sections it is the squared magnitude of their transfer function, for taps their cosine sum.
    """
    if filter.ndim == 1:
        half = len(filter) // 2
        return (
            filter[half]
            + 2.0 * np.cos(2.0 * np.pi * np.outer(frequency, np.arange(1, half + 1))) @ (filter[half + 1 :])
        )
    # Sections one by one in complex form: an expansion of |H|² in cosines loses all digits at a low cut-off.
    z = np.exp(-2j * np.pi * frequency)
    response = np.ones(z.shape, dtype=np.complex128)
    for b0, b1, b2, a0, a1, a2 in filter:
        response *= (b0 + z * (b1 + z * b2)) / (a0 + z * (a1 + z * a2))
    return response.real**2 + response.imag**2


def settling_samples(filter: Array, decay: float = SETTLED) -> int:
    """Settling time of a filter, as a number of samples.

    After this time the slowest pole of the sections has decayed to `decay`, or the taps have ended.
    """
    if filter.ndim == 1:
        return len(filter) // 2
    a0, a1, a2 = filter[:, 3:].T
    root = np.sqrt(a1**2 - 4.0 * a0 * a2 + 0j)
    radius = float(np.abs(np.array([-a1 + root, -a1 - root]) / (2.0 * a0)).max())
    return int(np.ceil(np.log(decay) / np.log(radius))) if radius > 0 else 2


def edge_samples(filter: Array, share: float = EDGE) -> int:
    """Number of samples at each end of a run that the continuation beyond the end affects.

    For these samples, more than `share` of the absolute impulse response of the filter lies beyond the end.
    """
    length = fast_length(2 * settling_samples(filter) + 1)
    kernel = np.abs(inverse(_grid_gain(filter, length).astype(np.complex128), length))[: length // 2]
    tail = kernel[::-1].cumsum()[::-1]
    return int(np.argmax(tail <= share * (2.0 * tail[0] - kernel[0])))


# Application ---------------------------------------------------------------------------------------------------


def zero_phase(
    filter: Array, x: Array, axis: int = 0, pad: int | None = None, *, first: int = 0, step: int = 1
) -> Array:
    """Filters signals of one run, whose ends are continued by odd reflection (with the same value and slope).

    Args:
        filter: Second-order sections, shape (k, 6), or taps, shape (2h+1,).
        x: Signals, of any shape.
        axis: Index of the time axis.
        pad: Number of samples by which each end is continued; by default the settling time of the filter.
        first: Index of the first sample that is returned.
        step: Number of samples from one returned sample to the next. Only returned samples are transformed back,
            which saves up to half of the time.

    Returns:
        Filtered signals: every `step`-th sample from `first` on along the time axis, by default all samples. Straight
        lines are not changed, and the first and last samples keep their values.
    """
    x = _along(x, axis)
    if x.ndim != 2:
        return _back(_reflected(filter, x, pad, (0,), first, step)[0], axis)
    out = np.empty((len(x), len(range(first, x.shape[1], step))))
    pad = settling_samples(filter) if pad is None else pad
    few = max(1, BLOCK // max(1, x.shape[1]))
    for begin in range(0, len(x), few):
        out[begin : begin + few] = _reflected(filter, x[begin : begin + few], pad, (0,), first, step)[0]
    return _back(out, axis)


def periodic_filter(filter: Array, x: Array, axis: int = 0) -> Array:
    """Filters signals that contain a whole number of periods, exactly and without end effects."""
    x = _along(x, axis)
    return _back(_circular(_grid_gain(filter, x.shape[-1]), x, (0,))[0], axis)


def filtered_derivatives(
    filter: Array, x: Array, rate: float, *, periodic: bool = False
) -> tuple[Array, Array, Array]:
    """Filtered signals with their first and second derivatives, all by the same low-pass filter, shape (N, ...) each.

    The derivatives are exact within the band, because they are computed by the factor jω in the frequency domain. A
    difference quotient has a relative error of (ω/rate)²/6 in velocity, and half of it in acceleration.

    Args:
        filter: Second-order sections, shape (k, 6), or taps, shape (2h+1,).
        x: Signals, shape (N, ...).
        rate: Sample rate [Hz].
        periodic: If true, the signals contain a whole number of periods; otherwise their ends are continued by odd
            reflection.
    """
    if periodic:
        parts = _circular(_grid_gain(filter, len(x)), _along(x), (0, 1, 2))
    else:
        parts = _reflected(filter, _along(x), None, (0, 1, 2))
    value, first, second = (_back(part) for part in parts)
    return value, first * rate, second * rate**2


def _along(x: Array, axis: int = 0) -> Array:
    """Contiguous copy of signals with the time axis moved to the end, the fastest layout for a transform."""
    return np.ascontiguousarray(np.moveaxis(x, axis, -1))


def _back(x: Array, axis: int = 0) -> Array:
    """Contiguous copy of signals with the time axis moved from the end to `axis`."""
    return np.ascontiguousarray(np.moveaxis(x, -1, axis))


def _reflected(
    filter: Array, x: Array, pad: int | None, orders: Sequence[int], first: int = 0, step: int = 1
) -> list[Array]:
    """Filters signals (..., N) with reflected ends and differentiates them, for a sample time of 1.

    The result has one array for each order of the derivative; it contains every `step`-th sample from `first` on.
    """
    samples = x.shape[-1]
    kept = range(first, samples, step)
    if samples < 2:
        return [x[..., first::step] * (order == 0) for order in orders]
    slope = (x[..., -1:] - x[..., :1]) / (samples - 1)
    line = x[..., :1] + slope * np.arange(samples)
    pad = settling_samples(filter) if pad is None else pad
    pad += -(pad + first) % step  # the first returned sample is then the sample `start` after the decimation
    if pad >= samples - 1:  # repeated reflection makes the signal periodic
        pad, length, thinned = 0, 2 * (samples - 1), 1
    else:
        length, thinned = step * fast_length(-(-(samples + 2 * pad) // step)), step
    whole = extended(x - line, pad, length - samples - pad, periodic=False)
    start = (pad + first) // thinned
    picked = slice(start, start + (len(kept) - 1) * (step // thinned) + 1, step // thinned) if kept else slice(0)
    parts = [part[..., picked] for part in _circular(_grid_gain(filter, length), whole, orders, thinned)]
    straight = (line[..., first::step], slope, 0.0)
    return [part + straight[order] for part, order in zip(parts, orders, strict=True)]


def _circular(response: Array, x: Array, orders: Sequence[int], step: int = 1) -> list[Array]:
    """Filters periodic signals (..., N) and differentiates them, for a sample time of 1.

    The result has one array for each order of the derivative; it contains every `step`-th sample.

    Args:
        response: Gain of the filter at the frequencies of the real FFT, shape (N // 2 + 1,).
        x: Signals, shape (..., N).
        orders: Orders of the derivatives.
        step: Number of samples from one returned sample to the next, a divisor of N.
    """
    samples = x.shape[-1]
    transform = np.moveaxis(spectrum(np.moveaxis(x, -1, 0)), 0, -1)
    jw = 2j * np.pi * frequencies(samples)
    result: list[Array] = []
    for order in orders:
        scaled = transform * (response * jw**order if order else response)
        aliased = _aliased(scaled, samples, step)
        result.append(np.moveaxis(inverse(np.moveaxis(aliased, -1, 0), samples // step), 0, -1))
    return result


def _aliased(transform: NDArray[np.complex128], samples: int, step: int) -> NDArray[np.complex128]:
    """Real FFT (..., N // step // 2 + 1) of every `step`-th sample, from the real FFT of N samples.

    Frequencies that are equal modulo the new sample rate are added; those above the Nyquist frequency are the
    conjugates of those below it.
    """
    if step == 1:
        return transform
    length = samples // step
    count = length // 2 + 1
    result = transform[..., :count].copy()
    for low in range(length, samples, length):
        if low + count - 1 <= samples // 2:
            result += transform[..., low : low + count]
        else:
            high = samples - low
            result += transform[..., high - count + 1 : high + 1][..., ::-1].conj()
    return result / step


def _grid_gain(filter: Array, length: int) -> Array:
    """Gain of a filter at the frequencies of a real FFT of `length` samples; taps longer than this wrap around.

    The last 16 results are cached.
    """
    return _gain_of(filter.tobytes(), filter.shape, length)


@lru_cache(maxsize=16)
def _gain_of(content: bytes, shape: tuple[int, ...], length: int) -> Array:
    """Gain as `_grid_gain` returns it, for a filter that is given by its bytes and its shape."""
    filter = np.frombuffer(content).reshape(shape)
    if filter.ndim == 2:
        return gain(filter, frequencies(length))
    wrapped = np.zeros(length)
    np.add.at(wrapped, np.arange(-(len(filter) // 2), len(filter) // 2 + 1) % length, filter)
    return spectrum(wrapped).real


def extended(x: Array, before: int, after: int, *, periodic: bool) -> Array:
    """Signals (..., N) that are continued at both ends, by `before` and `after` samples.

    They are continued periodically, or by odd reflection, which is repeated if the signals are short.
    """
    samples = x.shape[-1]
    widths = [(0, 0)] * (x.ndim - 1) + [(before, after)]
    if periodic:
        return np.pad(x, widths, mode="wrap")
    if samples < 2:
        return np.pad(x, widths, mode="edge")
    if max(before, after) > samples - 1:
        return np.pad(x, widths, mode="reflect", reflect_type="odd")
    whole = np.empty((*x.shape[:-1], before + samples + after), dtype=x.dtype)
    whole[..., before : before + samples] = x
    np.subtract(2.0 * x[..., :1], x[..., before:0:-1], out=whole[..., :before])
    np.subtract(2.0 * x[..., -1:], x[..., -2 : -after - 2 : -1], out=whole[..., before + samples :])
    return whole


def windowed_sinc(half: int, cutoff: float, attenuation: float) -> Array:
    """Kaiser-windowed low-pass filter of 2·half+1 taps with sum one; cut-off in cycles per sample."""
    k = np.arange(-half, half + 1)
    beta = 0.1102 * (attenuation - 8.7)  # Kaiser's formula, valid above 50 dB
    taps = np.sinc(2.0 * cutoff * k) * np.kaiser(2 * half + 1, beta)
    return taps / taps.sum()


def _check_cutoff(order: float, cutoff: float, rate: float) -> None:
    if not (order >= 1 and 0 < cutoff < rate / 2):
        raise ArmidError(
            f"A low-pass filter of order {order} at {cutoff:g} Hz is impossible for a signal of {rate:g} samples/s.",
            possible=f"an order of at least 1 and a cut-off between 0 and {rate / 2:g} Hz (half the rate)",
            remedy="lower the cut-off, or record at a higher sample rate.",
        )
