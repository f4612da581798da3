"""Findings about contiguous runs without usable rows, and the error for a recording without usable runs."""

from __future__ import annotations

from collections.abc import Sequence

from armid.errors import Finding, RecordingError
from armid.measurement.processing.uniform_runs import Segment
from armid.measurement.recording import Recording

FEW_RUNS = 3
"""Largest number of unusable runs for which each run has its own finding."""


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


def unusable_runs(runs: Sequence[tuple[Segment, int]], source: str) -> list[Finding]:
    """Findings about runs without usable rows: one for each run, or one for all runs if there are many.

    Args:
        runs: Each run, and the number of samples that are left out at each of its ends.
        source: Path of the recording.
    """
    if len(runs) <= FEW_RUNS:
        return [_unusable_run(segment, margin, source) for segment, margin in runs]
    seconds = [segment.samples / segment.rate for segment, _ in runs]
    margins = [margin / segment.rate for segment, margin in runs]
    return [
        Finding(
            "run-short",
            "warning",
            source,
            f"No row of {len(runs)} runs of {min(seconds):.3g} to {max(seconds):.3g} s can be used, together "
            f"{sum(seconds):.3g} s: up to {max(margins):.3g} s at each end of a run are left out, as are samples "
            "that are excluded, repeated or saturated.",
            "The runs were left out; nothing has to be done if enough other runs remain.",
        )
    ]


def _unusable_run(segment: Segment, margin: int, source: str) -> Finding:
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
    """Error for a recording in which no run has usable rows."""
    return RecordingError(
        f"no row is left for the estimation. {findings[-1].evidence}",
        remedy="give a smaller `trim`, a higher `cutoff` or shorter `exclude` intervals, or record a longer motion; "
        "if the motion was longer than this, check the unit of the clock (`time_unit`) or the `rate`.",
        source=recording.source,
    )
