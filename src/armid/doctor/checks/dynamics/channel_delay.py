"""Delay between torque and positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.doctor.check_input import WIDTH, LogEvidence
from armid.doctor.downsample import downsample
from armid.doctor.log_check import LogCheck
from armid.doctor.log_interpretation import Explanation, LogState
from armid.doctor.quick_fit import QuickRows, solve
from armid.doctor.stuck_channels import without_stuck
from armid.errors import Finding
from armid.maths.spectrum import frequencies, inverse, spectrum
from armid.maths.spline import spline_slopes
from armid.measurement.log_format_remedies import lines
from armid.measurement.observations import ObservedRun
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.model.terms import Stribeck
from armid.values import Array

CODE = "channel-delay"

GAIN = 0.1
"""Fall of the log residual that a delay must bring: on recorded arms friction that resembles a delay gives up to
0.04, a true delay of 10 ms and more gives 0.3 and more."""

HINT = 0.04
"""Fall that the torque's slope as an extra column must bring for a delay to be searched: it gives at least half of
the fall that the delay gives."""

SHARE = 0.98
"""Smallest ratio of the fall by one common delay to the fall by lags of each joint's friction alone. Where friction
only resembles a delay it is below 0.97 (recorded arms: two thirds; a light arm with presliding: 0.96); for a true
delay of 10 ms it is 1, even in slow motion where friction dominates."""

SURE = 6.0
"""Standard deviations by which a delay must differ from zero."""

STEPS, SETTLED = 8, 0.1
"""Largest number of Gauss-Newton steps, and step in standard deviations that ends them."""

SHARP = 15.0
"""Cut-off with which a detected delay is measured [Hz]: friction at reversals determines it better in a wider band,
up to where noise of the positions dominates."""

SAME = 0.5
"""Relative difference of the delay that is allowed between the two bands: true delays differ by some percent, effects
of friction by a factor of three to five (closed loop, light arms)."""

RISE = 0.1
"""Stribeck velocity of the model in the wider band [rad/s]: without that term, the rise of friction near rest could
look like a delay."""

DIGITS = 5
"""Decimals of a reported delay in seconds: a twentieth of a sample at 5 kHz."""

PADDING = 0.25
"""Padding of a run at its ends before it is shifted [s]."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports a delay if it explains the log; it is measured in a wider band if it is the strongest fault."""
    found = evidence.explained(CODE)
    sharp = _in_wider_band(evidence) if found and evidence.explanations[0].code == CODE else None
    if sharp is None:
        return found
    delay, deviation, _ = delay_of(sharp)
    first = evidence.explanations[0]
    text = f"{_delay_text(delay, deviation, first.gain, sharp.log.rate)} {evidence.trial_of(first)}"
    remedy = lines("s", delay=_total_delay(evidence, delay)).marked()
    return [replace(each, evidence=text, remedy=remedy) for each in found]


def _in_wider_band(evidence: LogEvidence) -> LogState | None:
    """The log in a wider band with a Stribeck term in the model; `None` where it is too short."""
    state, recording = evidence.state, evidence.recording
    assert state is not None and recording is not None  # it was compared with a model
    log = downsample(without_stuck(recording, evidence.stuck), SHARP)
    if not log.runs:
        return None
    names = {term.name for term in state.model.terms}
    added = () if Stribeck.name in names else (Stribeck(velocity=RISE, width=WIDTH),)
    model = DynamicsModel(state.model.robot, state.model.terms + added)
    return LogState(model, find_base_parameters(model), log)


def explain(state: LogState) -> Explanation | None:
    """Explanation by a delay; `None` if there is no significant one."""
    if state.log.band.is_open or not all(run.consecutive for run in state.log.runs):
        return None
    first = solve(state.rows, extra=state.torque_slope()[None])
    if state.fit.cost - first.cost < HINT:
        return None
    delay, deviation, after = delay_of(state)
    gain = state.fit.cost - after.fit.cost
    if gain < GAIN or abs(delay) < SURE * deviation or gain < SHARE * (state.fit.cost - _friction_alone(state)):
        return None
    return Explanation(
        CODE,
        gain,
        "error",
        "effort",
        _delay_text(delay, deviation, gain, state.log.rate),
        lambda evidence: lines("s", delay=_total_delay(evidence, delay)),
        after,
        lambda evidence: _is_in_every_band(evidence, delay),
        by_error_alone=True,
    )


