"""Torque that has passed a low-pass before it was logged: no noise is left above it."""

from __future__ import annotations

import numpy as np

from armid.doctor.evidence import LogEvidence
from armid.errors import Finding
from armid.maths.spectrum import power_spectrum
from armid.measurement.processing.resampling import resample_uniform, stretches
from armid.values import Array

__all__ = ["check"]

SEGMENT = 512
"""Samples of one spectrum: some 0.2 Hz at 100 Hz, and enough of them in a log to average."""

DECADE = 10.0
"""Power within which a spectrum counts as flat: noise that is filtered falls by far more."""

FLAT = 0.7
"""Share of the frequencies above the motion over which a noise floor is flat: logs with white noise have 0.92 and
more, those filtered at a tenth of the rate 0.5 and less."""

ENDS = 0.9
"""Share of the band by which a filtered spectrum has come down to a thousandth. Steps of dry friction fall over all
of it, but no faster than noise lets them."""

MOTION = 8.0
"""Frequency up to which motion and friction fill the spectrum of any arm [Hz], or a fifth of the rate if less."""


def check(evidence: LogEvidence) -> list[Finding]:
    """One finding for all joints whose spectrum has no floor."""
    recording = evidence.recording
    if recording is None or recording.effort is None or recording.consecutive is False:
        return []
    piece = max(stretches(recording, 5.0)[0], key=lambda each: each.samples)
    if piece.samples < 2 * SEGMENT:
        return []
    even = resample_uniform(piece, None, 0.0, each=False)
    frequency, power = _spectrum(even.effort, even.rate)
    above = frequency > min(MOTION, 0.2 * even.rate)
    ends: list[float] = []
    for j in range(recording.n):
        x = _smooth(power[:, j])
        if x[above].max(initial=0.0) <= 0.0:
            continue
        top = float(np.median(x[frequency > 0.45 * even.rate]))
        if float((x[above] < DECADE * top).mean()) < FLAT:
            end = float(frequency[np.flatnonzero(x > 1e-3 * x[above].max())[-1]])
            if end < ENDS * 0.5 * even.rate:
                ends.append(end)
    if len(ends) < 0.6 * recording.n:
        return []
    return [
        Finding(
            "filtered-before-logging",
            "info",
            "effort",
            f"The torque of {len(ends)} joints has no noise floor: its spectrum falls on and on, and is a thousandth "
            f"of what lies above the motion from {np.median(ends):.3g} Hz on.",
            'log the unfiltered torque; where positions have passed the same filter, family = "none" will do',
        )
    ]


def _spectrum(x: Array, rate: float) -> tuple[Array, Array]:
    """Frequencies (F,) above zero [Hz] and power (F, n).

    Second differences are looked at and weighed out again: the motion is a million times stronger than a sensor's
    noise, and would leak over all frequencies.
    """
    frequency, power = power_spectrum(np.diff(x, n=2, axis=0), rate, SEGMENT)
    weight = (2.0 * np.sin(np.pi * frequency[1:] / rate)) ** 4
    return frequency[1:], power[1:] / weight[:, None]


def _smooth(x: Array) -> Array:
    return np.convolve(x, np.ones(9) / 9, mode="same")
