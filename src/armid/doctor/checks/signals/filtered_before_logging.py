"""Check for torque that was low-pass filtered before logging.

A filter is suspected if the spectrum of the torque falls without reaching a noise floor, or if its noise floor is
only that of the rounding. Both can have another cause: the noise of a sensor may be smaller than its resolution. The
comparison with the torque of the model then shows whether a filter is the cause, and gives its cut-off.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.torque_attenuation import half_frequencies, half_frequency
from armid.errors import Finding
from armid.maths.median import median
from armid.maths.signals.decimation import DECIMATION_PASS_BAND
from armid.maths.signals.fourier_transform import power_spectrum
from armid.measurement.processing.uniform_runs import cut_at_gaps, resample_uniform
from armid.measurement.remedy_builders import lines
from armid.remedy import Remedy

SEGMENT = 512
"""Number of samples of a segment. It gives a resolution of 0.2 Hz at 100 Hz and enough segments for an average."""

DECADE = 10.0
"""Largest ratio of powers for which a spectrum counts as flat; the spectrum of filtered noise falls by far more."""

FLAT = 0.7
"""Share of the frequencies above the motion that a noise floor must cover. It is at least 0.92 in logs with white
noise, and at most 0.5 in logs that were filtered at a tenth of the sample rate."""

ENDS = 0.9
"""Share of the highest frequency below which a filtered spectrum falls to a thousandth. The spectrum of the steps of
dry friction falls, too, but not below the noise."""

MOTION = 8.0
"""Frequency up to which motion and friction dominate the spectrum [Hz]; a fifth of the sample rate if this is
less."""

ROUNDING = 4.0
"""Largest ratio of the noise floor to the power of the rounding, step²/12 over all frequencies, for which there may
be no other noise. Rounding alone gives one."""

DECIMALS = 9
"""Largest number of decimals for which rounding is searched; rounding to more decimals is below the noise of every
computation."""

TESTED = 256
"""Number of values of a channel from which its decimals are found."""

MOST = 0.6
"""Share of the joints that a common filter must concern. One filter is usually set for all joints."""

SINGLE = 1.5
"""Smallest ratio of the cut-off of the filter of all joints to that of one joint, from which the joint is named."""

HARMLESS = 2.0
"""Ratio of the filter's cut-off to that of the study from which the filter does no harm. On the log of a six-axis arm
with a cut-off of the study of 5 Hz, intervals of 58 parameters held 56 true values without a filter and with one at
10 Hz, 50 with one at 5 Hz, 45 at 3 Hz and 33 at 1 Hz."""

HARMFUL = 1.0 / 3.0
"""Ratio of the filter's cut-off to that of the study below which most of an estimate is wrong. With a cut-off of
the study of 5 Hz, intervals of friction contained the true values with a filter at 2 Hz, but not with a filter at
1 Hz."""

NARROWER = 0.3
"""Ratio of the cut-off that is recommended for the study to the cut-off of the filter. Below the recommended
cut-off, the filter hardly changes the torque. With this ratio, intervals held 56 to 58 of 58 true values for filters
at 2, 3, 5 and 7 Hz."""

LEAST = 1.0
"""Lowest cut-off that is recommended [Hz]; at 0.8 Hz, too few rows remain, and intervals held 33 of 58 true
values."""

CODE = "filtered-before-logging"

AGAIN = "log the unfiltered torque"


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports torque that was filtered: one finding for all joints, and one for each joint that differs from them."""
    recording = evidence.recording
    if recording is None or recording.effort is None or recording.consecutive is False:
        return []
    longest = max(cut_at_gaps(recording, 5.0)[0], key=lambda each: each.samples)
    if longest.samples < 2 * SEGMENT:
        return []
    even = resample_uniform(longest, None, 0.0, each=False)
    highest = 0.5 * even.rate * (1.0 if recording.logged_rate is None else DECIMATION_PASS_BAND)
    ends, rounded = _suspicions(even.effort, even.rate, longest.effort, highest)
    falling = np.isfinite(ends)
    suspected = falling | rounded
    state = evidence.state
    if not suspected.any():
        return []
    if suspected.sum() < MOST * recording.n:
        return [] if state is None else _single(evidence, state, suspected, np.inf)
    cutoff = None if state is None else half_frequency(state, suspected)
    if cutoff is not None and state is not None:
        found = [_found(f"{suspected.sum()} joints", "effort", cutoff, evidence.cutoff or state.log.cutoff)]
        return found + _single(evidence, state, suspected, cutoff)
    alone = [] if state is None else _single(evidence, state, suspected, np.inf)
    if alone or falling.sum() < MOST * recording.n:
        return alone
    text = (
        f"The torque of {falling.sum()} joints has no noise floor: its spectrum falls up to the highest frequencies, "
        f"and above {median(ends[falling]):.3g} Hz it is below a thousandth of its value just above the band of the "
        "motion."
    )
    return [Finding(CODE, "info", "effort", text, AGAIN)]


