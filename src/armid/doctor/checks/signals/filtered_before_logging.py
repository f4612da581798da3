"""Torque that was low-pass filtered before logging, detected by a missing noise floor."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.maths.median import median
from armid.maths.signals.fourier_transform import power_spectrum
from armid.measurement.processing.uniform_runs import resample_uniform, stretches

SEGMENT = 512
"""Number of samples of a segment. It gives a resolution of 0.2 Hz at 100 Hz and enough segments for an average."""

DECADE = 10.0
"""Largest ratio of powers for which a spectrum counts as flat; the spectrum of filtered noise falls by far more."""

FLAT = 0.7
"""Share of the frequencies above the motion that a noise floor must cover. It is at least 0.92 in logs with white
noise, and at most 0.5 in logs that were filtered at a tenth of the sample rate."""

ENDS = 0.9
"""Share of the Nyquist frequency below which a filtered spectrum falls to a thousandth. The spectrum of the steps of
dry friction falls, too, but not below the noise."""

MOTION = 8.0
"""Frequency up to which motion and friction dominate the spectrum [Hz]; a fifth of the sample rate if this is
less."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports the joints whose spectrum has no noise floor, in one finding."""
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
        top = float(median(x[frequency > 0.45 * even.rate]))
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
            f"The torque of {len(ends)} joints has no noise floor: its spectrum keeps falling, and from "
            f"{median(ends):.3g} Hz on it is a thousandth of its value just above the motion.",
            'log the unfiltered torque; if the positions have passed the same filter, family = "none" is sufficient',
        )
    ]


def _spectrum(x: Array, rate: float) -> tuple[Array, Array]:
    """Frequencies (F,) above zero [Hz] and power (F, n).

    The spectrum of second differences is computed and divided by their transfer function. Otherwise the power of the
    motion, a million times that of the sensor noise, would leak into all frequencies.
    """
    frequency, power = power_spectrum(np.diff(x, n=2, axis=0), rate, SEGMENT)
    weight = (2.0 * np.sin(np.pi * frequency[1:] / rate)) ** 4
    return frequency[1:], power[1:] / weight[:, None]


def _smooth(x: Array) -> Array:
    return np.convolve(x, np.ones(9) / 9, mode="same")


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "filtered-before-logging": "Friction at reversals is smoothed in the torque, but not in the model.",
    },
)
