"""Gaps and unevenness of the clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.doctor.downsample import downsample
from armid.doctor.evidence import LogEvidence
from armid.doctor.remedy_trial import RemedyTrial, try_out
from armid.errors import Finding
from armid.measurement.processing.resampling import Stretch, is_even, jitter, stretches
from armid.measurement.recording import Recording
from armid.measurement.remedy import lines, naming

__all__ = ["check"]

CUTOFF = 5.0
"""Band for which a step counts as a gap [Hz]: the one that most studies compare in."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Gaps, and steps that are not alike."""
    recording = evidence.recording
    if recording is None or recording.time is None or recording.consecutive is False:
        return []
    # Of the clock as logged: rows that repeat and are left out make no gap of it.
    pieces, gaps = stretches(_as_logged(evidence.raw) or _clock_alone(recording), CUTOFF)
    remedy = "record it again, if the rows beside the gap are needed; the log is cut in two there"
    findings = [replace(gap, channel="time", remedy=remedy) for gap in gaps]
    uneven = [piece for piece in pieces if not is_even(piece.time, piece.number)]
    if uneven:
        steps = np.concatenate([np.diff(piece.time) for piece in uneven])
        off = max(jitter(piece.time, piece.number) for piece in uneven)
        told = (
            f"Steps from {1e3 * steps.min():.3g} to {1e3 * steps.max():.3g} ms, median "
            f"{1e3 * np.median(steps):.3g} ms; samples lie {off:.2g} steps off an even clock."
        )
        rate = _round_rate(pieces[0], off)
        trial = None if gaps else _trial(evidence, rate)
        if trial is not None and trial.helps:
            note = "Hz; where the robot samples evenly and only the stamps jitter"
            remedy = "\n".join([naming(evidence.reading, {"time": ""}), lines(note, rate=rate)])
            findings.append(Finding("clock-jitter", "warning", "time", f"{told} {trial}", remedy))
        else:
            used = "Samples are moved to an even grid by these stamps; there is nothing to do."
            findings.append(Finding("clock-jitter", "info", "time", f"{told} {used}"))
    return findings


def _as_logged(raw: Recording) -> Recording | None:
    """The clock of a file alone; `None` where it cannot be walked along."""
    if raw.time is None or not np.isfinite(raw.time).all() or not (np.diff(raw.time) > 0.0).all():
        return None
    return _clock_alone(raw)


def _clock_alone(recording: Recording) -> Recording:
    """The recording with nothing that could be missing but its clock."""
    still = np.zeros_like(recording.q)
    return replace(recording, q=still, dq=None, ddq=None, effort=still)


def _round_rate(piece: Stretch, off: float) -> float:
    """The roundest rate that stamps so far off an even clock allow [Hz]."""
    doubt = 2.0 * off / piece.samples
    rounded = (float(f"{piece.rate:.{digits}g}") for digits in range(2, 10))
    return next((rate for rate in rounded if abs(rate / piece.rate - 1.0) < doubt), piece.rate)


def _trial(evidence: LogEvidence, rate: float) -> RemedyTrial | None:
    """The log with its samples at an even rate beside the log with its stamps; `None` where there is no model."""
    state, recording = evidence.state, evidence.recording
    if state is None or recording is None:
        return None
    number = np.arange(recording.samples) if recording.number is None else recording.number
    log = downsample(replace(evidence.counted, time=number / rate), state.log.cutoff)
    return try_out(state.rows, state.on(log).rows) if log.runs else None
