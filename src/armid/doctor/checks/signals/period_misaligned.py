"""Check for repetitions of a motion that do not begin at multiples of the stated period."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.measurement.processing.repetitions import windows
from armid.measurement.processing.uniform_runs import cut_at_gaps, resample_uniform
from armid.measurement.remedy_builders import lines

LATE_SAMPLES, LATE_SECONDS = 1.5, 0.005
"""Smallest shift of a repetition that is reported. Rounding causes shifts of up to one sample, and a fast joint moves
by half a degree within the given time."""

STEPS = 25
"""Number of Gauss-Newton steps for the alignment of one repetition with another."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports the repetition whose begin differs most from a multiple of the period."""
    recording, period = evidence.recording, evidence.reading.stated_period
    if recording is None or period is None or recording.effort is None or recording.consecutive is False:
        return []
    longest = max(cut_at_gaps(recording, 5.0)[0], key=lambda each: each.samples)
    even = resample_uniform(longest, None, 0.0, each=True)
    start = evidence.reading.start if evidence.reading.start is not None else float(even.time[0])
    begins = windows(even, period, start)
    samples = round(period * even.rate)
    if len(begins) < 2:
        return []
    late = np.array([_lag(even.q, begins[0], begin, samples) for begin in begins])
    worst = int(np.argmax(np.abs(late)))
    if abs(late[worst]) < max(LATE_SAMPLES, LATE_SECONDS * even.rate):
        return []
    seconds = late[worst] / even.rate
    even_steps = np.ptp(np.diff(late)) < LATE_SAMPLES and len(late) > 2
    remedy = (
        lines(period=float(f"{period + np.diff(late).mean() / even.rate:.6g}"))
        if even_steps
        else "record the motion again, or cut the log into one recording for each repetition and leave out the key "
        "`period`"
    )
    return [
        Finding(
            "period-misaligned",
            "warning",
            "q",
            f"Repetition {worst + 1} of {len(begins)} begins {seconds:+.4g} s ({late[worst]:+.1f} samples) away "
            f"from the multiple of the period, {period:g} s; shifts of all repetitions: "
            f"{', '.join(f'{x:+.1f}' for x in late)} samples.",
            remedy,
        )
    ]


def _lag(q: Array, first: int, begin: int, samples: int) -> float:
    """Lag of one repetition of a motion behind another one [samples].

    Args:
        q: Positions, shape (N, n).
        first: First row of the repetition that serves as the reference.
        begin: First row of the repetition whose lag is computed.
        samples: Number of samples of one period.
    """
    margin = samples // 8
    inside = np.arange(margin, samples - margin)
    reference = q[first + inside]
    slope = np.gradient(q, axis=0)
    lag = 0.0
    for _ in range(STEPS):
        at = begin + inside + lag
        if at[0] < 1 or at[-1] > len(q) - 2:
            break
        low = at.astype(np.intp)
        share = (at - low)[:, None]
        shifted = (1 - share) * q[low] + share * q[low + 1]
        gradient = (1 - share) * slope[low] + share * slope[low + 1]
        change = float(((reference - shifted) * gradient).sum() / max(float((gradient**2).sum()), 1e-300))
        change = float(np.clip(change, -margin / 4, margin / 4))
        lag += change
        if abs(change) < 1e-3:
            break
    return lag


CHECK = LogCheck(
    look=check,
    scope="command",
    effects={
        "period-misaligned": "The mean over repetitions smooths the motion and makes its torque smaller.",
    },
    untested={
        "period-misaligned": "the test does not average repetitions",
    },
    hides=(
        "contact",
        "velocity-mismatch",
        "rotor-inertia-missing",
        "temperature-drift",
    ),
    needs_torque=False,
)
