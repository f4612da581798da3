"""Filtered positions and their derivatives, for consecutive samples without a gap."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array, frozen
from armid.kernel.channels.passes import filters_by_recursion
from armid.kernel.channels.passes import zero_phase as zero_phase_differences
from armid.maths.signals.derivatives import central_difference, periodic_derivative
from armid.maths.signals.zero_phase_filters import (
    filtered_derivatives,
    low_pass,
    periodic_filter,
    zero_phase,
)
from armid.measurement.processing.channels.statistics import extremes
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.uniform_runs import Segment
from armid.model.motion import Motion

ROUNDING = 16.0 * float(np.finfo(np.float64).eps)
"""Velocity below which a filtered velocity counts as zero, divided by the largest velocity or, if velocities are
differences of positions, by the largest position and the sample rate."""


def motion_filter(processing: ProcessingOptions, rate: float) -> Array | None:
    """Low-pass filter of the positions for a sample rate [Hz]; `None` for the family `none`."""
    cutoff = processing.motion_cutoff or float(processing.cutoff)
    return low_pass(processing.family, processing.order, cutoff, rate)


def differentiate(segment: Segment, processing: ProcessingOptions, *, given: bool) -> Motion:
    """Filters the positions of a segment and computes velocities and accelerations at the full sampling rate.

    Args:
        segment: Samples at a uniform rate; the rate need not be uniform if recorded derivatives are used.
        processing: Options with a cut-off in Hz; the options for filter, derivatives and edges are used.
        given: True if recorded positions, velocities and accelerations are used as they are.
    """
    if given and segment.dq is not None and segment.ddq is not None:
        return Motion(segment.time, segment.q, segment.dq, segment.ddq)
    periodic = processing.edges == "periodic"
    low = motion_filter(processing, segment.rate)
    if low is not None and processing.derivatives == "filter":
        q, dq, ddq = filtered_derivatives(low, segment.q, segment.rate, periodic=periodic)
        return Motion(segment.time, q, dq, ddq)
    recorded = segment.dq if processing.derivatives in (None, "velocity") else None
    if low is not None and not periodic and filters_by_recursion(low, segment.samples):
        return _by_recursion(low, segment, recorded)
    q = segment.q
    if low is not None:
        q = periodic_filter(low, q) if periodic else zero_phase(low, q)
    if recorded is not None:
        dq = recorded
        if low is not None:
            dq = periodic_filter(low, dq) if periodic else zero_phase(low, dq)
        ddq = central_difference(dq, segment.rate, periodic=periodic)
    elif processing.derivatives == "periodic":
        dq, ddq = (periodic_derivative(q, segment.rate, order) for order in (1, 2))
    else:
        dq, ddq = (central_difference(q, segment.rate, order, periodic=periodic) for order in (1, 2))
    return Motion(segment.time, q, dq, ddq)


def _by_recursion(low: Array, segment: Segment, recorded: Array | None) -> Motion:
    """Filtered motion of a long segment; accelerations and, unless they are recorded, velocities by differences.

    Velocities below the rounding of the filter are zero. Otherwise their signs, on which dry friction depends, would
    be random where the arm rests.
    """
    if recorded is None:
        slowest = ROUNDING * _largest(segment.q) * segment.rate
        parts = zero_phase_differences(low, segment.q, segment.rate, 2, least=(0.0, slowest))
    else:
        slowest = ROUNDING * _largest(recorded)
        parts = (
            *zero_phase_differences(low, segment.q, segment.rate, 0),
            *zero_phase_differences(low, recorded, segment.rate, 1, least=(slowest, 0.0)),
        )
    return Motion(segment.time, *map(frozen, parts))


def _largest(x: Array) -> float:
    """Largest absolute value of channels (N, n)."""
    low, high = extremes(x)
    return float(np.maximum(np.abs(low), np.abs(high)).max())
