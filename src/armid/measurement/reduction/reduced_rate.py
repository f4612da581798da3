"""Choice of the rate to which a recording is reduced.

Torque and columns are compared below some hertz, and the fastest robot controllers that armid was tested with log at
1 kHz. A higher rate adds no information in this band, but time and memory of every stage. Therefore a faster
recording is filtered and decimated while it is read.
"""

from __future__ import annotations

import numpy as np

from armid.errors import RecordingError
from armid.maths.signals.decimation import decimation_filter
from armid.measurement.recording import Recording
from armid.model.motion import Motion
from armid.model.terms.filtered_steps import sign_deviations
from armid.remedy import Remedy, setting

HIGHEST_RATE = 1000.0
"""Sample rate above which a recording is reduced [Hz]; the reduced rate is at least this and less than twice this."""

MOST_SAMPLES = 250_000
"""Number of samples of a recording above which the rate is reduced further, down to `LOWEST_RATE`: four minutes at
1 kHz. All later stages need about 1 kB of memory for each sample."""

LOWEST_RATE = 200.0
"""Rate below which a long recording is not reduced [Hz]. On eight minutes of a virtual iiwa 14 at 8 kHz, with noise
alone as error, parameters moved by at most 0.4 of their deviations at 1 kHz and 500 Hz, 0.9 at 250 Hz, 1.5 at 200 Hz
and 6 at 100 Hz, where the differences that give accelerations are too coarse for so little noise."""

OVERSAMPLING = 8.0
"""Smallest ratio of a reduced rate to the cut-off of the estimation: the filter of the reduction then keeps twice the
cut-off, where a zero-phase Butterworth filter of order four has a gain of 0.4 %."""

ROUNDING = 1e-3
"""Relative amount by which the measured rate of a clock may be below a multiple of the highest rate."""


def reduction_step(samples: float, rate: float, highest_rate: float | None) -> int:
    """Number of samples that become one sample; 1 if the recording is not reduced.

    Args:
        samples: Number of samples of the recording.
        rate: Sample rate of the recording [Hz].
        highest_rate: Highest rate that the log format states [Hz]; 0 if all samples are kept; `None` for the default,
            which depends on the number of samples.
    """
    if highest_rate == 0.0:
        return 1
    most = highest_rate or HIGHEST_RATE
    step = max(1, int(rate / most * (1.0 + ROUNDING)))
    if highest_rate is None and samples > MOST_SAMPLES * step:
        slowest = max(1, int(rate / LOWEST_RATE * (1.0 + ROUNDING)))
        step = max(step, min(slowest, -int(-samples // MOST_SAMPLES)))
    return step


def require_band(recording: Recording, cutoff: float | None, *, needs_all: bool) -> None:
    """Raises an error if a recording was reduced, although all samples are needed or the rate is too low.

    Args:
        recording: The recording.
        cutoff: Highest cut-off that will be used [Hz]; `None` without a filter.
        needs_all: True if the processing needs all samples.

    Raises:
        RecordingError: The filter of the reduction would attenuate frequencies that the estimation uses, or rows
            would not be samples.
    """
    if recording.logged_rate is None:
        return
    if needs_all:
        raise RecordingError(
            f"the rate of the recording was reduced from {recording.logged_rate:.5g} Hz, but with these options of "
            "the processing all samples are needed.",
            remedy=Remedy("read it with ", setting("highest_rate", 0), "."),
            source=recording.source,
        )
    if cutoff is None:
        return
    rate = np.inf if recording.time is None else float(1.0 / np.median(np.diff(recording.time[:1000])))
    if rate * (1.0 + ROUNDING) >= OVERSAMPLING * cutoff:
        return
    needed = float(f"{OVERSAMPLING * cutoff:.3g}")
    raise RecordingError(
        f"the rate of the recording was reduced from {recording.logged_rate:.5g} Hz to {rate:.5g} Hz, which is too "
        f"low for the cut-off of {cutoff:.4g} Hz.",
        possible=f"rates from {needed:g} Hz on",
        remedy=Remedy("give a higher rate, or a lower `cutoff`: ", setting("highest_rate", needed), "."),
        source=recording.source,
    )


def with_filtered_signs(motion: Motion, step: float) -> Motion:
    """Motion of a recording whose rate was reduced by `step`, with the signs of its velocities after the filter."""
    whole = round(step)
    return motion.with_sign_deviation(sign_deviations(motion.dq, decimation_filter(whole), whole))
