"""Delay of the positions of one joint.

The torque of the other joints decides: it depends on the position of the joint through weight, inertia and Coriolis
terms, and not on the friction of the joint, whose stiction can look like a delay of many milliseconds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.log_state import LogState
from armid.doctor.quick_fit import solve
from armid.doctor.remedy_trial import try_remedy
from armid.doctor.rows_away_from_reversals import away_from_reversals
from armid.errors import Finding
from armid.information.filtering import in_band
from armid.measurement.observations import ObservedRun
from armid.model.motion import Motion

CODE = "joint-delay"

STEP = 2e-3
"""Time by which positions are moved for a finite difference of the torque [s]."""

SURE = 6.0
"""Number of standard deviations by which a delay must differ from zero. On sound logs it was up to 5."""

LEAST = 8e-3
"""Shortest delay of one joint that is reported [s]."""

LONGEST = 0.25
"""Longest delay that is a delay and not another motion [s]."""

GAIN = 0.03
"""Smallest decrease of the mean logarithm of the RMS residuals away from reversals, as for another order of
channels."""

SIGNIFICANT = 20.0
"""Smallest log-likelihood ratio of the models with and without the delay, for the number of independent rows."""

AGREED = 0.4
"""Largest conflict between the joints after the correction. If a delay is the fault, the conflict was at most 0.28;
if another fault, such as torque without gravity, only looks like a delay, it was 0.5 or more."""

STEPS, SETTLED = 4, 0.3
"""Largest number of Gauss-Newton steps, and size of a step, in standard deviations, below which the iteration
ends."""

LOOKED_AT = 2
"""Number of joints whose delay is refined."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports the joint whose positions are late if this explains the log."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """Explanation by late positions of one joint; `None` if there are none."""
    if state.rows.n < 2 or state.log.band.is_open or not all(run.consecutive for run in state.log.runs):
        return None
    judged = away_from_reversals(state)
    if not judged.rows.mask.any():
        return None
    found = [_refined(judged, int(j)) for j in np.argsort(-_certainty(*delays_of(judged)))[:LOOKED_AT]]
    best = max((each for each in found if each is not None), key=lambda each: each[2], default=None)
    if best is None:
        return None
    j, delay, gain, deviation = best
    name = state.model.robot.joint_names[j]
    after, judged_after = _moved(state, j, delay), _moved(judged, j, delay)
    word, back = ("late", "earlier") if delay > 0.0 else ("early", "later")
    return Explanation(
        CODE,
        max(state.fit.cost - after.fit.cost, 0.0),
        "error",
        name,
        f"The torques of the other joints say that the positions of {name} are {word} by {1e3 * abs(delay):.0f} ± "
        f"{1e3 * deviation:.1f} ms; with this removed, the residual away from reversals is {1 - np.exp(-gain):.0%} "
        "smaller.",
        lambda _: f"rewrite the log with the positions and velocities of {name} {abs(delay):.3f} s {back}",
        after,
        by_error_alone=True,
        trial=try_remedy(judged.rows, judged_after.rows),
    )


def delays_of(state: LogState) -> tuple[Array, Array]:
    """Delay of the positions of each joint by the torques of the others, and standard deviations, shape (n,) [s].

    A separate delay of the torque of each joint is estimated at the same time, so that friction has no effect.
    """
    n, across = state.rows.n, np.arange(state.rows.n)
    coupled, own = _slopes(state), np.zeros((state.rows.n, *state.rows.torque.shape))
    coupled[across, :, across] = 0.0
    own[across, :, across] = state.torque_slope().T
    fit = solve(state.rows, extra=np.concatenate([coupled, own]))
    return fit.values[-2 * n : -n], fit.deviation[-2 * n : -n]


def _certainty(delay: Array, deviation: Array) -> Array:
    """Delays divided by their standard deviations, zero where unknown."""
    return np.where(deviation > 0.0, np.abs(delay) / np.where(deviation > 0.0, deviation, 1.0), 0.0)


def _refined(state: LogState, j: int) -> tuple[int, float, float, float] | None:
    """Joint, its delay [s], decrease of `QuickFit.cost` and deviation [s]; `None` if it is not significant."""
    total, now = 0.0, state
    delay, deviation = delays_of(state)
    for _ in range(STEPS):
        if _certainty(total + delay, deviation)[j] < SURE or abs(total + delay[j]) > LONGEST:
            return None
        total += float(delay[j])
        now = _moved(state, j, total)
        delay, deviation = delays_of(now)
        if abs(delay[j]) < SETTLED * deviation[j]:
            break
    gain, spread = state.fit.cost - now.fit.cost, float(deviation[j])
    evidence = gain * float(np.sum(state.rows.mask.sum(axis=0) / state.fit.autocorrelation))
    if abs(total) < max(LEAST, SURE * spread) or gain < GAIN or evidence < SIGNIFICANT:
        return None
    if now.conflict > AGREED:
        return None
    return j, total, gain, spread


def _moved(state: LogState, j: int, seconds: float) -> LogState:
    """The log with the positions of a joint taken from samples some seconds later, which corrects this delay."""

    def changed(run: ObservedRun) -> ObservedRun:
        m, later = run.motion, run.motion.time + seconds
        q, dq, ddq = m.q.copy(), m.dq.copy(), m.ddq.copy()
        for x in (q, dq, ddq):
            x[:, j] = np.interp(later, m.time, x[:, j])
        return replace(run, motion=Motion(m.time, q, dq, ddq))

    return state.on(replace(state.log, runs=tuple(changed(run) for run in state.log.runs)))


def _slopes(state: LogState) -> Array:
    """Derivative of the links' filtered torque by the delay of each joint's positions, shape (n, M, n) [N·m/s]."""
    bodies = state.standard(state.fit.values)[state.model.inertial_columns].reshape(-1, 10)
    n = state.rows.n
    parts: list[Array] = []
    for run in state.log.runs:
        m = run.motion
        jerk = np.gradient(m.ddq, 1.0 / run.rate, axis=0)
        change = np.zeros((len(m.q), n, n))
        for j in range(n):
            for sign in (1.0, -1.0):
                step = np.zeros(n)
                step[j] = sign * STEP
                moved = (m.q + step * m.dq, m.dq + step * m.ddq, m.ddq + step * jerk)
                change[:, j] += sign * kernel.inverse_dynamics(state.model.tree, bodies, *moved)
        parts.append(in_band(change / (2.0 * STEP), run.rate, state.log.band)[run.rows])
    return np.moveaxis(np.concatenate(parts), 1, 0).copy()


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "joint-delay": "Torques of all joints are fitted at wrong poses, so inertias and first moments are biased.",
    },
    explain=explain,
    follows=("channel-dead", "velocity-mismatch"),
)
