"""Check for a delay of the positions, or of the torque, of one joint.

The delay of positions is estimated from the torque of the other joints. This torque depends on the position of the
joint through gravity, inertia and Coriolis terms, but not on the friction of the joint, whose stiction can look
like a delay of many milliseconds. The positions of all other joints are assumed to have no delay. A delay can
therefore also be found for a joint with a vertical axis, on which gravity causes no torque.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid import kernel
from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import RIDGE, products, solve
from armid.doctor.remedy_trial import HELPS, try_remedy
from armid.doctor.residuals import late_torque
from armid.doctor.rows_away_from_reversals import judged_away_from_reversals
from armid.errors import Finding
from armid.information.filtering import rows_in_band
from armid.maths.birge_ratio import birge_ratio
from armid.measurement.observations import ObservedRun
from armid.measurement.recording import Recording

CODE = "joint-delay"

STEP = 2e-3
"""Time by which positions are shifted for a finite difference of the torque [s]."""

SURE = 6.0
"""Number of standard deviations by which a delay must differ from zero. Friction that the model lacks gave up to 8,
at a delay shorter than `LEAST` that hardly lowered the residual."""

LEAST = 8e-3
"""Shortest delay of one joint that is reported [s]."""

LONGEST = 0.25
"""Longest delay that is accepted [s]; with a longer one, the channel probably belongs to another motion."""

GAIN = 0.03
"""Smallest decrease of the mean logarithm of the RMS residuals away from reversals, as for another order of
channels."""

SIGNIFICANT = 20.0
"""Smallest log-likelihood ratio of the models with and without the delay, for the number of independent rows."""

AGREED = 0.4
"""Largest conflict between the joints after the correction. If a delay is the fault, the conflict was at most 0.28;
if another fault, such as torque without gravity, only looks like a delay, it was 0.5 or more."""

CERTAIN = 2.0
"""Number of standard deviations by which a delay must differ from zero if the standard deviation contains the
disagreement of the other joints."""

STEPS, SETTLED = 4, 0.3
"""Largest number of Gauss-Newton steps, and size of a step, in standard deviations, below which the iteration
ends."""

FEWEST_ROWS = 20
"""Smallest number of rows without a gap in which positions are compared with the integral of velocities."""

HINT = 0.01
"""Smallest decrease of the mean logarithm of the RMS residuals, to first order, for which a delay is refined."""

LOOKED_AT = 2
"""Number of joints whose delay is refined."""

RESOLVED = 0.4
"""Smallest decrease of the conflict, relative to that of the mean logarithm of the RMS residuals, with which a larger
conflict than `AGREED` may remain: a real arm whose joints disagree by 0.7 in a sound log did so with 1.05 while the
positions of one joint were late, and the correction lowered the residual by 0.6."""

SAME = 0.5
"""Largest relative difference of the delay if the torque of every joint has a separate delay. For late positions of
one joint, the difference was up to 0.2; a delay of all torques can look like one of a single joint, and then it was
0.8 or more."""


@dataclass(frozen=True, slots=True, eq=False)
class JointDelay:
    """Estimated delay of the positions of one joint.

    Attributes:
        joint: Index of the joint.
        seconds: Delay [s].
        deviation: Standard deviation of the delay [s], enlarged if the torques of the other joints show different
            delays.
        gain: Decrease of the mean logarithm of the RMS residuals when the delay is removed.
        after: The log in which the delay is removed.
    """

    joint: int
    seconds: float
    deviation: float
    gain: float
    after: LogState


@dataclass(frozen=True, slots=True, eq=False)
class DelayableLog:
    """A log, with the derivatives of its torques by delays of positions and of torques.

    Attributes:
        state: The log.
        late_positions: Element (j, m, k) is the derivative of the torque of joint k in row m by the delay of the
            positions of joint j, shape (n, M, n) [N·m/s]; zero for j = k.
        late_torques: Element (j, m, j) is the time derivative of the torque of joint j in row m, shape (n, M, n)
            [N·m/s]; zero for other joints.
    """

    state: LogState
    late_positions: Array
    late_torques: Array


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports a joint whose positions or torque are late or early, if the model fits better with them corrected."""
    return evidence.explained(CODE)


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a delay of the positions, or of the torque, of one joint.

    The result is `None` if no joint has such a delay.
    """
    found = [each for each in (_late_positions(state), late_torque.explain(CODE, state)) if each is not None]
    return max(found, key=lambda each: each.gain, default=None)


def _late_positions(state: LogState) -> Explanation | None:
    """Explains the misfit by a delay of the positions of one joint; `None` if no joint has such a delay."""
    if state.rows.n < 2 or state.log.band.is_open or not all(run.consecutive for run in state.log.runs):
        return None
    away, moving = judged_away_from_reversals(state)
    if not moving.any():
        return None
    judged = _delayable(away)
    gains = _first_order_gains(judged)
    likely = [int(j) for j in np.argsort(-gains)[:LOOKED_AT] if gains[j] > HINT]
    found = [each for j in likely if (each := _refined(judged, j)) is not None]
    if not found:
        return None
    best = max(found, key=lambda each: each.gain)
    name, delay = state.model.robot.joint_names[best.joint], best.seconds
    word = "late" if delay > 0.0 else "early"
    return Explanation(
        CODE,
        best.gain,  # on the rows on which the delay of all torques is judged, too
        "error",
        name,
        f"The torques of the other joints show that the positions of {name} are {word} by {1e3 * abs(delay):.0f} ± "
        f"{1e3 * best.deviation:.1f} ms; with this delay removed, the residual away from reversals is "
        f"{1 - np.exp(-best.gain):.0%} smaller.",
        lambda evidence: _remedy(evidence, best.joint, delay),
        _moved(state, best.joint, delay),
        worse=HELPS,
        trial=try_remedy(away.rows, best.after.rows),
    )


def _remedy(evidence: LogEvidence, j: int, delay: float) -> str:
    """Remedy by hand: rewrite the log without the delay of joint j [s].

    Logged velocities are moved only if they are late.
    """
    log, name = evidence.recording, evidence.robot.joint_names[j]
    behind = 0.0 if log is None else behind_velocities(log, j, evidence.rate)
    channels = "positions" if abs(behind - delay) < SAME * abs(delay) else "positions and velocities"
    back = "earlier" if delay > 0.0 else "later"
    return f"rewrite the log with the {channels} of {name} {abs(delay):.3f} s {back}"


def behind_velocities(log: Recording, j: int, rate: float) -> float:
    """Time by which the logged positions of joint j lag behind its velocities [s]; 0 if velocities are not logged.

    Positions are compared with the integral of the velocities, separately for each segment of rows without a gap.
    """
    if log.dq is None:
        return 0.0
    q, dq = log.q[:, j], log.dq[:, j]
    counted = np.isfinite(q) & np.isfinite(dq)
    steps = np.ones(len(q) - 1) if log.time is None else np.diff(log.time) * rate
    joined = counted[1:] & counted[:-1] & (np.abs(steps - 1.0) < 0.5)
    travelled = np.cumsum(np.where(joined, 0.5 * (dq[1:] + dq[:-1]), 0.0)) / rate
    ahead, moved = q - np.append(0.0, travelled), 0.0
    spread = 0.0
    for rows in np.split(np.arange(len(q)), np.flatnonzero(~joined) + 1):
        if len(rows) > FEWEST_ROWS:
            drift = np.column_stack([np.ones(len(rows)), np.linspace(0.0, 1.0, len(rows))])
            both = np.column_stack([ahead[rows], dq[rows]])
            y, x = (both - drift @ np.linalg.lstsq(drift, both, rcond=None)[0]).T
            moved, spread = moved + float(x @ y), spread + float(x @ x)
    return -moved / spread if spread > 0.0 else 0.0


def _first_order_gains(judged: DelayableLog) -> Array:
    """First-order decrease of the logarithm of the RMS residual if the positions of joint j are late, shape (n,).

    A delay of the torque of the same joint is fitted in both cases, with and without late positions, so that the
    friction of this joint has no effect.
    """
    state, late, own = judged.state, judged.late_positions, judged.late_torques
    rows, n, b = state.rows, state.rows.n, state.rows.count
    total = np.zeros((b + 2 * n + 1, b + 2 * n + 1))
    for j, pairs in enumerate(products(rows, np.concatenate([late, own]))):
        columns = np.concatenate([rows.parameters[j], np.arange(b, len(total))])
        total[np.ix_(columns, columns)] += pairs / state.fit.sigma[j] ** 2
    size = np.sqrt(total.diagonal())
    total /= np.outer(np.where(size > 0.0, size, 1.0), np.where(size > 0.0, size, 1.0))
    left = _without(total, np.arange(b))[b:, b:]
    gains = np.zeros(n)
    for j in range(n):
        before = _without(left, np.array([n + j]))[-1, -1]
        after = _without(left, np.array([j, n + j]))[-1, -1]
        gains[j] = 0.5 * np.log(before / after) if min(before, after) > 0.0 else 0.0
    return gains


def _without(products_of_columns: Array, columns: NDArray[np.int_]) -> Array:
    """Scalar products of regressor columns, after some of the columns are projected out of all columns."""
    G = products_of_columns
    inner = G[np.ix_(columns, columns)] + RIDGE * np.eye(len(columns))
    return G - G[:, columns] @ np.linalg.solve(inner, G[columns])


def _refined(judged: DelayableLog, j: int) -> JointDelay | None:
    """Delay of the positions of joint j, refined in several steps.

    The result is `None` if the delay is not significant or looks like another fault.
    """
    state, total, now = judged.state, 0.0, judged
    delay, deviation = _delay_of(judged, j, each_torque=False)
    common, spread = _delay_of(judged, j, each_torque=True)
    if abs(common - delay) > SAME * abs(delay) or abs(common) < SURE * spread:
        return None
    for _ in range(STEPS):
        if abs(total + delay) < SURE * deviation or abs(total + delay) > LONGEST:
            return None
        total += delay
        now = _delayable(_moved(state, j, total))
        delay, deviation = _delay_of(now, j, each_torque=False)
        if abs(delay) < SETTLED * deviation:
            break
    after = now.state
    gain = state.fit.cost - after.fit.cost
    evidence = gain * float(np.sum(state.rows.mask.sum(axis=0) / state.fit.autocorrelation))
    if abs(total) < max(LEAST, SURE * deviation) or gain < GAIN or evidence < SIGNIFICANT:
        return None
    if after.conflict > AGREED and state.conflict - after.conflict < RESOLVED * gain:
        return None
    deviation *= _disagreement(now, j)
    return JointDelay(j, total, deviation, gain, after) if abs(total) > CERTAIN * deviation else None


def _delay_of(log: DelayableLog, j: int, *, each_torque: bool) -> tuple[float, float]:
    """Delay of the positions of joint j and its standard deviation [s], from the torques of the other joints.

    Args:
        log: The log, with the derivatives of its torques by delays.
        j: Index of the joint.
        each_torque: True to estimate delays of the torques of all joints as well, false to estimate only that of the
            torque of joint j.
    """
    rows, own = log.state.rows, log.late_torques
    fit = solve(rows, extra=np.concatenate([log.late_positions[[j]], own if each_torque else own[[j]]]))
    return float(fit.values[rows.count]), float(fit.deviation[rows.count])


def _disagreement(log: DelayableLog, j: int) -> float:
    """Birge ratio of the delays of the positions of joint j that the torques of the other joints give one by one."""
    rows, late = log.state.rows, log.late_positions[j]
    n, b = rows.n, rows.count
    others = [k for k in range(n) if k != j]
    apart = np.zeros((len(others), *late.shape))
    for row, k in enumerate(others):
        apart[row, :, k] = late[:, k]
    fit = solve(rows, extra=np.concatenate([apart, log.late_torques[[j]]]))
    return birge_ratio(fit.values[b:-1], fit.deviation[b:-1])


def _delayable(state: LogState) -> DelayableLog:
    """Computes the derivatives of the torques of a log by delays of positions and of torques."""
    late, across = _slopes(state), np.arange(state.rows.n)
    late[across, :, across] = 0.0
    own = np.zeros_like(late)
    own[across, :, across] = state.torque_slope().T
    return DelayableLog(state, late, own)


def _moved(state: LogState, j: int, seconds: float) -> LogState:
    """The log with the motion of joint j moved to earlier times by some seconds, which corrects a delay."""

    def changed(run: ObservedRun) -> ObservedRun:
        m, later = run.motion, run.motion.time + seconds
        q, dq, ddq = m.q.copy(), m.dq.copy(), m.ddq.copy()
        for x in (q, dq, ddq):
            x[:, j] = np.interp(later, m.time, x[:, j])
        return replace(run, motion=replace(m, q=q, dq=dq, ddq=ddq))

    return state.on(replace(state.log, runs=tuple(changed(run) for run in state.log.runs)))


def _slopes(state: LogState) -> Array:
    """Derivative of the filtered torque of the links by a time shift of each joint's positions, (n, M, n) [N·m/s]."""
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
        parts.append(rows_in_band(run, change / (2.0 * STEP), state.log.band))
    return np.moveaxis(np.concatenate(parts), 1, 0).copy()


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "joint-delay": "Torques are fitted at wrong poses, those of all joints if positions are late, so inertias "
        "and first moments are biased.",
    },
    explain=explain,
    follows=("channel-dead", "velocity-mismatch"),
)
