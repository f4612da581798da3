"""Functions over the channels of a recording: each checks its arguments, allocates the output and calls a build.

N is the number of samples, n the number of channels. Signals are float64 in C order. The argument `chosen` names the
build of the kernel, one of `instruction_sets()`; by default it is `in_use()`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

import armid.kernel._native as _native
from armid.checked_array import Array
from armid.kernel.channels import reference_passes
from armid.kernel.dispatch import TWIN, in_use
from armid.maths.signals.zero_phase_filters import settling_samples

SETTLED = 1e-14
"""Ratio to which the slowest mode of a filter has decayed before and behind the samples that are filtered in one
piece. What a piece lacks is then less than the rounding of a filter over all samples."""

PIECE = 1 << 18
"""Smallest number of samples that are filtered in one piece. The pieces do not depend on the number of threads, so
the result does not either."""

NOTHING = np.empty((0, 0))


def filters_by_recursion(filter: Array, samples: int) -> bool:
    """Checks whether `zero_phase` can apply a filter to a run: it has sections, and settles within the run."""
    return filter.ndim == 2 and settling_samples(filter, SETTLED) < samples - 1


def zero_phase(
    filter: Array,
    x: ArrayLike,
    rate: float,
    orders: int,
    *,
    least: tuple[float, float] = (0.0, 0.0),
    threads: int = 1,
    chosen: str | None = None,
) -> tuple[Array, ...]:
    """Filtered signals and their derivatives by three-point differences, shape (N, n) each.

    The ends are continued by odd reflection, as in `armid.maths.signals.zero_phase_filters.zero_phase`. The filter is
    applied by a recursion forwards and backwards, whose time per sample does not depend on N. The derivatives at the
    first and last sample are those of `armid.maths.signals.derivatives.central_difference`.

    Args:
        filter: Second-order sections of `butterworth`, shape (k, 6).
        x: Signals, shape (N, n); the filter must settle within N samples, see `filters_by_recursion`.
        rate: Sample rate [Hz].
        orders: Number of derivatives, 0, 1 or 2.
        least: Smallest absolute filtered value and first derivative; what is smaller becomes zero.
        threads: Number of threads; the result does not depend on it.
        chosen: Build of the kernel.

    Returns:
        The filtered signals and `orders` derivatives.
    """
    x = np.ascontiguousarray(x, dtype=np.float64)
    chosen = chosen or in_use()
    if chosen == TWIN:
        return reference_passes.zero_phase(filter, x, rate, orders, settling_samples(filter, SETTLED), least)
    reach = settling_samples(filter, SETTLED)
    results = [np.empty_like(x) for _ in range(orders + 1)]
    padded = [*results, NOTHING, NOTHING][:3]
    sections = trapezoidal_sections(filter)
    _native.zero_phase(chosen, x, sections, reach, float(rate), *least, max(PIECE, 8 * reach), threads, *padded)
    if orders >= 1:
        value, first = results[:2]
        first[0] = (-3 * value[0] + 4 * value[1] - value[2]) * (rate / 2)
        first[-1] = (3 * value[-1] - 4 * value[-2] + value[-3]) * (rate / 2)
    if orders == 2:
        value, second = results[0], results[2]
        second[0] = (2 * value[0] - 5 * value[1] + 4 * value[2] - value[3]) * rate**2
        second[-1] = (2 * value[-1] - 5 * value[-2] + 4 * value[-3] - value[-4]) * rate**2
    return tuple(results)


def filter_columns(filter: Array, x: ArrayLike, first: int = 0, step: int = 1, *, chosen: str | None = None) -> Array:
    """Filtered regressor columns, as `zero_phase` filters channels, at every `step`-th sample: shape (K, rows).

    Args:
        filter: Second-order sections of `butterworth`, shape (k, 6).
        x: Columns, shape (K, N); the filter must settle within N samples, see `filters_by_recursion`.
        first: First sample that is returned.
        step: Number of samples from one returned sample to the next.
        chosen: Build of the kernel.
    """
    x = np.ascontiguousarray(x, dtype=np.float64)
    chosen = chosen or in_use()
    reach = settling_samples(filter, SETTLED)
    if chosen == TWIN:
        return reference_passes.filter_columns(filter, x, first, step, reach)
    out = np.empty((len(x), len(range(first, x.shape[1], step))))
    _native.filter_columns(chosen, x, trapezoidal_sections(filter), reach, first, step, out)
    return out


def trapezoidal_sections(filter: Array) -> Array:
    """Coefficients (k, 3) of state-variable filters with trapezoidal integrators, for low-pass sections (k, 6).

    With c the coefficients, the states s1 and s2 and an input x, a step is

        d = x - s2,  s1 ← c1 s1 + c2 d,  s2 ← s2 + c2 s1 + c3 d,

    with the old s1 on the right, and the output is the mean of the old and the new s2. The transfer function is that
    of the section, whose numerator must be that of `butterworth`. Unlike in the direct forms, rounding is not
    amplified by the square of the ratio of sample rate to cut-off.
    """
    b0, _, b2, _, a1, a2 = filter.T
    second = b2 != 0.0
    # Of the section with the integrators' gain g and damping k, D = 1 + g k + g²: 1 / D, g / D and g² / D.
    inverse = np.where(second, (1.0 - a1 + a2) / 4.0, 0.5)
    middle = np.where(second, np.sqrt(inverse * b0), 0.0)
    return np.ascontiguousarray(np.stack([2.0 * inverse - 1.0, 2.0 * middle, 2.0 * b0], axis=1))


def speeds(q: Array, half: int, rate: float, begin: int, end: int, *, chosen: str | None = None) -> Array:
    """Absolute speeds at the samples `begin` to `end - 1`, shape (n, end - begin) [unit of `q` / s].

    The speed at a sample is computed from the means of `half` samples before and after it. Positions are continued at
    both ends by odd reflection.

    Args:
        q: Positions at a uniform rate, shape (N, n), N > `half`.
        half: Number of samples of each mean.
        rate: Sample rate [Hz].
        begin: First sample.
        end: Sample behind the last one.
        chosen: Build of the kernel.
    """
    chosen = chosen or in_use()
    q = np.ascontiguousarray(q, dtype=np.float64)
    if chosen == TWIN:
        return reference_passes.speeds(q, half, rate, begin, end)
    out = np.empty((q.shape[1], end - begin))
    _native.speeds(chosen, q, half, rate / (half + 1), begin, out)
    return out


def third_differences(
    q: Array, time: Array, begin: int, end: int, *, chosen: str | None = None
) -> tuple[Array, Array]:
    """Absolute third divided differences of positions, in units of the noise of one sample, and the smallest steps.

    They are zero for positions on a parabola, whatever their times are.

    Args:
        q: Positions, shape (N, n).
        time: Increasing times of the positions, shape (N,) [s].
        begin: First sample; the difference of sample s is made from the samples s to s + 3.
        end: Sample behind the last one, at most N - 3.
        chosen: Build of the kernel.

    Returns:
        Differences, shape (n, end - begin), and the smallest absolute step above zero between the samples `begin` to
        `end + 2`, shape (n,); infinite if there is none.
    """
    chosen = chosen or in_use()
    q, time = np.ascontiguousarray(q, dtype=np.float64), np.ascontiguousarray(time, dtype=np.float64)
    if chosen == TWIN:
        return reference_passes.third_differences(q, time, begin, end)
    out, smallest = np.empty((q.shape[1], end - begin)), np.full(q.shape[1], np.inf)
    _native.third_differences(chosen, q, time, begin, out, smallest)
    return out, smallest


def decimate(x: Array, taps: Array, step: int, first: int, rows: int, *, chosen: str | None = None) -> Array:
    """Filters channels with a filter of finite length and keeps every `step`-th sample, shape (rows, n).

    A value that is not finite makes the results of its channel not finite whose filter reaches it.

    Args:
        x: Channels, shape (N, n).
        taps: Weights of successive samples, shape (k,); the filter of each kept sample lies inside of `x`.
        step: Number of samples from one kept sample to the next.
        first: First sample of the filter of the first kept sample.
        rows: Number of kept samples.
        chosen: Build of the kernel.
    """
    chosen = chosen or in_use()
    x, taps = np.ascontiguousarray(x, dtype=np.float64), np.ascontiguousarray(taps, dtype=np.float64)
    if chosen == TWIN:
        return reference_passes.decimate(x, taps, step, first, rows)
    out = np.empty((rows, x.shape[1]))
    _native.decimate_channels(chosen, x[first:], taps, step, out)
    return out


def heights(padded: Array, length: int, *, chosen: str | None = None) -> tuple[Array, Array]:
    """Heights of all runs of `length` successive samples of a channel, and differences of the medians beside them.

    The medians are those of the three samples before a run and of the three samples behind it. The height of a run is
    the distance of its samples from the interval between the two medians; it is zero if a sample directly beside the
    run is farther than half of this distance from the median of its side.

    Args:
        padded: Finite samples with three more at each end, shape (runs + length + 5,).
        length: Number of samples of a run.
        chosen: Build of the kernel.

    Returns:
        Heights and differences, shape (runs,) each.
    """
    chosen = chosen or in_use()
    padded = np.ascontiguousarray(padded, dtype=np.float64)
    if chosen == TWIN:
        return reference_passes.heights(padded, length)
    height, difference = np.empty((2, len(padded) - length - 5))
    _native.heights(chosen, padded, length, height, difference)
    return height, difference
