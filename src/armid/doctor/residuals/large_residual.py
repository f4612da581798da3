"""Joints whose residual is larger than what models of sound arms leave, and what these residuals follow.

What a model of links and simple friction leaves on a sound arm is a part of the friction, and a few percent of the
torque. A joint with a larger residual has a fault, also if no other check knows it. Its residual is then compared
with functions of all that the log contains: torques of other joints, and the products of {1, friction, torque} with
functions of the joint's angle, its velocity and the time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.changes.alternatives import weights_by_axis
from armid.doctor.check_input import WIDTH
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import QuickRows
from armid.doctor.remedy_trial import RemedyTrial, try_remedy
from armid.doctor.residuals.added_columns import AddedColumns
from armid.errors import Finding

CODE = "residual-large"
"""Code of the findings on residuals that follow nothing that is tried."""

USUAL = (0.75, 0.06)
"""Largest usual residual of a joint that carries weight, as shares of the RMS friction and of the standard deviation
of the torque. On recordings of eight arms it is at most 0.88 of their sum, in halves of them 0.9."""

USUAL_UNLOADED = (1.4, 0.08)
"""The shares that are used instead for a joint that carries no weight, such as a vertical first joint: on two
recorded arms, friction that no law describes is larger there than the friction of the model."""

LOADED = 0.1
"""Ratio of the weights at a joint to its torque, both standard deviations, from which the joint carries weight."""

NOISE = 3.0
"""Smallest ratio of the residual to the noise of the torque in the band of the log."""

COMMON = 3
"""Number of joints with a large residual from which the cause is one of the whole log, and no cause is sought in the
single joints: in half of such logs, one was found that was wrong."""

MEDIAN_OF_NORMAL = 0.6745
"""Median amount of a standard normal number."""

FOLLOWS = 0.4
"""Share of the squared residual from which the residual follows functions: share that they explain, minus the share
that as many functions explain of a residual of the same autocorrelation by chance."""

MODULATED = 0.15
"""Further share that a torque of another joint that changes with the angle must explain: many are tried."""

KNOTS, TIMES, WAVES = 8, 6, 2
"""Number of knots along the range of a joint and along the log, and of waves in a turn by which a gain may change."""

LAGS = (0.3, 3.0)
"""Time constants of the lags of a torque that are tried [s]."""

SPEEDS = (0.1, 0.3)
"""Speeds below which the joint counts as slow, relative to its largest one."""


@dataclass(frozen=True, slots=True, eq=False)
class ResidualCause:
    """Functions that the residual of a joint may follow.

    Attributes:
        code: Code of the finding.
        severity: Its severity.
        text: What the residual follows, in words.
        remedy: Remedy.
        columns: Values of the functions, shape (k, M).
        price: Share of the squared residual that the functions must explain beyond `FOLLOWS`.
    """

    code: str
    severity: Literal["warning"]
    text: str
    remedy: str
    columns: Array
    price: float = 0.0


def findings(state: LogState, left_out: NDArray[np.bool_]) -> list[Finding]:
    """Findings on joints with a large residual: one for each cause, and one for all residuals without a cause.

    Args:
        state: The log, in which all faults that were found are corrected.
        left_out: Mask of the joints that are not examined, shape (n,).
    """
    robot = state.model.robot
    large = np.flatnonzero(large_residuals(state) & ~left_out)
    found: list[Finding] = []
    unknown: list[int] = []
    for j in map(int, large):
        best = _best_cause(state, j) if len(large) < COMMON else None
        if best is None:
            unknown.append(j)
            continue
        cause, trial = best
        text = f"{_size(state, j)} It follows {cause.text}. {trial}"
        found.append(Finding(cause.code, cause.severity, robot.joint_names[j], text, cause.remedy))
    if unknown:
        text = f"{' '.join(_size(state, j) for j in unknown)} No cause was found."
        remedy = "find out what differs between the log and the arm, in the joint, its sensors or the logger"
        found.append(Finding(CODE, "warning", ", ".join(robot.joint_names[j] for j in unknown), text, remedy))
    return found


def large_residuals(state: LogState) -> NDArray[np.bool_]:
    """Mask of the joints whose residual is larger than what models of sound arms leave, shape (n,)."""
    size, friction, sigma = _deviation(state.rows), _friction(state), state.fit.sigma
    large = sigma > USUAL[0] * friction + USUAL[1] * size
    if not large.any():
        return large
    large &= sigma > NOISE * _noise(state)
    weight = np.tensordot(state.model.robot.gravity, weights_by_axis(state), 1)
    loaded = _deviation(replace(state.rows, torque=weight)) > LOADED * size
    return large & (loaded | (sigma > USUAL_UNLOADED[0] * friction + USUAL_UNLOADED[1] * size))


def _size(state: LogState, j: int) -> str:
    """Sentence on the size of the residual of joint j."""
    joint, sigma, friction = state.model.robot.joints[j], float(state.fit.sigma[j]), float(_friction(state)[j])
    unit = joint.effort_unit
    share = sigma / max(float(_deviation(state.rows)[j]), np.finfo(float).tiny)
    return (
        f"The RMS residual of {state.model.robot.joint_names[j]} is {sigma:.3g} {unit}, {share:.0%} of "
        f"the standard deviation of its torque, and the RMS friction of the model {friction:.3g} {unit}. "
        "On sound arms the residual is smaller."
    )


def _deviation(rows: QuickRows) -> Array:
    """Standard deviation of the torque of each joint, shape (n,)."""
    used = zip(rows.torque.T, rows.mask.T, strict=True)
    return np.array([float(np.std(torque[mask])) if mask.any() else 0.0 for torque, mask in used])


def _noise(state: LogState) -> Array:
    """Standard deviation of the white noise of each torque in the band of the log, shape (n,)."""
    run = max(state.log.runs, key=lambda each: each.motion.samples)
    second = np.abs(np.diff(run.torque, n=2, axis=0))
    whole = np.median(second, axis=0) / (MEDIAN_OF_NORMAL * np.sqrt(6.0))
    return np.asarray(whole * np.sqrt(min(1.0, 2.0 * state.log.cutoff / run.rate)))


def _friction(state: LogState) -> Array:
    """RMS friction of each joint in the model, shape (n,)."""
    rows, result = state.rows, np.zeros(state.rows.n)
    for j, own in enumerate(rows.parameters):
        part = np.array([symbol in ("FV", "FS") for symbol in state.symbols(j)])
        torque = state.fit.values[own[part]] @ rows.columns[j][part]
        result[j] = np.sqrt(np.mean(torque[rows.mask[:, j]] ** 2)) if rows.mask[:, j].any() else 0.0
    return result


def _best_cause(state: LogState, j: int) -> tuple[ResidualCause, RemedyTrial] | None:
    """Cause that explains most of the residual of joint j, with the test on left-out motion; `None` without one."""
    added, rows = AddedColumns(state), state.rows
    chance = float(state.fit.autocorrelation[j]) / max(int(rows.mask[:, j].sum()), 1)
    score = [
        (added.decrease_together(j, each.columns) - len(each.columns) * chance - each.price, k, each)
        for k, each in enumerate(_causes(state, j))
    ]
    share, _, best = max(score)
    if share < FOLLOWS:
        return None
    columns, parameters = list(rows.columns), list(rows.parameters)
    more = np.arange(rows.count, rows.count + len(best.columns), dtype=np.int32)
    columns[j], parameters[j] = np.vstack([columns[j], best.columns]), np.append(parameters[j], more)
    after = replace(rows, columns=tuple(columns), parameters=tuple(parameters), count=rows.count + len(more))
    trial = try_remedy(rows, after)
    return (best, trial) if trial.helps else None


def _causes(state: LogState, j: int) -> Iterator[ResidualCause]:
    """Everything that the residual of joint j is compared with."""
    rows, names = state.rows, state.model.robot.joint_names
    q, dq = rows.motion.q[:, j], rows.motion.dq[:, j]
    torque = np.where(rows.mask[:, j], rows.torque[:, j] - state.fit.residual[:, j], 0.0)
    sense, one = np.tanh(dq / WIDTH), np.ones_like(q)
    fastest = max(float(np.abs(dq).max()), np.finfo(float).tiny)
    angle, time = _knots(q, KNOTS), _knots(np.arange(len(q), dtype=np.float64), TIMES)
    slow = np.stack([np.exp(-((dq / (fastest * speed)) ** 2)) for speed in SPEEDS])
    turn = np.stack([wave(k * q) for k in range(1, WAVES + 1) for wave in (np.sin, np.cos)])
    for k in range(rows.n):
        if k == j:
            continue
        other, of = rows.torque[:, k], f"the torque of {names[k]}"
        yield ResidualCause("cross-talk", "warning", of, WIRING, other[None])
        yield ResidualCause(
            "cross-talk", "warning", f"{of}, with its angle", WIRING, other * np.stack([one, *turn[:2]]), MODULATED
        )
        both = np.vstack([other * time, torque * time])
        yield ResidualCause("changes-midway", "warning", f"{of} in a part of the log", PARTS, both, MODULATED)
    yield ResidualCause("residual-by-angle", "warning", "its angle", SPRING, angle)
    yield ResidualCause("residual-by-angle", "warning", "its angle, as friction", SPRING, sense * angle)
    yield ResidualCause("residual-by-angle", "warning", "its torque, with its angle", SENSOR, torque * turn)
    laws = np.stack([dq * np.abs(dq), np.sign(dq) * np.sqrt(np.abs(dq)), np.abs(dq), np.abs(sense), *(sense * slow)])
    yield ResidualCause("friction-missing", "warning", "its velocity", FRICTION, laws)
    yield ResidualCause(
        "friction-missing", "warning", "its torque, as friction", FRICTION, (sense * np.abs(torque))[None]
    )
    deviation = max(float(torque.std()), np.finfo(float).tiny)
    amounts = np.stack([np.abs(torque), np.tanh(10.0 * torque / deviation), torque * np.abs(torque), torque])
    yield ResidualCause("torque-gain", "warning", "the amount of its torque", SENSOR, amounts)
    yield ResidualCause("torque-gain", "warning", "its torque, with its speed", SENSOR, torque * slow)
    yield ResidualCause("changes-midway", "warning", "the time, as an offset", PARTS, time)
    yield ResidualCause("changes-midway", "warning", "its torque, with the time", PARTS, torque * time)
    yield ResidualCause("changes-midway", "warning", "its friction, with the time", PARTS, sense * time)
    late = [np.gradient(torque) * rows.rate, *(_lagged(torque, rows, seconds) for seconds in LAGS)]
    yield ResidualCause("joint-delay", "warning", "its torque at earlier times", LATE, np.stack(late))


def _knots(x: Array, count: int) -> Array:
    """Functions of values (M,) that are linear between knots over the range of the values, shape (count, M)."""
    knots = np.linspace(float(x.min()), float(x.max()), count)
    step = max(float(knots[1] - knots[0]), np.finfo(float).tiny)
    return np.clip(1.0 - np.abs(x - knots[:, None]) / step, 0.0, None)


def _lagged(torque: Array, rows: QuickRows, seconds: float) -> Array:
    """First-order lag of a torque (M,) within each run."""
    share, result = 1.0 / (1.0 + seconds * rows.rate), torque.copy()
    for k in range(1, len(torque)):
        if rows.run[k] == rows.run[k - 1]:
            result[k] = result[k - 1] + share * (torque[k] - result[k - 1])
    return result


WIRING = "find out the cause, in the wiring, the sensor, the logger or coupled drives"
PARTS = "find out what changed during the recording, and record again without it"
SPRING = (
    "find out the cause (spring, stop, cable, hose or damage at an angle) and remove it, or leave these angles out"
)
SENSOR = "calibrate the torque of the joint, or the current of its drive, over its whole range"
FRICTION = 'find out the cause in the joint (brake, seal, gear, grease), or select friction with `terms = "auto"`'
LATE = "log the torque without filters, at the same time as the positions"