def _single(evidence: LogEvidence, state: LogState, suspected: NDArray[np.bool_], common: float) -> list[Finding]:
    """Findings about single joints whose torque was filtered at a far lower frequency than that of the others.

    Args:
        evidence: The log.
        state: The log with the fitted model.
        suspected: Mask of the joints whose spectrum may be that of a filter, shape (n,).
        common: Cut-off of a filter of all joints [Hz]; infinite without one.
    """
    if evidence.explanations:
        return []  # another fault changes the ratio of measured and modelled torque, too
    used = evidence.cutoff or state.log.cutoff
    if suspected.all() and not np.isfinite(common):
        common = SINGLE * HARMLESS * used  # one of several suspected joints must be far below the harmless cut-off
    cutoffs = half_frequencies(state, suspected)
    few = np.flatnonzero(cutoffs < min(HARMLESS * used, common / SINGLE))
    if len(few) > max(1, (1.0 - MOST) * len(suspected)):
        return []
    names = evidence.robot.joint_names
    return [_found(names[j], names[j], float(cutoffs[j]), used) for j in few]


def _found(joints: str, channel: str, cutoff: float, used: float) -> Finding:
    """Finding that a filter was applied to the torque; its severity depends on the effect on the estimate.

    Args:
        joints: Number of joints, or the name of one.
        channel: Channel of the finding.
        cutoff: Frequency at which the torque has half of the model's amplitude [Hz].
        used: Cut-off of the study [Hz].
    """
    text = (
        f"The torque of {joints} was low-pass filtered before logging: at {cutoff:.2g} Hz it has half of the "
        f"amplitude of the model's torque, and at twice this frequency less than a quarter."
    )
    if cutoff >= HARMLESS * used:
        return Finding(CODE, "info", channel, text, AGAIN)
    text += f" The estimate uses frequencies up to {used:.3g} Hz."
    narrower = round(max(NARROWER * cutoff, LEAST), 1)
    remedy = Remedy.read(AGAIN)
    if narrower < used:
        note = "only if the unfiltered torque cannot be logged; otherwise log it and record again"
        remedy = lines(note, table="processing", cutoff=narrower)
    return Finding(CODE, "error" if cutoff < HARMFUL * used else "warning", channel, text, remedy)


def _suspicions(effort: Array, rate: float, logged: Array, highest: float) -> tuple[Array, NDArray[np.bool_]]:
    """Searches the spectrum of the torque of each joint for the effects of a low-pass filter.

    Args:
        effort: Torque on a uniform clock, shape (N, n) [N·m or N].
        rate: Sample rate [Hz].
        logged: Torque as logged, shape (M, n).
        highest: Highest frequency that is examined [Hz]: above it, a reduction of the rate has filtered the torque.

    Returns:
        Frequency above which a falling spectrum is below a thousandth of its largest value [Hz], NaN if there is a
        noise floor, shape (n,); and a mask of the joints whose noise floor is that of the rounding, shape (n,).
    """
    frequency, power = _spectrum(effort, rate)
    frequency, power = frequency[frequency <= highest], power[frequency <= highest]
    above = frequency > min(MOTION, 0.2 * rate)
    ends, rounded = np.full(effort.shape[1], np.nan), np.zeros(effort.shape[1], dtype=np.bool_)
    for j in range(effort.shape[1]):
        x = _smooth(power[:, j])
        if x[above].max(initial=0.0) <= 0.0:
            continue
        top = float(median(x[frequency > ENDS * highest]))
        rounded[j] = top < ROUNDING * _step(logged[:, j]) ** 2 / (6.0 * rate)
        if float((x[above] < DECADE * top).mean()) < FLAT:
            end = float(frequency[np.flatnonzero(x > 1e-3 * x[above].max())[-1]])
            if end < ENDS * highest:
                ends[j] = end
    return ends, rounded


def _step(values: Array) -> float:
    """Step to which values (N,) are rounded, which is a power of ten; 0 if the values are not rounded."""
    few = values[:: max(1, len(values) // TESTED)]
    size = float(np.abs(few).max(initial=0.0))
    for decimals in range(-1, DECIMALS + 1):
        scaled = few * 10.0**decimals
        if np.abs(scaled - np.round(scaled)).max(initial=0.0) < 1e-12 * size * 10.0**decimals + 1e-9:
            return 10.0**-decimals
    return 0.0


def _spectrum(x: Array, rate: float) -> tuple[Array, Array]:
    """Spectrum of n signals: frequencies (F,) above zero [Hz] and power at these frequencies, shape (F, n).

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
        CODE: "Friction at reversals is smoothed in the torque, but not in the model.",
    },
    untested={
        CODE: "the torque of left-out motion has passed the same filter",
    },
)
