"""Findings about contiguous runs without usable rows, and the error for a recording without usable runs."""

from __future__ import annotations

from collections.abc import Sequence

from armid.errors import Finding, RecordingError
from armid.measurement.processing.uniform_runs import Segment
from armid.measurement.recording import Recording


def brief_run(segment: Segment, cutoff: float, source: str) -> Finding:
    """Finding about a run that is shorter than a period of the cut-off [Hz]."""
    return Finding(
        "run-short",
        "warning",
        source,
        f"The run from t = {segment.time[0]:.6g} s has {segment.samples} samples in "
        f"{segment.samples / segment.rate:.3g} s, less than a period of the cut-off of {cutoff:g} Hz.",
        "The run was left out; nothing has to be done if enough other runs remain.",
    )


def unusable_run(segment: Segment, margin: int, source: str) -> Finding:
    """Finding about a run without usable rows: `margin` samples at each end are left out, all others are masked."""
    return Finding(
        "run-short",
        "warning",
        source,
        f"No row of the run of {segment.samples / segment.rate:.3g} s from t = {segment.time[0]:.6g} s can be used: "
        f"{margin / segment.rate:.3g} s at each end are left out, and {segment.bad.mean():.0%} of its samples are "
        "masked, because they are excluded, repeated or saturated.",
        "The run was left out; nothing has to be done if enough other runs remain.",
    )


def no_run_left(recording: Recording, findings: Sequence[Finding]) -> RecordingError:
    """Error for a recording without usable rows."""
    return RecordingError(
        f"no row is left for the estimation. {findings[-1].evidence}",
        remedy="give a smaller `trim`, a higher `cutoff` or shorter `exclude` intervals, or record a longer motion; "
        "if the motion was longer than this, check the unit of the clock (`time_unit`) or the `rate`.",
        source=recording.source,
    )
