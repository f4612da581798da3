"""Filtered positions and their derivatives, for consecutive samples without a gap."""

from __future__ import annotations

from armid.checked_array import Array
from armid.maths.signals.derivatives import central_difference, periodic_derivative
from armid.maths.signals.zero_phase_filters import (
    filtered_derivatives,
    low_pass,
    periodic_filter,
    zero_phase,
)
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.uniform_runs import Segment
from armid.model.motion import Motion


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
    q = segment.q
    if low is not None:
        q = periodic_filter(low, q) if periodic else zero_phase(low, q)
    recorded = segment.dq if processing.derivatives in (None, "velocity") else None
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
