"""Explanation of a misfit by a torque of one joint that is late, while positions and other torques are in time.

The torque of one joint is moved in time, and one model is fitted to all joints. Rows near reversals of the joints are
left out, because friction at reversals looks like a delay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import cost_of, products
from armid.doctor.remedy_trial import HELPS, try_remedy
from armid.doctor.rows_away_from_reversals import judged_away_from_reversals
from armid.information.filtering import rows_in_band
from armid.measurement.remedy_builders import lines

FIRST = 0.05
"""Delay, and lead, that is tried for each joint [s]; the longer ones are tried in the better direction only."""

LONGER = (0.1, 0.15, 0.2, 0.3)
"""Longer delays that are tried [s]."""

HINT = 0.02
"""Smallest decrease of the mean logarithm of the RMS residuals by the first delay for which longer ones are tried."""

GAIN = 0.09
"""Smallest decrease of the mean logarithm of the RMS residuals. Without a delay it is at most 0.081 on 16
recordings of eight arms; with a delay of 0.2 s of a joint that carries others it is 0.11 to 0.42."""

SURE = 6.0
"""Smallest number of standard deviations by which the delay must differ from zero."""

STEP = 0.02
"""Distance of the delays of the parabola with which the best delay is refined [s]."""

LEAST = 0.02
"""Shortest delay that is reported [s]; friction that the model lacks looks like shorter ones."""

DIGITS = 3
"""Decimals of a delay in a study [s]."""


@dataclass(frozen=True, slots=True)
class TorqueDelay:
    """Delay of the torque of one joint.

    Attributes:
        joint: Index of the joint.
        seconds: Delay, negative for a lead [s].
        deviation: Standard deviation of the delay [s].
        gain: Decrease of the mean logarithm of the RMS residuals when the delay is removed.
    """

    joint: int
    seconds: float
    deviation: float
    gain: float


def explain(code: str, state: LogState) -> Explanation | None:
    """Explains the misfit of the model by a delay of the torque of one joint; `None` if there is no such delay.

    Args:
        code: Code of the finding.
        state: The log.
    """
    if state.rows.n < 2 or state.log.band.is_open or not all(run.consecutive for run in state.log.runs):
        return None
    judged = judged_away_from_reversals(state)[0]
    cost = _cost_with_delay(judged)
    found = [each for j in range(state.rows.n) if (each := _delay(judged, cost, j)) is not None]
    if not found:
        return None
    best = max(found, key=lambda each: each.gain)
    name = state.model.robot.joint_names[best.joint]
    word = "late" if best.seconds > 0.0 else "early"
    return Explanation(
        code,
        best.gain,
        "error",
        name,
        f"The torque of {name} is {word} by {1e3 * abs(best.seconds):.0f} ± {1e3 * best.deviation:.0f} ms against "
        f"the positions and the other torques; with this delay removed, the residual away from reversals is "
        f"{1 - np.exp(-best.gain):.0%} smaller.",
        lambda evidence: lines("s", delay=_delays(evidence, best)),
        _advanced(state, best.joint, best.seconds),
        worse=HELPS,
        trial=try_remedy(judged.rows, _advanced(judged, best.joint, best.seconds).rows),
    )


def _delay(judged: LogState, cost: Callable[[int, float], float], j: int) -> TorqueDelay | None:
    """Delay of the torque of joint j with the smallest cost; `None` if it is not significant."""
    begin = cost(j, 0.0)
    costs = {seconds: cost(j, seconds) for seconds in (FIRST, -FIRST)}
    side = min(costs, key=lambda seconds: costs[seconds])
    if begin - costs[side] < HINT:
        return None
    costs |= {float(np.sign(side)) * seconds: cost(j, float(np.sign(side)) * seconds) for seconds in LONGER}
    near = min(costs, key=lambda seconds: costs[seconds])
    below, middle, above = (cost(j, near + step) for step in (-STEP, 0.0, STEP))
    bend = (below - 2.0 * middle + above) / STEP**2
    if bend <= 0.0:
        return None
    best = near + float(np.clip((below - above) / (2.0 * STEP * bend), -2.0 * STEP, 2.0 * STEP))
    gain = begin - cost(j, best)
    independent = float(np.sum(judged.rows.mask.sum(axis=0) / judged.fit.autocorrelation))
    deviation = 1.0 / np.sqrt(independent * bend)
    if gain < GAIN or abs(best) < max(LEAST, SURE * deviation):
        return None
    return TorqueDelay(j, best, deviation, gain)


def _cost_with_delay(judged: LogState) -> Callable[[int, float], float]:
    """Function of a joint and a delay [s]: mean logarithm of the RMS residuals with this delay removed."""
    rows, pairs = judged.rows, list(products(judged.rows))
    moved: dict[float, Array] = {}

    def cost(j: int, seconds: float) -> float:
        if seconds not in moved:
            moved[seconds] = _moved(judged, seconds)
        torque = moved[seconds][:, j] * rows.mask[:, j]
        own = pairs[j].copy()
        own[-1, :-1] = own[:-1, -1] = rows.columns[j] @ torque
        own[-1, -1] = torque @ torque
        return cost_of(rows, [*pairs[:j], own, *pairs[j + 1 :]])

    return cost


def _moved(state: LogState, seconds: float) -> Array:
    """Filtered torque at the rows, moved to earlier times by some seconds, shape (M, n) [N·m or N]."""
    band, runs = state.log.band, state.log.runs
    return np.concatenate([rows_in_band(run, _earlier(run.motion.time, run.torque, seconds), band) for run in runs])


def _earlier(time: Array, torque: Array, seconds: float) -> Array:
    """Torques (N, k) moved to earlier times by some seconds; the first or last sample is repeated at the ends."""
    return np.column_stack([np.interp(time + seconds, time, column) for column in torque.T])


def _advanced(state: LogState, j: int, seconds: float) -> LogState:
    """The log with the torque of joint j moved to earlier times; the regressor columns are reused."""
    runs = []
    for run in state.log.runs:
        torque = run.torque.copy()
        torque[:, [j]] = _earlier(run.motion.time, torque[:, [j]], seconds)
        runs.append(replace(run, torque=torque))
    after = state.on(replace(state.log, runs=tuple(runs)))
    torque = state.rows.torque.copy()
    torque[:, j] = _moved(state, seconds)[:, j]
    after.__dict__["rows"] = replace(state.rows, torque=torque)
    return after


def _delays(evidence: LogEvidence, found: TorqueDelay) -> list[float]:
    """Value of the key `delay` [s]: the delays of the log format, of which one is changed."""
    delays = np.broadcast_to(np.asarray(evidence.reading.delay, dtype=np.float64), evidence.robot.n).copy()
    delays[found.joint] += found.seconds
    return [round(float(each), DIGITS) for each in delays]
