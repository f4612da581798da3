"""Functions of what a log contains that the residual of a joint is compared with: what a fault makes it follow.

A torque that is wrong, or that the model lacks, is a product of one of {1, friction, torque} and a function of the
angles, the velocities, the torques or the time. Faults of a family follow the same product, also if nobody thought of
them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armid.checked_array import Array
from armid.doctor.check_input import WIDTH
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import QuickRows
from armid.doctor.residuals.wave_in_time import strongest_wave

MODULATED = 0.15
"""Further share that a torque of another joint that changes with the angle must explain: many are tried."""

KNOTS, MOST_KNOTS, APART = 8, 16, 0.4
"""Smallest and largest number of knots along the range of a joint, and distance that they may have between [rad]."""

TIMES, WAVES = 6, 2
"""Number of knots along the log, and of waves in a turn by which a gain may change."""

LAGS = (0.3, 3.0)
"""Time constants of the lags of a torque that are tried [s]."""

BLOCK = 64
"""Rows of a lag that are computed together."""

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
        price: Share of the squared residual that the functions must explain beyond that of other functions.
        least: Smallest RMS of what they explain, relative to the largest usual residual of the joint, from which a
            residual that is not large is reported: 1.2 times what they explain at most where they explain more than
            all others, in recordings of eight arms, whole, in halves and in thirds.
    """

    code: str
    severity: Literal["warning"]
    text: str
    remedy: str
    columns: Array
    price: float = 0.0
    least: float = 1.0


def causes_of(state: LogState, j: int) -> Iterator[ResidualCause]:
    """Everything that the residual of joint j is compared with."""
    torque = np.where(state.rows.mask[:, j], state.rows.torque[:, j] - state.fit.residual[:, j], 0.0)
    yield from _other_joints(state, j, torque)
    yield from _angle_and_velocity(state, j, torque)
    yield from _torque_and_time(state, j, torque)


def _other_joints(state: LogState, j: int, torque: Array) -> Iterator[ResidualCause]:
    """Torques and angles of the other joints.

    Args:
        state: The log.
        j: Index of the joint.
        torque: Torque of the joint by the model, shape (M,).
    """
    rows, names = state.rows, state.model.robot.joint_names
    q, dq = rows.motion.q, rows.motion.dq
    sense, time = np.tanh(dq[:, j] / WIDTH), _times(rows)
    angles = np.stack([np.ones(len(q)), np.sin(q[:, j]), np.cos(q[:, j])])
    for k in range(rows.n):
        if k == j:
            continue
        other, of = rows.torque[:, k], f"the torque of {names[k]}"
        yield ResidualCause("cross-talk", "warning", of, WIRING, other[None], least=0.75)
        yield ResidualCause("cross-talk", "warning", f"{of}, with its angle", WIRING, other * angles, MODULATED, 0.4)
        both = np.vstack([other * time, torque * time])
        yield ResidualCause("changes-midway", "warning", f"{of} in a part of the log", PARTS, both, MODULATED, 0.55)
        loaded = (sense * np.abs(other))[None]
        yield ResidualCause("friction-missing", "warning", f"{of}, as friction", FRICTION, loaded, least=0.25)
        angle = _angles(q[:, k])
        yield ResidualCause("residual-by-angle", "warning", f"the angle of {names[k]}", SPRING, angle, MODULATED, 0.4)
    moving, loads = np.abs(dq) / _size(dq), np.abs(rows.torque) / _size(rows.torque)
    together = torque * np.stack([each.sum(axis=1) for each in (moving, loads, moving * loads)])
    yield ResidualCause(
        "torque-gain", "warning", "its torque, with the load of all joints", SENSOR, together, least=0.4
    )


def _angle_and_velocity(state: LogState, j: int, torque: Array) -> Iterator[ResidualCause]:
    """Angle and velocity of the joint itself, each alone and with its friction; arguments as in `_other_joints`."""
    q, dq = state.rows.motion.q[:, j], state.rows.motion.dq[:, j]
    sense, angle = np.tanh(dq / WIDTH), _angles(q)
    yield ResidualCause("residual-by-angle", "warning", "its angle", SPRING, angle, least=0.85)
    yield ResidualCause("residual-by-angle", "warning", "its angle, as friction", SPRING, sense * angle, least=0.35)
    turn = np.stack([wave(k * q) for k in range(1, WAVES + 1) for wave in (np.sin, np.cos)])
    yield ResidualCause(
        "residual-by-angle", "warning", "its torque, with its angle", SENSOR, torque * turn, least=0.4
    )
    slow = _slow(dq)
    laws = np.stack([dq * np.abs(dq), np.sign(dq) * np.sqrt(np.abs(dq)), np.abs(dq), np.abs(sense), *(sense * slow)])
    yield ResidualCause("friction-missing", "warning", "its velocity", FRICTION, laws, least=0.35)
    loaded = (sense * np.abs(torque))[None]
    yield ResidualCause("friction-missing", "warning", "its torque, as friction", FRICTION, loaded, least=0.6)


