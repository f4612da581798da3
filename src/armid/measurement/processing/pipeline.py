"""Processing pipeline from recordings to observations: gaps, clock, repetitions, motion, rows.

The motion is filtered and differentiated here, at full rate. The torque is not filtered here: the filter is stored
with the observations and is later applied to torque and model columns in the same way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.checked_array import Array
from armid.errors import Finding, RecordingError
from armid.maths.signals.motion_cutoff import automatic_cutoff
from armid.measurement.observations import Observations, ObservedRun
from armid.measurement.processing.channels.position_noise import position_noise
from armid.measurement.processing.differentiation import differentiate
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.processing.period import period_of
from armid.measurement.processing.repetitions import average, check_closed, whole_periods, windows
from armid.measurement.processing.row_mask import edge_margin, moving, run_of, separate_rows
from armid.measurement.processing.saturation import without_saturated
from armid.measurement.processing.standstill import standstill_findings, sticks_and_rests
from armid.measurement.processing.uniform_runs import (
    Segment,
    cut_at_gaps,
    gather,
    is_brief,
    is_even,
    jitter,
    resample_uniform,
)
from armid.measurement.processing.unusable_runs import brief_run, no_run_left, unusable_runs
from armid.measurement.recording import Recording
from armid.measurement.reduction.reduced_rate import require_band, with_filtered_signs
from armid.model.motion import Motion
from armid.remedy import Remedy, setting

SHORTEST = 4
"""Smallest number of samples of a run, which one-sided differences at its ends need."""


def process_recordings(
    recordings: Sequence[Recording],
    processing: ProcessingOptions | None = None,
    *,
    periods: Sequence[float | Literal["find"] | None] | None = None,
    starts: Sequence[float | None] | None = None,
    effort_limits: ArrayLike | None = None,
) -> tuple[Observations, tuple[Finding, ...]]:
    """Processes several recordings of one robot to observations.

    Args:
        recordings: Recordings in the robot's joint order, SI units, joint side.
        processing: Options; defaults if not given. An automatic cut-off is determined once for all recordings.
        periods: Period of the motion of each recording [s], `None` if the motion does not repeat, or `find` to detect
            it. If no periods are given, they are detected from the positions, because confidence intervals are
            computed from the scatter between periods.
        starts: Start of the first repetition on each recording's clock [s].
        effort_limits: Effort limit of each joint, shape (n,) [N·m or N]; needed for `saturation`.

    Returns:
        The observations, and the findings of recordings and processing.

    Raises:
        RecordingError: A recording cannot be processed with these options.
    """
    processing = resolve_options(processing or ProcessingOptions(), recordings)
    runs: list[ObservedRun] = []
    findings: list[Finding] = []
    for index, recording in enumerate(recordings):
        more, noticed = process_recording(
            recording,
            processing,
            period="find" if periods is None else periods[index],
            start=starts[index] if starts else None,
            effort_limits=effort_limits,
            index=index,
        )
        runs.extend(more)
        findings.extend((*recording.findings, *noticed))
    noise = np.max([differenced_noise(each, processing) for each in recordings], axis=0)
    return Observations(tuple(runs), processing.band, noise), tuple(findings)


def differenced_noise(recording: Recording, processing: ProcessingOptions) -> Array:
    """Standard deviation of the noise of the positions, rounding included, shape (n,) [rad or m].

    It is needed if velocities and accelerations are computed from positions by differences; otherwise it is zero.
    """
    recorded = processing.derivatives in (None, "velocity") and recording.dq is not None
    if recorded or _uses_given(recording, processing) or recording.consecutive is False or recording.time is None:
        return np.zeros(recording.q.shape[1])
    return position_noise(recording.q, recording.time)


def process_recording(
    recording: Recording,
    processing: ProcessingOptions,
    *,
    period: float | Literal["find"] | None = None,
    start: float | None = None,
    effort_limits: ArrayLike | None = None,
    index: int = 0,
) -> tuple[tuple[ObservedRun, ...], tuple[Finding, ...]]:
    """Processes one recording to contiguous runs with motion, rows and masks.

    Args:
        recording: Recording in the robot's joint order, SI units, joint side; its rows count as consecutive unless it
            states otherwise.
        processing: Options.
        period: Period of the motion [s]; `find` to detect it from the positions; `None` if the motion does not
            repeat.
        start: Start of the first repetition on the recording's clock [s]; if not given, the time of the first sample.
            Rows before this time and after the last whole repetition are not used.
        effort_limits: Effort limit of each joint, shape (n,) [N·m or N]; needed for `saturation`.
        index: Index of the recording, which is stored in the runs.

    Returns:
        The runs and the findings.

    Raises:
        RecordingError: The recording cannot be processed with these options.
    """
    processing = resolve_options(processing, [recording])
    given = _uses_given(recording, processing)
    findings: list[Finding] = []
    recording = without_saturated(recording, processing.saturation, effort_limits, findings)
    if recording.consecutive is False:
        run = _separate(recording, processing, given, index, findings)
        return (run,), tuple(findings)
    segments, gaps = cut_at_gaps(recording, _highest_cutoff(processing))
    findings.extend(gaps)
    noise = np.max([position_noise(segment.q, segment.time) for segment in segments], axis=0)
    found = period == "find"
    alone = noise if len(segments) == 1 else None
    period, start = period_of(segments, period, start, recording.source, findings, alone)
    start = float(segments[0].time[0]) if period is not None and start is None else start
    segments = _on_a_grid(segments, processing, given, period, recording.source, findings)
    if processing.edges == "periodic":
        segments = _circles(segments, processing, period, start, recording.source, findings)
    repeats = None if period is None or start is None or processing.average else (period, start)
    runs, still = list[ObservedRun](), list[tuple[NDArray[np.bool_], NDArray[np.bool_]]]()
    unusable: list[tuple[Segment, int]] = []
    for segment in _long_enough(segments, processing, recording.source, findings):
        margin = edge_margin(processing, segment.rate)
        run = _run_of_segment(segment, margin, processing, repeats, index, given=given, found=found)
        if run is None:
            unusable.append((segment, margin))
        else:
            runs.append(run)
            still.append(sticks_and_rests(segment.q, segment.rate, noise, every=processing.standstill == "moving"))
    findings.extend(unusable_runs(unusable, recording.source))
    if not runs:
        raise no_run_left(recording, findings)
    return _moving(runs, still, processing, recording, findings), tuple(findings)


def resolve_options(processing: ProcessingOptions, recordings: Sequence[Recording]) -> ProcessingOptions:
    """Replaces an automatic cut-off by a frequency that is determined from the motion of all recordings.

    If no recording has consecutive rows, nothing can be filtered, and the filter is left out.

    Raises:
        RecordingError: The rate of a recording was reduced so far that it is too low for the cut-off.
    """
    if processing.cutoff == "auto":
        cutoff = _automatic_cutoff(recordings)
        processing = replace(processing, **({"cutoff": cutoff} if cutoff else {"cutoff": 0.0, "family": "none"}))
    for recording in recordings:
        require_band(recording, _highest_cutoff(processing), needs_all=processing.needs_all_samples)
    return processing


def _automatic_cutoff(recordings: Sequence[Recording]) -> float:
    """Highest frequency that any recording needs [Hz]; 0 if none has consecutive rows."""
    found: list[float] = [0.0]
    for recording in recordings:
        if recording.consecutive is not False:
            segment = max(cut_at_gaps(recording, None)[0], key=lambda segment: segment.samples)
            segment = resample_uniform(segment, None, 0.0, each=False)
            found.append(automatic_cutoff(segment.q, segment.rate))
    return max(found)


def _run_of_segment(
    segment: Segment,
    margin: int,
    processing: ProcessingOptions,
    repeats: tuple[float, float] | None,
    index: int,
    *,
    given: bool,
    found: bool,
) -> ObservedRun | None:
    """Makes the run of a segment; `None` if no row remains without `margin` samples at each end."""
    if segment.samples < max(SHORTEST, 2 * margin + 1):
        return None
    return run_of(segment, differentiate(segment, processing, given=given), processing, repeats, index, found=found)


# Steps ---------------------------------------------------------------------------------------------------------


def _uses_given(recording: Recording, processing: ProcessingOptions) -> bool:
    """Checks whether recorded velocities and accelerations are used as they are."""
    both = recording.dq is not None and recording.ddq is not None
    lacking = {"given": not both, "velocity": recording.dq is None}
    if lacking.get(str(processing.derivatives), False):
        raise RecordingError(
            f'derivatives = "{processing.derivatives}", but the recording has no '
            f"{'velocities' if recording.dq is None else 'accelerations'}.",
            remedy='use derivatives = "central", which only needs positions.',
            source=recording.source,
        )
    return both if processing.derivatives is None else processing.derivatives == "given"


def _highest_cutoff(processing: ProcessingOptions) -> float | None:
    if processing.family == "none":
        return None
    return max(float(processing.cutoff), processing.motion_cutoff or 0.0)


def _long_enough(
    segments: Sequence[Segment], processing: ProcessingOptions, source: str, findings: list[Finding]
) -> list[Segment]:
    """Selects segments that are long enough for the filters; adds a finding about each of the others."""
    if processing.family == "none":
        return list(segments)
    lowest = min(float(processing.cutoff), processing.motion_cutoff or np.inf)
    findings.extend(brief_run(segment, lowest, source) for segment in segments if is_brief(segment, lowest))
    return [segment for segment in segments if not is_brief(segment, lowest)]


def _moving(
    runs: Sequence[ObservedRun],
    still: Sequence[tuple[NDArray[np.bool_], NDArray[np.bool_]]],
    processing: ProcessingOptions,
    recording: Recording,
    findings: list[Finding],
) -> tuple[ObservedRun, ...]:
    """Masks rows at standstill, unless the option `standstill` is `keep`, and adds findings about them.

    `still` contains, for each run, the masks of the samples at which joints stick and at which all joints rest, (N,
    n). In a recording whose rate was reduced, steps of the torque have passed a filter.
    """
    if (rate := recording.logged_rate) is not None:
        runs = [replace(run, motion=with_filtered_signs(run.motion, rate / run.rate)) for run in runs]
    if processing.standstill == "keep":
        return tuple(runs)
    kept, share = moving(runs, [sticks | rests for sticks, rests in still], processing)
    parts = (moving(runs, part, processing)[1] for part in zip(*still, strict=True))
    findings.extend(standstill_findings(recording, share, *parts, every=processing.standstill == "moving"))
    return tuple(kept)


def _separate(
    recording: Recording, processing: ProcessingOptions, given: bool, index: int, findings: list[Finding]
) -> ObservedRun:
    """Run of a recording whose rows are not consecutive: all rows, without filter and differentiation."""
    whole, _ = gather(recording, clock=False)
    if not given or whole.dq is None or whole.ddq is None:
        raise RecordingError(
            "the rows are not consecutive in time, so velocities and accelerations cannot be computed from "
            "positions.",
            possible="rows in the order of time with a time column or a rate, or recorded derivatives",
            remedy="sort the rows by time, or add columns of velocities and accelerations.",
            source=recording.source,
        )
    findings.append(
        Finding(
            "rows-not-consecutive",
            "info",
            recording.source,
            f"{whole.samples} rows are treated as separate samples.",
            "Nothing was filtered, and torque terms with memory (hysteresis) cannot be used.",
        )
    )
    motion = Motion(whole.time, whole.q, whole.dq, whole.ddq)
    return separate_rows(whole, motion, processing, index)


def _on_a_grid(
    segments: Sequence[Segment],
    processing: ProcessingOptions,
    given: bool,
    period: float | None,
    source: str,
    findings: list[Finding],
) -> list[Segment]:
    """Resamples segments on uniform time grids, if anything is filtered or differentiated."""
    if processing.edges == "periodic" or processing.family != "none" or not given:
        return [_even(segment, processing, period, source, findings) for segment in segments]
    findings.extend(
        _left_uneven(segment, source) for segment in segments if not is_even(segment.time, segment.number)
    )
    return list(segments)


def _even(
    segment: Segment, processing: ProcessingOptions, period: float | None, source: str, findings: list[Finding]
) -> Segment:
    """Resamples a segment on a uniform grid; for periodic edges, with a whole number of samples per period."""
    span = None
    if processing.edges == "periodic":
        span = period if period is not None else segment.samples / segment.rate
    rows = 0.0 if processing.family == "none" else processing.decimate
    moved = resample_uniform(segment, span, rows, each=processing.average)
    if moved is segment:
        return segment
    if moved.rate == segment.rate and is_even(segment.time, segment.number):
        findings.append(_filled(segment, moved, source))
    else:
        steps = np.diff(segment.time) / (1 if segment.number is None else np.diff(segment.number))
        off = jitter(segment.time, segment.number)
        samples = "" if span is None else f"; {span:.6g} s are {span * segment.rate:.6g} samples"
        findings.append(
            Finding(
                "clock-jitter",
                "info",
                source,
                f"The clock is not uniform from t = {segment.time[0]:.6g} to {segment.time[-1]:.6g} s: its steps "
                f"are {steps.min():.3g} to {steps.max():.3g} s, and it differs by {off:.2g} steps (standard "
                f"deviation) from a uniform clock of {segment.rate:.5g} Hz{samples}.",
                f"The samples were interpolated at {moved.rate:.6g} Hz by a cubic spline.",
            )
        )
    return moved


def _filled(segment: Segment, whole: Segment, source: str) -> Finding:
    return Finding(
        "rows-filled",
        "info",
        source,
        f"{whole.samples - segment.samples} of {whole.samples} samples are missing on a uniform clock of "
        f"{segment.rate:.5g} Hz.",
        "The missing samples were interpolated by a cubic spline; the other samples are unchanged.",
    )


def _left_uneven(segment: Segment, source: str) -> Finding:
    return Finding(
        "clock-jitter",
        "info",
        source,
        f"The clock differs by {jitter(segment.time, segment.number):.2g} steps (standard deviation) from a "
        f"uniform clock of {segment.rate:.5g} Hz.",
        "The samples were not interpolated, because nothing is filtered or differentiated.",
    )


def _circles(
    segments: Sequence[Segment],
    processing: ProcessingOptions,
    period: float | None,
    start: float | None,
    source: str,
    findings: list[Finding],
) -> list[Segment]:
    """Cuts each segment to whole repetitions or, with the option `average`, replaces repetitions by their mean."""
    name = source or "The recording"
    if period is None or start is None:
        if len(segments) > 1:
            raise RecordingError(
                f'{name}: edges = "periodic" needs one run without gaps or a given period, but a gap splits the run.',
                remedy=Remedy("give the period of the motion (key `period`), or use ", setting("edges", "drop"), "."),
            )
        check_closed(segments[0], source)
        if processing.average:
            evidence = (
                f"No period is given, so the whole run of {segments[0].samples / segments[0].rate:.6g} s is taken "
                "as one period."
            )
            remedy = "if the motion repeats within the run, give its period, so that the repetitions are averaged."
            findings.append(Finding("period-unknown", "warning", source, evidence, remedy))
        return list(segments)
    found = [(segment, windows(segment, period, start)) for segment in segments]
    found = [(segment, begins) for segment, begins in found if begins]
    if not found:
        length = max(segment.samples / segment.rate for segment in segments)
        raise RecordingError(
            f"{name}: the recording contains no whole period of {period:g} s after t = {start:g} s; its "
            f"longest run has {length:g} s.",
            remedy="check the keys `period` and `start` of the recording, which are given in seconds.",
        )
    if processing.average:
        mean, late = average([(segment, b) for segment, begins in found for b in begins], period, source)
        findings.extend(late)
        circles = [mean]
    else:
        circles = [whole_periods(segment, begins, round(period * segment.rate)) for segment, begins in found]
    for circle in circles:
        check_closed(circle, source)
    return circles
