"""Zero-phase filters of sampled signals, and band-limited derivatives.

A *filter* is an array whose shape gives its kind: second-order sections, shape (k, 6), run forwards and backwards, or
symmetric FIR taps, shape (2h+1,), centred on the sample. Both have zero phase and a real gain, so one routine applies
both: the signal is continued at its ends (by odd reflection, or periodically) and multiplied by the gain in the
frequency domain. This equals the forward-backward recursion without its initial transient, takes the same time for
every order, and gives band-limited derivatives by the factor jω.

Signals run along axis 0 unless stated otherwise: shape (N,) or (N, ...).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from armid.errors import ArmidError
from armid.maths.spectrum import fast_length, frequencies, inverse, spectrum
from armid.values import Array

BLOCK = 40_000
"""Numbers that a filter processes at a time: intermediate arrays then stay in the cache of a core."""

SETTLED = 1e-9
"""Decay of a filter's slowest pole at which it counts as settled: the effect of the reflected end is then below the
rounding of 32-bit logs."""

EDGE = 1e-2
"""Largest share of the impulse response's absolute weight beyond the end of a run in a kept row. The reflected end is
a good guess (value and slope are right), so the error is far less than a hundredth."""

FIR_ATTENUATION = 60.0
"""Stop-band attenuation of `fir` [dB]: 0.001, below the noise of joint torques, for the shortest impulse response."""

DECIMATION_ATTENUATION = 100.0
"""Stop-band attenuation of the decimation filter [dB]: aliases are 1e-5, below a 16-bit resolution."""

DECIMATION_PASS_BAND = 0.5
"""Share of the new Nyquist frequency over which decimation has a gain of one (to 2e-5) and no aliases."""

OVERSAMPLING = 8.0
"""Lowest intermediate rate over the cut-off: the decimation then has a gain of one up to twice the cut-off, where the
gain of a fourth-order zero-phase Butterworth filter is 0.4 %."""


# Filters -------------------------------------------------------------------------------------------------------


def butterworth(order: int, cutoff: float, rate: float) -> Array:
    """Butterworth low-pass as second-order sections, shape (k, 6).

    The transfer-function form of a high order at a low cut-off overflows in double precision.

    Args:
        order: Order of one pass; forwards and backwards the slope is twice as steep.
        cutoff: Cut-off [Hz]: -3 dB in one pass, -6 dB in two.
        rate: Samples a second [Hz].

    Raises:
        ArmidError: The cut-off is not between zero and half the rate, or the order not at least one.
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
    """Windowed-sinc low-pass over a number of periods of the cut-off, taps of shape (2h+1,).

    The gain is -6 dB at the cut-off, as for `butterworth` in both directions, and exactly one at zero frequency.
    """
    _check_cutoff(periods, cutoff, rate)
    half = max(1, round(0.5 * periods * rate / cutoff))
    return _windowed_sinc(half, cutoff / rate, FIR_ATTENUATION)


def low_pass(family: str, order: int, cutoff: float, rate: float) -> Array | None:
    """Filter of a family, order and cut-off [Hz]; `None` for the family `none`."""
    if family == "none":
        return None
    return (butterworth if family == "butterworth" else fir)(order, cutoff, rate)


def decimation_filter(
    step: int, *, pass_band: float = DECIMATION_PASS_BAND, attenuation: float = DECIMATION_ATTENUATION
) -> Array:
    """Linear-phase low-pass before keeping every `step`-th sample, taps of shape (2h+1,).

    The gain is one up to `pass_band` of the new Nyquist frequency; frequencies that alias into that band are
    attenuated. The transition band aliases onto itself only, so it may be twice as wide as without aliases.

    Args:
        step: Samples from one kept sample to the next.
        pass_band: Share of the new Nyquist frequency with a gain of one, in (0, 1).
        attenuation: Attenuation of aliases [dB]; the gain of the pass band is one to twice that ratio.
    """
    if not (step >= 1 and 0 < pass_band < 1):
        raise ArmidError(
            f"Decimation by {step} with a pass band of {pass_band} is impossible.",
            remedy="decimate less, or lower the cut-off.",
        )
    if step == 1:
        return np.ones(1)
    width = (1.0 - pass_band) / step  # from pass to stop band, cycles a sample
    attenuation += 2.0  # Kaiser's formula for the length overestimates by up to 1.5 dB
    half = int(np.ceil((attenuation - 7.95) / (14.36 * width) / 2))
    return _windowed_sinc(half, 0.5 / step, attenuation)


def decimation_step(rate: float, cutoff: float, step: int) -> int:
    """Largest divisor of `step` by which to decimate before the sharp filter of this cut-off [Hz]."""
    allowed = [d for d in range(1, step + 1) if step % d == 0 and rate >= d * OVERSAMPLING * cutoff]
    return max(allowed, default=1)


