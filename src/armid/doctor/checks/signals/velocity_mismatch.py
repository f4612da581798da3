"""Check for velocities that differ from the derivatives of the positions: wrong scale, sign, delay or joint."""

from __future__ import annotations

from typing import Literal

import numpy as np

from armid.checked_array import Array
from armid.doctor.changes.position_jumps import without_jumps
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.maths.median import median
from armid.maths.signals.derivatives import central_difference
from armid.maths.signals.zero_phase_filters import edge_samples, low_pass, zero_phase
from armid.measurement.processing.uniform_runs import cut_at_gaps, is_brief, resample_uniform
from armid.measurement.recording import Recording
from armid.measurement.remedy_builders import lines, naming

CUTOFF = 4.0
"""Cut-off of the low-pass filter that is applied to velocities and positions before they are compared [Hz]."""

SCALE = 0.05
"""Smallest relative error of a scale that is reported; a derivative with ten samples per period has less."""

LATE = 0.008
"""Smallest delay that is reported [s]; the velocity filter of a controller has a delay of some milliseconds."""

SAMPLES = 1.2
"""Smallest delay that is reported, in samples; backward differences have a delay of half a sample."""

ALIKE, UNLIKE = 0.97, 0.9
"""Correlation from which two signals count as the same, and correlation below which they count as different."""

FEWEST = 3
"""Smallest number of moving joints whose velocities must have the same factor, so that the clock is wrong."""

CLOCK_FACTOR = 5.0
"""Largest factor, and inverse of the smallest factor, that is attributed to the clock."""

VELOCITY_UNITS = (float(np.degrees(1.0)), 30.0 / np.pi, 0.5 / np.pi)
"""Degrees per second, turns per minute and turns per second, in radians per second."""

MOVING = 0.02
"""RMS speed below which a joint is not checked [rad/s]."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports each joint whose velocity is not the derivative of its position.

    If there is no such joint, a common delay of the velocities is reported.
    """
    recording = evidence.recording
    if recording is None or recording.dq is None or recording.effort is None or recording.consecutive is False:
        return []
    logged, derived, slope, rate = _in_band(without_jumps(recording, evidence.jumps))
    if not len(logged):
        return []
    findings: list[Finding] = []
    late, scales = np.zeros(recording.n), np.full(recording.n, np.nan)
    moving = np.sqrt(np.mean(derived**2, axis=0)) > MOVING
    for j in np.flatnonzero(moving):
        A = np.column_stack([derived[:, j], slope[:, j]])
        scale, turn = np.linalg.lstsq(A, logged[:, j], rcond=None)[0]
        residual = float(np.linalg.norm(logged[:, j] - A @ [scale, turn]))
        size = float(np.linalg.norm(logged[:, j]))
        correlation = np.sqrt(max(0.0, 1.0 - (residual / size) ** 2)) if size > 0.0 else 0.0
        late[j] = -turn / scale if scale else 0.0
        scales[j] = scale if correlation >= ALIKE else np.nan
        if correlation >= ALIKE and abs(scale - 1.0) < SCALE:
            continue
        findings.append(_of_joint(evidence, logged, derived, int(j), float(scale), float(correlation)))
    if findings and (clock := _wrong_clock(evidence, scales[moving])) is not None:
        return [clock]
    typical = float(median(late[moving])) if moving.any() else 0.0
    if not findings and abs(typical) > max(LATE, SAMPLES / rate):
        evidence_text = f"Velocities lag {1e3 * typical:.1f} ms ({typical * rate:.1f} samples) behind the positions."
        findings.append(Finding("velocity-mismatch", _severity(typical), "dq", evidence_text, _remedy(evidence)))
    return findings


def _wrong_clock(evidence: LogEvidence, scales: Array) -> Finding | None:
    """Finding about a clock that runs too fast or too slowly; `None` if the velocities do not agree on one factor.

    Args:
        evidence: The log.
        scales: Ratio of logged to derived velocity of each joint that moves; NaN if they are not alike.
    """
    if len(scales) < FEWEST or np.isnan(scales).any():
        return None
    scale = float(median(scales))
    units = any(abs(unit / scale - 1.0) < SCALE for unit in VELOCITY_UNITS)
    if units or not 1.0 / CLOCK_FACTOR < scale < CLOCK_FACTOR or np.abs(scales / scale - 1.0).max() > SCALE:
        return None
    reading, known = evidence.reading, evidence.recording
    note = "as positions and velocities imply; or, if the velocities have another unit, leave them out"
    if known is not None and known.time is not None:
        remedy = lines(note, time_unit=float(f"{reading.clock_unit / scale:.3g}"))
    else:
        remedy = lines(f"Hz, {note}", rate=float(f"{evidence.rate * scale:.3g}"))
    text = (
        f"The logged velocities of all {len(scales)} joints that move are {scale:.3f} times the derivatives of the "
        f"positions. This is no unit of velocity, so the clock probably runs {1.0 / scale:.3g} times as fast as time."
    )
    return Finding("clock-rate", "error", "time", text, remedy)


