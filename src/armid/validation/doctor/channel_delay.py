"""Torque that lags behind the positions, or runs ahead of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.errors import Finding
from armid.information.observations import ObservedRun
from armid.maths.spectrum import frequencies, inverse, spectrum
from armid.maths.spline import spline_slopes
from armid.measurement.remedy import lines
from armid.validation.doctor.evidence import Evidence
from armid.validation.doctor.rows import solve
from armid.validation.doctor.state import Explanation, State
from armid.values import Array

__all__ = ["check", "delay_of", "explain"]

CODE = "channel-delay"

GAIN = 0.1
"""Fall of the residual, as a logarithm, that a delay must bring: recorded arms have up to 0.04 for delays that
their friction only feigns, logs delayed by 10 ms and more 0.3 and more."""

HINT = 0.04
"""Fall that the torque's slope as one more column must bring for a delay to be looked for at all:
it finds half of what the delay itself does, and more."""

SHARE = 0.9
"""What one delay of everything must explain of what lags of each joint's friction alone explain: on recorded arms,
whose friction only feigns a delay, it is two thirds and less; of a true delay of 10 ms, with motion so slow that
friction is most of what moves, the whole."""

SURE = 6.0
"""Standard deviations by which a delay must differ from none."""

STEPS = 4
"""Rounds of shifting the torque and estimating what is left; two are enough for what one round finds."""

DIGITS = 5
"""Decimals of a delay that is told [s]: a twentieth of a sample at 5 kHz."""

PADDING = 0.25
"""Seconds that a run is continued by at its ends before it is shifted."""


def check(evidence: Evidence) -> list[Finding]:
    """The finding, if a delay explains the log."""
    return evidence.explained(CODE)


def explain(state: State) -> Explanation | None:
    """The delay that explains the log, or `None` if there is none worth a word."""
    if state.log.band.is_open:
        return None
    first = solve(state.rows, extra=state.rows.slope[None])
    if state.fit.cost - first.cost < HINT:
        return None
    delay, deviation, after = delay_of(state)
    gain = state.fit.cost - after.fit.cost
    if gain < GAIN or abs(delay) < SURE * deviation or gain < SHARE * (state.fit.cost - _friction_alone(state)):
        return None
    word = "lags behind" if delay > 0 else "runs ahead of"
    return Explanation(
        CODE,
        gain,
        "error",
        "effort",
        f"Torque {word} the positions by {1e3 * abs(delay):.2f} ± {1e3 * deviation:.2f} ms "
        f"({abs(delay) * state.log.rate:.1f} samples); without it {1 - np.exp(-gain):.0%} less of the torque is "
        "left.",
        lambda evidence: lines("s", delay=_besides(evidence, delay)),
        after,
    )


def _besides(evidence: Evidence, delay: float) -> float | list[float]:
    """The delay on top of those that the reading takes out already [s], one where all joints have the same."""
    whole = [round(float(d) + delay, DIGITS) for d in np.asarray(evidence.reading.delay)]
    return whole[0] if len(set(whole)) == 1 else whole


def delay_of(state: State) -> tuple[float, float, State]:
    """Delay of the torque against the positions that fits best [s], its deviation, and the log without it."""
    delay, deviation = 0.0, np.inf
    for _ in range(STEPS):
        fit = solve(state.rows, extra=state.rows.slope[None])
        late, deviation = -float(fit.values[-1]), float(fit.deviation[-1])
        delay += late
        runs = tuple(_advanced(run, late) for run in state.log.runs)
        state = state.on(replace(state.log, runs=runs))
        if abs(late) < 0.2 * deviation:
            break
    return delay, deviation, state


def _friction_alone(state: State) -> float:
    """What is left when each joint's dry friction may lag by itself, and nothing else does.

    Where a joint sticks or its gear has slack, friction does so; that is no delay of the log, and weights and
    inertias do not take part in it.
    """
    rows = state.rows
    extra = np.zeros((rows.n, *rows.torque.shape))
    for j in range(rows.n):
        for symbol, column in zip(state.symbols(j), rows.columns[j], strict=True):
            if symbol != "FS":
                continue
            for run in np.unique(rows.run):
                inside = rows.run == run
                time = np.arange(inside.sum()) / rows.rate
                extra[j, inside, j] = spline_slopes(time, column[inside])
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
