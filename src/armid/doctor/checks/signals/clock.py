"""Check of the clock for gaps and for uneven steps (jitter)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.doctor.downsample import downsample
from armid.doctor.remedy_trial import RemedyTrial, try_remedy
from armid.errors import Finding
from armid.maths.median import median
from armid.measurement.processing.uniform_runs import Segment, cut_at_gaps, is_even, jitter
from armid.measurement.recording import Recording
from armid.measurement.remedy_builders import lines, naming
from armid.remedy import Remedy

CUTOFF = 5.0
"""Cut-off that defines which steps count as gaps [Hz]; most studies use this value."""

NEAR_WHOLE = 0.15
"""Largest mean deviation of long steps from whole multiples of the median step, in steps, for which rows count as
missing. Steps of random length deviate by a quarter."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports gaps and uneven steps of the clock."""
    recording = evidence.recording
    if recording is None or recording.time is None or recording.consecutive is False:
        return []
    # Use the clock as logged: leaving out repeated rows must not create gaps.
    segments, gaps = cut_at_gaps(_as_logged(evidence.raw) or _clock_alone(recording), CUTOFF)
    remedy = (
        "record the motion again if the rows near gaps are needed; otherwise there is nothing to do, because "
        "armid cuts the log into parts at each gap"
    )
    findings = [replace(gap, channel="time", remedy=remedy) for gap in gaps]
    uneven = [segment for segment in segments if not is_even(segment.time, segment.number)]
    if uneven:
        steps = np.concatenate([np.diff(segment.time) for segment in uneven])
        offset = max(jitter(segment.time, segment.number) for segment in uneven)
        lost = _missing(uneven)
        missing = f"; about {lost} rows are missing, because steps are multiples of the median" if lost else ""
        steps_text = (
            f"The steps of the clock are {1e3 * steps.min():.3g} to {1e3 * steps.max():.3g} ms, median "
            f"{1e3 * median(steps):.3g} ms{missing}; the time stamps deviate from a uniform clock by {offset:.2g} "
            "steps (standard deviation)."
        )
        rate = _round_rate(segments[0], offset)
        trial = None if gaps else _trial(evidence, rate)
        if trial is not None and trial.helps:
            note = "Hz; if the robot samples uniformly and only the time stamps jitter"
            remedy = Remedy(*naming(evidence.reading, {"time": ""}).parts, *lines(rate=rate).parts, note=note)
            findings.append(Finding("clock-jitter", "warning", "time", f"{steps_text} {trial}", remedy))
        else:
            used = "The samples are resampled on a uniform grid with these time stamps; there is nothing to do."
            findings.append(Finding("clock-jitter", "info", "time", f"{steps_text} {used}"))
    return findings


def _missing(segments: Sequence[Segment]) -> int:
    """Number of rows that are missing in segments of a log; 0 if long steps are not multiples of the median step."""
    lost = 0
    for segment in segments:
        steps = np.diff(segment.time) / (1 if segment.number is None else np.diff(segment.number))
        ratio = steps / median(steps)
        whole = np.round(ratio)
        long = whole > 1.0
        if long.any() and np.abs(ratio - whole)[long].mean() < NEAR_WHOLE:
            lost += int((whole[long] - 1.0).sum())
    return lost


def _as_logged(raw: Recording) -> Recording | None:
    """Recording with the time stamps of the file and zeros for all signals.

    The result is `None` if time stamps are missing or do not increase.
    """
    if raw.time is None or not np.isfinite(raw.time).all() or not (np.diff(raw.time) > 0.0).all():
        return None
    return _clock_alone(raw)


def _clock_alone(recording: Recording) -> Recording:
    """The recording with its time stamps, and with zeros for all signals."""
    still = np.zeros_like(recording.q)
    return replace(recording, q=still, dq=None, ddq=None, effort=still, command=None)


def _round_rate(segment: Segment, off: float) -> float:
    """Sample rate [Hz], rounded to the fewest digits that the time stamps allow.

    Args:
        segment: Segment of rows without a gap.
        off: Standard deviation of the time stamps from a uniform clock [steps].
    """
    doubt = 2.0 * off / segment.samples
    rounded = (float(f"{segment.rate:.{digits}g}") for digits in range(2, 10))
    return next((rate for rate in rounded if abs(rate / segment.rate - 1.0) < doubt), segment.rate)


def _trial(evidence: LogEvidence, rate: float) -> RemedyTrial | None:
    """Held-out errors with the time stamps of the log and with a uniform clock.

    The result is `None` if no model can be fitted.

    Args:
        evidence: The log.
        rate: Rate of the uniform clock [Hz].
    """
    state, recording = evidence.state, evidence.recording
    if state is None or recording is None:
        return None
    number = np.arange(recording.samples) if recording.number is None else recording.number
    log = downsample(replace(evidence.counted, time=number / rate), state.log.cutoff)
    return try_remedy(state.rows, state.on(log).rows) if log.runs else None


CHECK = LogCheck(
    look=check,
    scope="command",
    effects={
        "clock-jitter": "Differentiation of positions turns jitter of the clock into noise of velocity and "
        "acceleration.",
        "clock-gap": "Signals are not filtered or differentiated across the gap, so rows next to it are lost.",
    },
    needs_torque=False,
)