def _remedy(evidence: LogEvidence) -> str:
    return naming(
        evidence.reading,
        {"dq": ""},
        "or name the right columns; if velocities are not read, positions are differentiated",
    )


def _severity(late: float) -> Literal["warning", "info"]:
    return "warning" if abs(late) > 2 * LATE else "info"


def _of_joint(
    evidence: LogEvidence, logged: Array, derived: Array, j: int, scale: float, correlation: float
) -> Finding:
    """Finding about the logged velocity of joint j, which is not the derivative of its position.

    Args:
        evidence: The log.
        logged: Logged velocities in the band of the filter, shape (M, n).
        derived: Derivatives of the positions, shape (M, n).
        j: Index of the joint.
        scale: Ratio of logged to derived velocity of the joint.
        correlation: Correlation of logged and derived velocity of the joint.
    """
    names = evidence.robot.joint_names
    others = [abs(_correlation(logged[:, j], derived[:, k])) if k != j else 0.0 for k in range(len(names))]
    best = int(np.argmax(others))
    remedy = _remedy(evidence)
    if correlation < UNLIKE and others[best] > ALIKE:
        text = f"The logged velocity is the derivative of the position of {names[best]} "
        text += f"(correlation {others[best]:.3f})."
    elif correlation >= UNLIKE and scale < 0.0:
        text = f"The logged velocity has the opposite sign of the derivative of the position (factor {scale:.3f})."
    elif correlation >= UNLIKE:
        text = f"The logged velocity is {scale:.3f} times the derivative of the position."
        if abs(np.degrees(1.0) / scale - 1.0) < SCALE:
            text += " It is in degrees per second."
    else:
        text = f"The logged velocity is not the derivative of the position (correlation {correlation:.2f})."
    return Finding("velocity-mismatch", "error", names[j], text, remedy)


def _correlation(x: Array, y: Array) -> float:
    size = float(np.linalg.norm(x) * np.linalg.norm(y))
    return float(x @ y) / size if size > 0.0 else 0.0


def _in_band(recording: Recording) -> tuple[Array, Array, Array, float]:
    """Low-pass filtered velocities: logged, and derived from the positions; with accelerations, and sample rate [Hz].

    The three arrays have shape (M, n). The accelerations are derived from the positions, too.
    """
    logged: list[Array] = []
    derived: list[Array] = []
    slope: list[Array] = []
    rate = 1.0
    for segment in cut_at_gaps(recording, CUTOFF)[0]:
        even = resample_uniform(segment, None, 0.0, each=False)
        rate = even.rate
        if is_brief(even, min(CUTOFF, 0.1 * rate)):
            continue
        low = low_pass("butterworth", 4, min(CUTOFF, 0.1 * rate), rate)
        assert low is not None and even.dq is not None
        margin = edge_samples(low)
        if even.samples < 3 * margin:
            continue
        spoilt = np.convolve(even.bad.any(axis=1), np.ones(2 * margin + 1), mode="same") > 0.5
        inside = np.arange(margin, even.samples - margin)
        inside = inside[~spoilt[inside]]
        q, dq = zero_phase(low, even.q), zero_phase(low, even.dq)
        logged.append(dq[inside])
        derived.append(central_difference(q, rate)[inside])
        slope.append(central_difference(q, rate, 2)[inside])
    if not logged:
        nothing = np.zeros((0, recording.n))
        return nothing, nothing, nothing, rate
    return np.concatenate(logged), np.concatenate(derived), np.concatenate(slope), rate


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "velocity-mismatch": "Friction is biased or meaningless; inertias, too, if accelerations are computed from "
        "these velocities.",
    },
    untested={
        "velocity-mismatch": "the test computes velocities from positions",
        "clock-rate": "positions and velocities show the rate without a model",
    },
    needs_torque=False,
)
