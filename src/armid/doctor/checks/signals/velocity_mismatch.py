"""Velocities that are not the derivatives of the positions: scale, sign, delay, or another joint's."""

from __future__ import annotations

from typing import Literal

import numpy as np

from armid.doctor.evidence import LogEvidence
from armid.errors import Finding
from armid.maths.derivatives import central_difference
from armid.maths.signals import edge_samples, low_pass, zero_phase
from armid.measurement.processing.resampling import resample_uniform, stretches
from armid.measurement.recording import Recording
from armid.measurement.remedy import naming
from armid.values import Array

__all__ = ["check"]

CUTOFF = 4.0
"""Band in which both are compared [Hz]."""

SCALE = 0.05
"""Relative error of a scale worth a word; a derivative at ten samples a period errs by less than this."""

LATE = 0.008
"""Delay worth a word [s]: a controller's velocity filter has some milliseconds, which its own positions share."""

SAMPLES = 1.2
"""The same in samples; backward differences are half a sample late."""

ALIKE, UNLIKE = 0.97, 0.9
"""Correlations from which two signals are one, and below which they are not."""

MOVING = 0.02
"""Speed below which a joint says nothing [rad/s]."""


def check(evidence: LogEvidence) -> list[Finding]:
    """One finding for each joint whose velocity is not its own, one for a common delay."""
    recording = evidence.recording
    if recording is None or recording.dq is None or recording.effort is None or recording.consecutive is False:
        return []
    told, derived, slope, rate = _in_band(recording)
    if not len(told):
        return []
    findings: list[Finding] = []
    late = np.zeros(recording.n)
    moving = np.sqrt(np.mean(derived**2, axis=0)) > MOVING
    for j in np.flatnonzero(moving):
        A = np.column_stack([derived[:, j], slope[:, j]])
        scale, turn = np.linalg.lstsq(A, told[:, j], rcond=None)[0]
        left = float(np.linalg.norm(told[:, j] - A @ [scale, turn]))
        size = float(np.linalg.norm(told[:, j]))
        own = np.sqrt(max(0.0, 1.0 - (left / size) ** 2)) if size > 0.0 else 0.0
        late[j] = -turn / scale if scale else 0.0
        if own >= ALIKE and abs(scale - 1.0) < SCALE:
            continue
        findings.append(_of_joint(evidence, told, derived, int(j), float(scale), float(own)))
    typical = float(np.median(late[moving])) if moving.any() else 0.0
    if not findings and abs(typical) > max(LATE, SAMPLES / rate):
        evidence_text = f"Velocities lag {1e3 * typical:.1f} ms ({typical * rate:.1f} samples) behind the positions."
        findings.append(Finding("velocity-mismatch", _grave(typical), "dq", evidence_text, _left_out(evidence)))
    return findings


def _left_out(evidence: LogEvidence) -> str:
    return naming(evidence.reading, {"dq": ""}, "or the right columns; positions are differentiated then")


def _grave(late: float) -> Literal["warning", "info"]:
    return "warning" if abs(late) > 2 * LATE else "info"


def _of_joint(evidence: LogEvidence, told: Array, derived: Array, j: int, scale: float, own: float) -> Finding:
    """Return what the velocity of one joint is instead."""
    names = evidence.robot.joint_names
    others = [abs(_correlation(told[:, j], derived[:, k])) if k != j else 0.0 for k in range(len(names))]
    best = int(np.argmax(others))
    remedy = _left_out(evidence)
    if own < UNLIKE and others[best] > ALIKE:
        text = f"It is the derivative of {names[best]}'s position (correlation {others[best]:.3f})."
    elif own >= UNLIKE and scale < 0.0:
        text = f"It runs against the derivative of the position (factor {scale:.3f})."
    elif own >= UNLIKE:
        text = f"It is {scale:.3f} times the derivative of the position."
        if abs(np.degrees(1.0) / scale - 1.0) < SCALE:
            text += " It counts degrees."
    else:
        text = f"It is not the derivative of the position (correlation {own:.2f})."
    return Finding("velocity-mismatch", "error", names[j], text, remedy)


def _correlation(x: Array, y: Array) -> float:
    size = float(np.linalg.norm(x) * np.linalg.norm(y))
    return float(x @ y) / size if size > 0.0 else 0.0


def _in_band(recording: Recording) -> tuple[Array, Array, Array, float]:
    """Velocities told and derived and the derivative of the latter, shape (M, n) each, and the rate [Hz]."""
    told: list[Array] = []
    derived: list[Array] = []
    slope: list[Array] = []
    rate = 1.0
    for piece in stretches(recording, CUTOFF)[0]:
        even = resample_uniform(piece, None, 0.0, each=False)
        rate = even.rate
        low = low_pass("butterworth", 4, min(CUTOFF, 0.1 * rate), rate)
        assert low is not None and even.dq is not None
        margin = edge_samples(low)
        if even.samples < 3 * margin:
            continue
        spoilt = np.convolve(even.bad.any(axis=1), np.ones(2 * margin + 1), mode="same") > 0.5
        inside = np.arange(margin, even.samples - margin)
        inside = inside[~spoilt[inside]]
        q, dq = zero_phase(low, even.q), zero_phase(low, even.dq)
        told.append(dq[inside])
        derived.append(central_difference(q, rate)[inside])
        slope.append(central_difference(q, rate, 2)[inside])
    if not told:
        nothing = np.zeros((0, recording.n))
        return nothing, nothing, nothing, rate
    return np.concatenate(told), np.concatenate(derived), np.concatenate(slope), rate