def _torque_and_time(state: LogState, j: int, torque: Array) -> Iterator[ResidualCause]:
    """Torque of the joint itself, and the time; arguments as in `_other_joints`."""
    rows, dq = state.rows, state.rows.motion.dq[:, j]
    deviation = max(float(torque.std()), np.finfo(float).tiny)
    amounts = np.stack([np.abs(torque), np.tanh(10.0 * torque / deviation), torque * np.abs(torque), torque])
    yield ResidualCause("torque-gain", "warning", "the amount of its torque", SENSOR, amounts, least=0.4)
    yield ResidualCause(
        "torque-gain", "warning", "its torque, with its speed", SENSOR, torque * _slow(dq), least=0.35
    )
    time = _times(rows)
    yield ResidualCause("changes-midway", "warning", "the time, as an offset", PARTS, time, least=0.35)
    yield ResidualCause("changes-midway", "warning", "its torque, with the time", PARTS, torque * time, least=0.35)
    friction = np.tanh(dq / WIDTH) * time
    yield ResidualCause("changes-midway", "warning", "its friction, with the time", PARTS, friction, least=0.35)
    late = [np.gradient(torque) * rows.rate, *(_lagged(torque, rows, seconds) for seconds in LAGS)]
    yield ResidualCause("joint-delay", "warning", "its torque at earlier times", LATE, np.stack(late), least=0.4)
    frequency, wave = strongest_wave(rows, state.fit.residual[:, [j]] / state.fit.sigma[j])
    text = f"a wave of {frequency:.2g} Hz"
    yield ResidualCause("channel-noisy", "warning", text, NOISE, wave, MODULATED, 0.4)


def _size(values: Array) -> Array:
    """RMS of values (M, n), shape (n,), not zero."""
    return np.maximum(np.sqrt(np.mean(values**2, axis=0)), np.finfo(float).tiny)


def _angles(q: Array) -> Array:
    """Functions that are linear between knots along the range of positions (M,), shape (k, M)."""
    return _knots(q, int(np.clip(np.ptp(q) / APART + 1.0, KNOTS, MOST_KNOTS)))


def _times(rows: QuickRows) -> Array:
    """Functions that are linear between knots along the log, shape (TIMES, M)."""
    return _knots(np.arange(len(rows.torque), dtype=np.float64), TIMES)


def _slow(dq: Array) -> Array:
    """Functions of a velocity (M,) that are 1 at rest and fall to zero above `SPEEDS`, shape (k, M)."""
    fastest = max(float(np.abs(dq).max()), np.finfo(float).tiny)
    return np.stack([np.exp(-((dq / (fastest * speed)) ** 2)) for speed in SPEEDS])


def _knots(x: Array, count: int) -> Array:
    """Functions of values (M,) that are linear between knots over the range of the values, shape (count, M)."""
    knots = np.linspace(float(x.min()), float(x.max()), count)
    step = max(float(knots[1] - knots[0]), np.finfo(float).tiny)
    return np.clip(1.0 - np.abs(x - knots[:, None]) / step, 0.0, None)


def _lagged(torque: Array, rows: QuickRows, seconds: float) -> Array:
    """First-order lag of a torque (M,) within each run."""
    share, result = 1.0 / (1.0 + seconds * rows.rate), torque.copy()
    powers = (1.0 - share) ** np.arange(BLOCK + 1)
    within = share * np.tril(powers[np.maximum(np.subtract.outer(np.arange(BLOCK), np.arange(BLOCK)), 0)])
    for run in range(int(rows.run[-1]) + 1):
        start, stop = np.searchsorted(rows.run, [run, run + 1])
        last = torque[start]
        for first in range(start, stop, BLOCK):
            own = slice(first, min(first + BLOCK, stop))
            k = own.stop - own.start
            result[own] = within[:k, :k] @ torque[own] + powers[1 : k + 1] * last
            last = result[own.stop - 1]
    return result


NOISE = "find out where the wave comes from (hum of the mains, a fan, vibration, an alias) and record again"
WIRING = "find out the cause, in the wiring, the sensor, the logger or coupled drives"
PARTS = "find out what changed during the recording, and record again without it"
SPRING = (
    "find out the cause (spring, stop, cable, hose or damage at an angle) and remove it, or leave these angles out"
)
SENSOR = "calibrate the torque of the joint, or the current of its drive, over its whole range"
FRICTION = 'find out the cause in the joint (brake, seal, gear, grease), or select friction with `terms = "auto"`'
LATE = "log the torque without filters, at the same time as the positions"