def _is_in_every_band(evidence: LogEvidence, delay: float) -> bool:
    """True if the delay is the same in a wider band; that of presliding friction is not."""
    sharp = _in_wider_band(evidence)
    return sharp is None or abs(delay_of(sharp)[0] - delay) < SAME * abs(delay)


def _delay_text(delay: float, deviation: float, gain: float, rate: float) -> str:
    """Sentence on the delay."""
    word = "lags behind" if delay > 0 else "runs ahead of"
    return (
        f"Torque {word} the positions by {1e3 * abs(delay):.2f} ± {1e3 * deviation:.2f} ms "
        f"({abs(delay) * rate:.1f} samples); without the delay the residual is {1 - np.exp(-gain):.0%} smaller."
    )


def _total_delay(evidence: LogEvidence, delay: float) -> float | list[float]:
    """Value of the key `delay`: the delay added to those of the log format, one number where all are equal [s]."""
    whole = [round(float(d) + delay, DIGITS) for d in np.asarray(evidence.reading.delay)]
    return whole[0] if len(set(whole)) == 1 else whole


def delay_of(state: LogState) -> tuple[float, float, LogState]:
    """Estimates the delay of the torque against the positions [s], its standard deviation, and the corrected log.

    The derivative is that of the model's torque: noise in the derivative of the measured torque would bias each step
    towards zero.
    """
    delay, deviation = 0.0, np.inf
    for _ in range(STEPS):
        rows = state.rows
        fit = solve(rows, extra=_slopes(rows, rows.torque - state.fit.residual)[None])
        late, deviation = -float(fit.values[-1]), float(fit.deviation[-1])
        delay += late
        runs = tuple(_advanced(run, late) for run in state.log.runs)
        state = state.on(replace(state.log, runs=runs))
        if abs(late) < SETTLED * deviation:
            break
    return delay, deviation, state


def _slopes(rows: QuickRows, values: Array) -> Array:
    """Derivative of values at the rows (M, ...), run by run [1/s]."""
    slopes = np.zeros_like(values)
    for run in np.unique(rows.run):
        inside = rows.run == run
        slopes[inside] = spline_slopes(np.arange(inside.sum()) / rows.rate, values[inside])
    return slopes


def _friction_alone(state: LogState) -> float:
    """Mean log residual when the dry friction of each joint may lag by itself.

    Stiction and backlash make friction lag without a delay of the log; gravity and inertial torques do not lag then.
    """
    rows = state.rows
    extra = np.zeros((rows.n, *rows.torque.shape))
    for j in range(rows.n):
        for symbol, column in zip(state.symbols(j), rows.columns[j], strict=True):
            if symbol == "FS":
                extra[j, :, j] = _slopes(rows, column)
    return solve(rows, extra=extra).cost


def _advanced(run: ObservedRun, seconds: float) -> ObservedRun:
    """The run with its torque advanced by some seconds, padded by odd reflection."""
    samples = seconds * run.rate
    pad = min(len(run.torque) - 1, int((PADDING + abs(seconds)) * run.rate) + 8)
    x: Array = run.torque
    before, behind = 2 * x[0] - x[pad:0:-1], 2 * x[-1] - x[-2 : -pad - 2 : -1]
    whole = np.concatenate([before, x, behind])
    line = np.linspace(0.0, 1.0, len(whole))[:, None]
    trend = whole[0] + (whole[-1] - whole[0]) * line  # makes the ends equal
    turn = np.exp(2j * np.pi * frequencies(len(whole)) * samples)[:, None]
    moved = (
        inverse(spectrum(whole - trend) * turn, len(whole)) + trend + (whole[-1] - whole[0]) * samples / len(whole)
    )
    return replace(run, torque=moved[pad : pad + len(x)])


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "channel-delay": "Torque and motion belong to different times, so inertia and viscous friction are mixed up.",
    },
    explain=explain,
)
