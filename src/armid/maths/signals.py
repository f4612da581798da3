"""Zero-phase filters of sampled signals and their derivatives in a band; arrays in, arrays out.

A *filter* here is an array that carries its own kind: second-order sections, shape (k, 6), run forwards and
backwards, or symmetric FIR taps, shape (2h+1,), centred on the sample. Both have zero phase and a real gain, so
one routine applies either: the signal is continued at its ends (by odd reflection, or by itself where it is
periodic) and multiplied by the gain in the frequency domain. That is the forward-backward recursion without its
start-up transient, costs the same at any order, and gives band-limited derivatives for the factor jω.

Signals run along axis 0 unless said otherwise: shape (N,) or (N, ...).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.errors import ArmidError
from armid.maths.spectrum import fast_length, frequencies, inverse, spectrum
from armid.values import Array

__all__ = [
    "butterworth",
    "coarsest_step",
    "decimate",
    "decimation_filter",
    "decimation_step",
    "edge_samples",
    "filtered_derivatives",
    "fir",
    "gain",
    "interpolate",
    "low_pass",
    "periodic_filter",
    "settling_samples",
    "zero_phase",
]

BLOCK = 40_000
"""Numbers that a filter works on at a time: what is made of them on the way stays in the cache of a core."""

SETTLED = 1e-9
"""Decay of a filter's slowest pole after which its memory is over: what the reflected end still does to the
signal is then below the rounding of 32-bit logs."""

EDGE = 1e-2
"""Share of the kernel's absolute weight that may still lie beyond the end of a run in a row that is kept. The
reflected end is a good guess (right in value and slope), so a hundredth of the weight carries far less error."""

FIR_ATTENUATION = 60.0
"""Stop-band attenuation of `fir` [dB]: a residual of a thousandth, below the noise of joint torques, for the
shortest kernel."""

DECIMATION_ATTENUATION = 100.0
"""Stop-band attenuation of the decimation filter [dB]: what folds down is 1e-5, below a 16-bit converter."""

DECIMATION_PASS_BAND = 0.5
"""Share of the new Nyquist frequency that decimation leaves flat (to 2e-5) and free of aliases."""

OVERSAMPLING = 8.0
"""Lowest intermediate rate in units of the cut-off: the decimation then is flat to twice the cut-off, where a
fourth-order zero-phase Butterworth has fallen to 0.4 %."""


# Filters -------------------------------------------------------------------------------------------------------


def butterworth(order: int, cutoff: float, rate: float) -> Array:
    """A Butterworth low-pass as second-order sections, shape (k, 6).

    Sections, because the transfer-function form of a high order at a low cut-off is NaN in double precision.

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
    """A windowed-sinc low-pass that spans so many periods of the cut-off, taps of shape (2h+1,).

    -6 dB at the cut-off, like `butterworth` run both ways; gain exactly one at zero frequency.
    """
    _check_cutoff(periods, cutoff, rate)
    half = max(1, round(0.5 * periods * rate / cutoff))
    return _windowed_sinc(half, cutoff / rate, FIR_ATTENUATION)


def low_pass(family: str, order: int, cutoff: float, rate: float) -> Array | None:
    """The filter that a family name, order and cut-off [Hz] ask for; none for the family `none`."""
    if family == "none":
        return None
    return (butterworth if family == "butterworth" else fir)(order, cutoff, rate)


def decimation_filter(
    step: int, *, pass_band: float = DECIMATION_PASS_BAND, attenuation: float = DECIMATION_ATTENUATION
) -> Array:
    """Linear-phase low-pass before keeping every `step`-th sample, taps of shape (2h+1,).

    Flat up to `pass_band` of the new Nyquist frequency; what would fold into that band is attenuated. Between the
    two the aliases of the transition fold onto the transition, so it may be twice as wide as a filter without any.

    Args:
        step: Samples from one kept sample to the next.
        pass_band: Share of the new Nyquist frequency left flat, in (0, 1).
        attenuation: Of what folds down [dB]; the pass band is flat to twice that ratio.
    """
    if not (step >= 1 and 0 < pass_band < 1):
        raise ArmidError(
            f"Decimation by {step} with a pass band of {pass_band} is impossible.",
            remedy="decimate less, or lower the cut-off.",
        )
    if step == 1:
        return np.ones(1)
    width = (1.0 - pass_band) / step  # from pass to stop band, cycles a sample
    attenuation += 2.0  # Kaiser's formula for the length promises up to 1.5 dB too much
    half = int(np.ceil((attenuation - 7.95) / (14.36 * width) / 2))
    return _windowed_sinc(half, 0.5 / step, attenuation)