def coarsest_step(rate: float, cutoff: float) -> int:
    """Largest step that loses nothing of a signal filtered at `cutoff` [Hz]."""
    return max(1, int(rate / (OVERSAMPLING * cutoff)))


def gain(filter: Array, frequency: Array) -> Array:
    """Real zero-phase gain at `frequency` [cycles a sample]: |H|² of sections, the cosine sum of taps."""
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
    """Settling time in samples: until the slowest pole has decayed to `decay`, or the taps have ended."""
    if filter.ndim == 1:
        return len(filter) // 2
    a0, a1, a2 = filter[:, 3:].T
    root = np.sqrt(a1**2 - 4.0 * a0 * a2 + 0j)
    radius = float(np.abs(np.array([-a1 + root, -a1 - root]) / (2.0 * a0)).max())
    return int(np.ceil(np.log(decay) / np.log(radius))) if radius > 0 else 2


def edge_samples(filter: Array, share: float = EDGE) -> int:
    """Number of samples at the end of a run with more than `share` of the impulse response beyond it."""
    length = fast_length(2 * settling_samples(filter) + 1)
    kernel = np.abs(inverse(_grid_gain(filter, length).astype(np.complex128), length))[: length // 2]
    tail = kernel[::-1].cumsum()[::-1]
    return int(np.argmax(tail <= share * (2.0 * tail[0] - kernel[0])))


# Application ---------------------------------------------------------------------------------------------------


def zero_phase(filter: Array, x: Array, axis: int = 0, pad: int | None = None) -> Array:
    """Low-pass filters a run; its ends are continued by odd reflection (equal value and slope).

    Args:
        filter: Sections or taps.
        x: Signals.
        axis: Axis of time.
        pad: Samples of continuation; by default the settling time of the filter.

    Returns:
        Array like `x`. Straight lines pass exactly; the two end samples are kept.
    """
    x = _along(x, axis)
    if x.ndim != 2:
        return _back(_reflected(filter, x, pad, (0,))[0], axis)
    out, few = np.empty_like(x), max(1, BLOCK // max(1, x.shape[1]))
    for begin in range(0, len(x), few):
        out[begin : begin + few] = _reflected(filter, x[begin : begin + few], pad, (0,))[0]
    return _back(out, axis)


def periodic_filter(filter: Array, x: Array, axis: int = 0) -> Array:
    """Low-pass filters signals over a whole number of periods, exactly and without end effects."""
    x = _along(x, axis)
    return _back(_circular(_grid_gain(filter, x.shape[-1]), x, (0,))[0], axis)


def filtered_derivatives(
    filter: Array, x: Array, rate: float, *, periodic: bool = False
) -> tuple[Array, Array, Array]:
    """Low-pass filtered signals with their first and second derivatives, all through the same filter.

    The derivative is exact within the band, since it is computed as (jω)·gain; a difference quotient has a relative
    error of (ω/rate)²/6 in velocity and half as much in acceleration.

    Args:
        filter: Sections or taps.
        x: Signals, shape (N, ...).
        rate: Samples a second [Hz].
        periodic: Whether the run is a whole number of periods; else its ends are reflected.
    """
    if periodic:
        parts = _circular(_grid_gain(filter, len(x)), _along(x), (0, 1, 2))
    else:
        parts = _reflected(filter, _along(x), None, (0, 1, 2))
    value, first, second = (_back(part) for part in parts)
    return value, first * rate, second * rate**2


def decimate(x: Array, taps: Array, step: int, offset: int = 0, *, periodic: bool = False) -> Array:
    """Samples `offset`, `offset + step`, … of a signal filtered by symmetric taps.

    Args:
        x: Signals, shape (N, ...).
        taps: Taps of `decimation_filter`.
        step: Samples from one kept sample to the next.
        offset: First kept sample.
        periodic: Whether the signal is continued periodically; else by odd reflection.

    Returns:
        Array of shape (ceil((N - offset) / step), ...).
    """
    half = len(taps) // 2
    rows = len(range(offset, len(x), step))
    if half == 0 or rows == 0:
        return x[offset::step] * taps[half]
    extended = _back(_extend(_along(x), half, half, periodic=periodic))
    windows = np.lib.stride_tricks.sliding_window_view(extended, len(taps), axis=0)[offset::step]
    return windows[:rows] @ taps


def interpolate(x: Array, factor: int, *, periodic: bool = False) -> Array:
    """Interpolates band-limited signals to `factor` times their rate, with the filter of decimation.

    Args:
        x: Signals along their last axis, shape (..., N), without content above half their Nyquist frequency.
        factor: Number of new samples for each given one.
        periodic: Whether the signals are continued periodically; else by odd reflection.

    Returns:
        Signals of shape (..., factor N); every `factor`-th sample is a given one, to the filter's ripple.
    """
    if factor == 1:
        return x
    taps = factor * decimation_filter(factor)
    half = len(taps) // 2
    reach = half // factor + 1
    # Row j, column φ: weight of the sample j - reach away for the value φ / factor after a sample.
    place = np.arange(factor)[None, :] - factor * np.arange(-reach, reach + 1)[:, None] + half
    weights = np.where((place >= 0) & (place < len(taps)), taps[np.clip(place, 0, len(taps) - 1)], 0.0)
    extended = _extend(x, reach, reach, periodic=periodic)
    windows = np.lib.stride_tricks.sliding_window_view(extended, 2 * reach + 1, axis=-1)
    return (windows @ weights).reshape(*x.shape[:-1], -1)


def _along(x: Array, axis: int = 0) -> Array:
    """Contiguous signals with time as the last axis, the fastest layout for a transform."""
    return np.ascontiguousarray(np.moveaxis(x, axis, -1))


def _back(x: Array, axis: int = 0) -> Array:
    """Contiguous signals with time moved from the last axis to another."""
    return np.ascontiguousarray(np.moveaxis(x, -1, axis))


def _reflected(filter: Array, x: Array, pad: int | None, orders: Sequence[int]) -> list[Array]:
    """Derivatives, for unit sample time, of filtered signals (..., N) with reflected ends."""
    samples = x.shape[-1]
    if samples < 2:
        return [x * (order == 0) for order in orders]
    slope = (x[..., -1:] - x[..., :1]) / (samples - 1)
    line = x[..., :1] + slope * np.arange(samples)
    pad = settling_samples(filter) if pad is None else pad
    if pad >= samples - 1:  # repeated reflection makes the signal periodic
        pad, length = 0, 2 * (samples - 1)
    else:
        length = fast_length(samples + 2 * pad)
    extended = _extend(x - line, pad, length - samples - pad, periodic=False)
    parts = [part[..., pad : pad + samples] for part in _circular(_grid_gain(filter, length), extended, orders)]
    straight = (line, slope, 0.0)
    return [part + straight[order] for part, order in zip(parts, orders, strict=True)]


def _circular(response: Array, x: Array, orders: Sequence[int]) -> list[Array]:
    """Derivatives for unit sample time of periodic signals (..., N) times a gain on the grid of their real FFT."""
    samples = x.shape[-1]
    transform = np.moveaxis(spectrum(np.moveaxis(x, -1, 0)), 0, -1)
    jw = 2j * np.pi * frequencies(samples)
    result: list[Array] = []
    for order in orders:
        scaled = transform * (response * jw**order if order else response)
        result.append(np.moveaxis(inverse(np.moveaxis(scaled, -1, 0), samples), 0, -1))
    return result


def _grid_gain(filter: Array, length: int) -> Array:
    """Gain on the grid of a real FFT of `length`; longer taps wrap around. The last few are remembered."""
    return _gain_of(filter.tobytes(), filter.shape, length)


@lru_cache(maxsize=16)
def _gain_of(content: bytes, shape: tuple[int, ...], length: int) -> Array:
    """The same from the numbers of a filter."""
    filter = np.frombuffer(content).reshape(shape)
    if filter.ndim == 2:
        return gain(filter, frequencies(length))
    wrapped = np.zeros(length)
    np.add.at(wrapped, np.arange(-(len(filter) // 2), len(filter) // 2 + 1) % length, filter)
    return spectrum(wrapped).real


def _extend(x: Array, before: int, after: int, *, periodic: bool) -> Array:
    """Signals (..., N) continued at both ends: periodically, or by odd reflection (repeated for short signals)."""
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


def _windowed_sinc(half: int, cutoff: float, attenuation: float) -> Array:
    """Kaiser-windowed low-pass of 2·half+1 taps, cut-off in cycles a sample, sum one."""
    k = np.arange(-half, half + 1)
    beta = 0.1102 * (attenuation - 8.7)  # Kaiser's formula, valid above 50 dB
    taps = np.sinc(2.0 * cutoff * k) * np.kaiser(2 * half + 1, beta)
    return taps / taps.sum()


def _check_cutoff(order: float, cutoff: float, rate: float) -> None:
    if not (order >= 1 and 0 < cutoff < rate / 2):
        raise ArmidError(
            f"A low-pass of order {order} at {cutoff:g} Hz is impossible for a signal with {rate:g} samples/s.",
            possible=f"an order of at least 1 and a cut-off between 0 and {rate / 2:g} Hz (half the rate)",
            remedy="lower the cut-off, or record at a higher rate.",
        )
