"""Torque that lags behind the positions, or runs ahead of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.doctor.downsample import downsample
from armid.doctor.evidence import WIDTH, LogEvidence
from armid.doctor.explanation import Explanation, LogState
from armid.doctor.quick_fit import QuickRows, solve
from armid.doctor.stuck_channels import without_stuck
from armid.errors import Finding
from armid.maths.spectrum import frequencies, inverse, spectrum
from armid.maths.spline import spline_slopes
from armid.measurement.observations import ObservedRun
from armid.measurement.remedy import lines
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.model.terms import Stribeck
from armid.values import Array

__all__ = ["check", "delay_of", "explain"]

CODE = "channel-delay"

GAIN = 0.1
"""Fall of the residual, as a logarithm, that a delay must bring: recorded arms have up to 0.04 for delays that
their friction only feigns, logs delayed by 10 ms and more 0.3 and more."""

HINT = 0.04
"""Fall that the torque's slope as one more column must bring for a delay to be looked for at all:
it finds half of what the delay itself does, and more."""

SHARE = 0.98
"""What one delay of everything must explain of what lags of each joint's friction alone explain: on recorded arms,
whose friction only feigns a delay, it is two thirds and less, on a light arm with much friction that gives way before
it slides 0.96; of a true delay of 10 ms, with motion so slow that friction is most of what moves, the whole."""

SURE = 6.0
"""Standard deviations by which a delay must differ from none."""

STEPS, SETTLED = 8, 0.1
"""Rounds of shifting the torque and estimating what is left, and the share of a deviation that ends them."""

SHARP = 15.0
"""Band in which a delay is measured once it is known that there is one [Hz]: reversals of friction say the more of it
the wider the band, up to where noise of the positions takes over."""

SAME = 0.5
"""Share of a delay by which it may differ between the two bands: true ones do by some percent, and what friction
feigns by three to five times, in closed loop on light arms."""

RISE = 0.1
"""Speed from which on friction is what it is in motion [rad/s]: what friction has more near rest must not look like
a delay where friction is most of the torque."""

DIGITS = 5
"""Decimals of a delay that is told [s]: a twentieth of a sample at 5 kHz."""

PADDING = 0.25
"""Seconds that a run is continued by at its ends before it is shifted."""


def check(evidence: LogEvidence) -> list[Finding]:
    """The finding, if a delay explains the log; measured in a wider band where nothing else is wrong with it."""
    found = evidence.explained(CODE)
    sharp = _sharper(evidence) if found and evidence.explanations[0].code == CODE else None
    if sharp is None:
        return found
    delay, deviation, _ = delay_of(sharp)
    told = _told(delay, deviation, evidence.explanations[0].gain, sharp.log.rate)
    trial = found[0].evidence[len(evidence.explanations[0].evidence) :]
    return [
        replace(each, evidence=told + trial, remedy=lines("s", delay=_besides(evidence, delay))) for each in found
    ]


def _sharper(evidence: LogEvidence) -> LogState | None:
    """The log in a wider band, beside a model whose friction may rise near rest; `None` where it is too short."""
    state, recording = evidence.state, evidence.recording
    assert state is not None and recording is not None  # it was compared with a model
    log = downsample(without_stuck(recording, evidence.stuck), SHARP)
    if not log.runs:
        return None
    names = {term.name for term in state.model.terms}
    more = () if Stribeck.name in names else (Stribeck(velocity=RISE, width=WIDTH),)
    model = DynamicsModel(state.model.robot, state.model.terms + more)
    return LogState(model, find_base_parameters(model), log)


def explain(state: LogState) -> Explanation | None:
    """The delay that explains the log, or `None` if there is none worth a word."""
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
        _told(delay, deviation, gain, state.log.rate),
        lambda evidence: lines("s", delay=_besides(evidence, delay)),
        after,
        lambda evidence: _is_in_every_band(evidence, delay),
    )


def _is_in_every_band(evidence: LogEvidence, delay: float) -> bool:
    """Tell whether a wider band has the same delay: friction that gives way before it slides lags by another one."""
    sharp = _sharper(evidence)
    return sharp is None or abs(delay_of(sharp)[0] - delay) < SAME * abs(delay)


def _told(delay: float, deviation: float, gain: float, rate: float) -> str:
    """The delay in words."""
    word = "lags behind" if delay > 0 else "runs ahead of"
    return (
        f"Torque {word} the positions by {1e3 * abs(delay):.2f} ± {1e3 * deviation:.2f} ms "
        f"({abs(delay) * rate:.1f} samples); without it {1 - np.exp(-gain):.0%} less of the torque is left."
    )


def _besides(evidence: LogEvidence, delay: float) -> float | list[float]:
    """The delay on top of those that the reading takes out already [s], one where all joints have the same."""
    whole = [round(float(d) + delay, DIGITS) for d in np.asarray(evidence.reading.delay)]
    return whole[0] if len(set(whole)) == 1 else whole


def delay_of(state: LogState) -> tuple[float, float, LogState]:
    """Delay of the torque against the positions that fits best [s], its deviation, and the log without it.

    The slope that a delay is seen by is the model's: that of the measured torque has its noise, too, by which every
    round finds less than there is.
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
    """Return what is left when each joint's dry friction may lag by itself, and nothing else does.

    Where a joint sticks or its gear has slack, friction does so; that is no delay of the log, and weights and
    inertias do not take part in it.
    """
    rows = state.rows
    extra = np.zeros((rows.n, *rows.torque.shape))
    for j in range(rows.n):
        for symbol, column in zip(state.symbols(j), rows.columns[j], strict=True):
            if symbol == "FS":
                extra[j, :, j] = _slopes(rows, column)
    return solve(rows, extra=extra).cost


def _advanced(run: ObservedRun, seconds: float) -> ObservedRun:
    """The run with its torque so much earlier, its ends continued by odd reflection."""
    samples = seconds * run.rate
    pad = min(len(run.torque) - 1, int((PADDING + abs(seconds)) * run.rate) + 8)
    x: Array = run.torque
    before, behind = 2 * x[0] - x[pad:0:-1], 2 * x[-1] - x[-2 : -pad - 2 : -1]
    whole = np.concatenate([before, x, behind])
    line = np.linspace(0.0, 1.0, len(whole))[:, None]
    trend = whole[0] + (whole[-1] - whole[0]) * line  # its ends meet then
    turn = np.exp(2j * np.pi * frequencies(len(whole)) * samples)[:, None]
    moved = (
        inverse(spectrum(whole - trend) * turn, len(whole)) + trend + (whole[-1] - whole[0]) * samples / len(whole)
    )
    return replace(run, torque=moved[pad : pad + len(x)])