def decimation_step(rate: float, cutoff: float, step: int) -> int:
    """The largest divisor of `step` that may be taken before the sharp filter of this cut-off [Hz]."""
    allowed = [d for d in range(1, step + 1) if step % d == 0 and rate >= d * OVERSAMPLING * cutoff]
    return max(allowed, default=1)


def coarsest_step(rate: float, cutoff: float) -> int:
    """The largest step at which a signal filtered at `cutoff` [Hz] still shows all that the filter leaves."""
    return max(1, int(rate / (OVERSAMPLING * cutoff)))


def gain(filter: Array, frequency: Array) -> Array:
    """Real zero-phase gain at `frequency` [cycles a sample]: |H|² of sections, the cosine sum of taps."""
    if filter.ndim == 1:
        half = len(filter) // 2
        return (
            filter[half]
            + 2.0 * np.cos(2.0 * np.pi * np.outer(frequency, np.arange(1, half + 1))) @ (filter[half + 1 :])
        )
    # Sections one by one in complex form: expanding |H|² in cosines cancels to nothing at a low cut-off.
    z = np.exp(-2j * np.pi * frequency)
    response = np.ones(z.shape, dtype=np.complex128)
    for b0, b1, b2, a0, a1, a2 in filter:
        response *= (b0 + z * (b1 + z * b2)) / (a0 + z * (a1 + z * a2))
    return response.real**2 + response.imag**2


def settling_samples(filter: Array, decay: float = SETTLED) -> int:
    """Samples after which the filter has forgotten: its slowest pole has fallen to `decay`, or its taps ended."""
    if filter.ndim == 1:
        return len(filter) // 2
    a0, a1, a2 = filter[:, 3:].T
    root = np.sqrt(a1**2 - 4.0 * a0 * a2 + 0j)
    radius = float(np.abs(np.array([-a1 + root, -a1 - root]) / (2.0 * a0)).max())
    return int(np.ceil(np.log(decay) / np.log(radius))) if radius > 0 else 2


def edge_samples(filter: Array, share: float = EDGE) -> int:
    """Samples from the end of a run that lean on what lies beyond it by more than `share` of the kernel."""
    length = fast_length(2 * settling_samples(filter) + 1)
    kernel = np.abs(inverse(_grid_gain(filter, length).astype(np.complex128), length))[: length // 2]
    tail = kernel[::-1].cumsum()[::-1]
    return int(np.argmax(tail <= share * (2.0 * tail[0] - kernel[0])))


# Application ---------------------------------------------------------------------------------------------------


def zero_phase(filter: Array, x: Array, axis: int = 0, pad: int | None = None) -> Array:
    """Low-pass a run, its ends continued by odd reflection (equal value and slope).

    Args:
        filter: Sections or taps.
        x: Signals.
        axis: Time.
        pad: Samples of continuation; by default until the filter has settled, however short the run.

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
    """Low-pass signals that are a whole number of periods: exact, without any end."""
    x = _along(x, axis)
    return _back(_circular(_grid_gain(filter, x.shape[-1]), x, (0,))[0], axis)


def filtered_derivatives(
    filter: Array, x: Array, rate: float, *, periodic: bool = False
) -> tuple[Array, Array, Array]:
    """Low-passed signals with their first and second derivative, all through the same filter.

    The derivative is taken of the band-limited signal itself, (jω)·gain, so that it has no error of its own inside
    the band; a difference quotient loses (ω/rate)²/6 of the velocity and half as much of the acceleration.

    Args:
        filter: Sections or taps.
        x: Signals, shape (N, ...).
        rate: Samples a second [Hz].
        periodic: The run is a whole number of periods; else its ends are reflected.
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
        taps: From `decimation_filter`.
        step: Samples from one kept sample to the next.
        offset: First kept sample.
        periodic: Continue the signal by itself instead of by odd reflection.

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
    """Band-limited signals at `factor` times their rate: the counterpart of decimation, with the same filter.

    Args:
        x: Signals along their last axis, shape (..., N), without content above half their Nyquist frequency.
        factor: Samples made for each given one.
        periodic: Continue the signals by themselves instead of by odd reflection.

    Returns:
        Shape (..., factor N); every `factor`-th is the given sample, to the filter's ripple.
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
    """The signals with time last, each of them contiguous, as a transform reads them fastest."""
    return np.ascontiguousarray(np.moveaxis(x, axis, -1))


def _back(x: Array, axis: int = 0) -> Array:
    """Signals whose time is last with time at an axis, contiguous."""
    return np.ascontiguousarray(np.moveaxis(x, -1, axis))


def _reflected(filter: Array, x: Array, pad: int | None, orders: Sequence[int]) -> list[Array]:
    """Derivatives (a sample apart) of filtered signals (..., N), ends reflected; the line through the ends aside."""
    samples = x.shape[-1]
    if samples < 2:
        return [x * (order == 0) for order in orders]
    slope = (x[..., -1:] - x[..., :1]) / (samples - 1)
    line = x[..., :1] + slope * np.arange(samples)
    pad = settling_samples(filter) if pad is None else pad
    if pad >= samples - 1:  # reflected at both ends again and again, the signal is periodic: no need to be long
        pad, length = 0, 2 * (samples - 1)
    else:
        length = fast_length(samples + 2 * pad)
    extended = _extend(x - line, pad, length - samples - pad, periodic=False)
    parts = [part[..., pad : pad + samples] for part in _circular(_grid_gain(filter, length), extended, orders)]
    straight = (line, slope, 0.0)
    return [part + straight[order] for part, order in zip(parts, orders, strict=True)]


def _circular(response: Array, x: Array, orders: Sequence[int]) -> list[Array]:
    """Derivatives (a sample apart) of periodic signals (..., N) times a gain on the grid of their real FFT."""
    samples = x.shape[-1]
    transform = np.moveaxis(spectrum(np.moveaxis(x, -1, 0)), 0, -1)
    jw = 2j * np.pi * frequencies(samples)
    result: list[Array] = []
    for order in orders:
        scaled = transform * (response * jw**order if order else response)
        result.append(np.moveaxis(inverse(np.moveaxis(scaled, -1, 0), samples), 0, -1))
    return result


def _grid_gain(filter: Array, length: int) -> Array:
    """Gain on the grid of a real FFT of `length`; taps wrap around where they are longer."""
    if filter.ndim == 2:
        return gain(filter, frequencies(length))
    wrapped = np.zeros(length)
    np.add.at(wrapped, np.arange(-(len(filter) // 2), len(filter) // 2 + 1) % length, filter)
    return spectrum(wrapped).real


def _extend(x: Array, before: int, after: int, *, periodic: bool) -> Array:
    """Signals (..., N) continued at both ends: by themselves, or by odd reflection (repeatedly where short)."""
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
    beta = 0.1102 * (attenuation - 8.7)  # Kaiser's formula, good above 50 dB
    taps = np.sinc(2.0 * cutoff * k) * np.kaiser(2 * half + 1, beta)
    return taps / taps.sum()


def _check_cutoff(order: float, cutoff: float, rate: float) -> None:
    if not (order >= 1 and 0 < cutoff < rate / 2):
        raise ArmidError(
            f"A low-pass of order {order} at {cutoff:g} Hz does not fit a signal of {rate:g} samples a second.",
            possible=f"an order of at least 1 and a cut-off between 0 and {rate / 2:g} Hz (half the rate)",
            remedy="lower the cut-off, or record at a higher rate.",
        )
