"""Kinds of corruption as faults in the field make them, written without knowledge of the checks of the doctor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.signals.zero_phase_filters import butterworth, zero_phase
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from corruption_kinds import CHANNEL, CLOCK, CROSSED, GAIN, LATE, LAW, MIDWAY, SIGN, SPIKES, UNIT, WARMING, ZERO, Kind
from corruption_scene import SMOOTH, Scene
from corruptions import added, rows_taken, standardised, torque_as

QUANTITIES = ("q", "dq", "ddq", "effort")


# Drives, gears and brakes ----------------------------------------------------------------------------------------


def moving(s: Scene) -> Array:
    """Direction of the joint (N,), smooth about standstill."""
    return np.tanh(s.motion.dq[:, s.joint] / 0.02)


def stretches(s: Scene, count: int, rows: int) -> list[slice]:
    """Some stretches of some rows that do not overlap."""
    slots = np.arange(1, s.raw.samples // (rows + 1) - 1)
    chosen = np.sort(s.rng.choice(slots, min(count, len(slots)), replace=False))
    return [slice(int(k) * (rows + 1), int(k) * (rows + 1) + rows) for k in chosen]


def brake_drags(s: Scene) -> Array:
    """Torque (N,) of a brake that is not fully released in six stretches of a twenty-fifth of the recording."""
    closed = np.zeros(s.raw.samples)
    for rows in stretches(s, 6, max(2, s.raw.samples // 25)):
        closed[rows] = 1.0
    return 0.8 * closed * moving(s)


def losses_of_load(s: Scene) -> Array:
    """Friction (N,) of a gear whose losses are 35 % of the torque it transmits."""
    return 0.35 * np.abs(s.effort[:, s.joint]) / s.size[s.joint] * moving(s)


def damaged_tooth(s: Scene) -> Array:
    """Friction (N,) that is high where the joint passes one angle."""
    q = s.motion.q[:, s.joint]
    return 2.5 * moving(s) * np.exp(-(((q - np.median(q)) / 0.1) ** 2))


def commutated(s: Scene, column: Array) -> Array:
    """Column (N,) whose gain swings by 40 % twelve times a turn, as with a wrong commutation angle."""
    return column * (1.0 + 0.4 * np.sin(12.0 * s.motion.q[:, s.joint]))


def signed_by_velocity(s: Scene, column: Array) -> Array:
    """Amount of a column (N,) with the sign of the velocity."""
    sign = np.broadcast_to(s.reading.torque_sign, s.raw.n)[s.joint]
    return np.abs(column) * np.sign(s.motion.dq[:, s.joint]) * sign


# Cables, tools and surroundings ----------------------------------------------------------------------------------


def dress_pack(s: Scene) -> Array:
    """Torques (N, n) of a dress pack along two joints that is taut where both are turned the same way."""
    turned = s.motion.q[:, s.joint] + s.motion.q[:, s.other]
    slack = np.quantile(turned, 0.65)
    pull = 1.5 * np.clip(turned - slack, 0.0, None) / max(float(turned.max() - slack), 1e-9)
    return s.one(pull) + s.one(pull, s.other)


def balancer_fades(s: Scene) -> Array:
    """Torque (N,) that a balancer ceases to bear as it loses pressure."""
    return 1.2 * s.share * standardised(np.sin(s.motion.q[:, s.joint]))


def sideways(s: Scene, size: float) -> Array:
    """Acceleration of the base across gravity, a share of it, shape (3,) [m/s²]."""
    return size * float(np.linalg.norm(s.model.robot.gravity)) * np.array([1.0, 0.0, 0.0])


def hose_pulls(s: Scene) -> Recording:
    """A hose that pulls the flange sideways with 8 % of the arm's weight, as the torque shows it."""
    arm = DynamicsModel(replace(s.model.robot, gravity=sideways(s, 1.0)), (RigidBody(),))
    described = s.model.robot.inertial_vector
    mass = 1.6 if described is None else 0.08 * float(described[:, 0].sum())
    theta = np.zeros(len(arm.parameters))
    theta[arm.inertial_columns[-10:][:4]] = mass * np.array([1.0, 0.0, 0.0, 0.1])
    return s.with_effort(s.effort + s.logged(arm.gravity_torque(s.motion.q, theta)))


def base_sways(s: Scene) -> Recording:
    """Base that sways sideways at 0.7 Hz with 15 % of gravity, as an arm on a vehicle, as the torque shows it."""
    robot = s.model.robot
    swayed = DynamicsModel(replace(robot, gravity=robot.gravity + sideways(s, 0.15)), s.model.terms)
    difference = swayed.torque(s.motion, s.parameters) - s.model.torque(s.motion, s.parameters)
    wave = np.sin(2.0 * np.pi * 0.7 * (s.time - s.time[0]))
    return s.with_effort(s.effort + s.logged(difference) * wave[:, None])


def protective_stop(s: Scene) -> Recording:
    """A stop with brakes closed and drives off, which lasts 15 % of the recording, at its calmest row."""
    speed = np.where(s.between(0.3, 0.7), np.sum(s.motion.dq**2, axis=1), np.inf)
    calm, length = int(np.argmin(speed)), max(2, round(0.15 * s.raw.samples))
    rows = np.insert(np.arange(s.raw.samples), calm, np.full(length, calm))
    stopped = rows_taken(lambda _: rows, evenly=True)(s)
    changed = {}
    for name in ("dq", "ddq", "effort"):
        if (values := getattr(stopped, name)) is not None:
            changed[name] = values.copy()
            changed[name][calm : calm + length] = 0.0
    return replace(stopped, **changed)


# Sensors and controllers -----------------------------------------------------------------------------------------


def hysteresis(s: Scene, column: Array) -> Array:
    """Column (N,) behind a play of 0.6 standard deviations either way, as of a loose torque sensor."""
    half, result = 0.6 * float(column.std()), column.copy()
    for k in range(1, len(column)):
        result[k] = np.clip(result[k - 1], column[k] - half, column[k] + half)
    return result


def tared(s: Scene, column: Array) -> Array:
    """Column (N,) that is set to zero at the start of each sixth of the recording."""
    starts = np.arange(6) * len(column) // 6
    return column - np.repeat(column[starts], np.diff(starts, append=len(column)))


def set_points(s: Scene) -> Recording:
    """Set-points of a soft controller for positions: ahead by up to 0.06 rad, in proportion to the torque."""
    sign = np.broadcast_to(s.reading.position_sign, s.raw.n) * np.broadcast_to(s.reading.torque_sign, s.raw.n)
    smooth = zero_phase(butterworth(2, SMOOTH, 1.0 / s.step), s.effort)
    ahead = 0.06 * sign * smooth / np.maximum(np.abs(smooth).max(axis=0), 1e-9)
    changed = {"q": s.raw.q + ahead}
    if s.raw.dq is not None:
        changed["dq"] = s.raw.dq + np.gradient(ahead, s.time, axis=0)
    return replace(s.raw, **changed)


def friction_overcompensated(s: Scene) -> Recording:
    """Torques from which the controller took one and a half times the friction."""
    laws = s.parameters.copy()
    laws[s.model.inertial_columns] = 0.0
    return s.with_effort(s.effort - 1.5 * s.logged(s.model.torque(s.motion, laws)))


def extrapolated(s: Scene) -> Recording:
    """Position that a drive extrapolates for 0.4 s at each of ten interruptions of the encoder's cable."""
    sign = np.broadcast_to(s.reading.position_sign, s.raw.n)[s.joint]
    changed = {name: v.copy() for name in ("q", "dq") if (v := getattr(s.raw, name)) is not None}
    changed["q"][:, s.joint] = np.unwrap(changed["q"][:, s.joint])
    for rows in stretches(s, 10, max(3, round(0.4 / s.step))):
        speed = sign * s.motion.dq[rows.start, s.joint]
        run = s.time[rows] - s.time[rows.start]
        changed["q"][rows, s.joint] = changed["q"][rows.start, s.joint] + speed * run
        if "dq" in changed:
            changed["dq"][rows, s.joint] = speed
    return replace(s.raw, **changed)


# Buses, recorders and time bases ---------------------------------------------------------------------------------


def polled(s: Scene) -> Recording:
    """Torques that a slow bus reads one after another, each 15 ms after that of the joint before."""
    return s.with_effort(np.column_stack([s.late(column, 0.015 * k) for k, column in enumerate(s.effort.T)]))


def on_change(s: Scene) -> Recording:
    """Torques that are stored only after a change of 0.7 standard deviations, and keep their value until then."""
    stored = s.effort.copy()
    for k in range(1, len(stored)):
        stored[k] = np.where(np.abs(stored[k] - stored[k - 1]) < 0.7 * s.size, stored[k - 1], stored[k])
    return s.with_effort(stored)


def packets_lost(s: Scene) -> Recording:
    """Torques merged by the number of their row, although ten packets of 15 ms are missing among them."""
    length = max(1, round(0.015 / s.step))
    missing = [rows.start + k for rows in stretches(s, 10, length) for k in range(length)]
    left = np.delete(s.effort, missing, axis=0)
    return s.with_effort(np.concatenate([left, np.repeat(left[-1:], s.raw.samples - len(left), axis=0)]))


def uneven_recorder(s: Scene) -> Recording:
    """Rows of a recorder whose rate swings by a fifth over each quarter, with stamps as if they were even."""
    period = np.ptp(s.time) / 4.0
    run = s.time - s.time[0]
    true = s.time[0] + run + 0.2 * period / (2.0 * np.pi) * np.sin(2.0 * np.pi * run / period)
    changed = {}
    for name in QUANTITIES:
        if (values := getattr(s.raw, name)) is not None:
            smooth = np.unwrap(values, axis=0) if name == "q" else values
            changed[name] = np.column_stack([np.interp(true, s.time, column) for column in smooth.T])
    return replace(s.raw, time=s.time[0] + s.step * np.arange(s.raw.samples), **changed)


def zeros_lost(s: Scene) -> Recording:
    """Stamps of seconds and nanoseconds that were joined without the leading zeros of the latter."""
    total = np.round(s.time * 1e9).astype(np.int64)
    seconds, nanoseconds = total // 10**9, total % 10**9
    digits = np.array([len(str(value)) for value in nanoseconds])
    return replace(s.raw, time=seconds + nanoseconds / 10.0**digits)


# Exports and post-processing -------------------------------------------------------------------------------------


def gaps_bridged(s: Scene) -> Recording:
    """Twelve gaps of 1.5 % of the recording that were filled by straight lines in all channels."""
    known: NDArray[np.bool_] = np.ones(s.raw.samples, dtype=np.bool_)
    for rows in stretches(s, 12, max(3, round(0.015 * s.raw.samples))):
        known[rows] = False
    changed = {}
    for name in QUANTITIES:
        if (values := getattr(s.raw, name)) is not None:
            whole = np.unwrap(values, axis=0) if name == "q" else values
            changed[name] = np.column_stack([np.interp(s.time, s.time[known], x[known]) for x in whole.T])
    return replace(s.raw, **changed)


def minus_cut_off(s: Scene) -> Recording:
    """Torques whose large negative numbers are wider than the field of the file and lose their minus sign."""
    return s.with_effort(np.where(s.effort < 0.5 * min(float(s.effort.min()), 0.0), -s.effort, s.effort))


FOURTH: tuple[Kind, ...] = (
    Kind("fourth", "brake drags now and then", added(brake_drags), (*WARMING, *LAW, "contact"), True),
    Kind("fourth", "losses of a gear grow with its load", added(losses_of_load), (*LAW, *GAIN), True),
    Kind("fourth", "damaged tooth", added(damaged_tooth), (*LAW, *SPIKES, "contact"), True),
    Kind("fourth", "gain swings with the motor's angle", torque_as(commutated), (*GAIN, *LAW), True),
    Kind(
        "fourth",
        "gain 0.6 of negative torque",
        torque_as(lambda s, x: np.where(x < 0.0, 0.6 * x, x)),
        (*GAIN, *LAW, "saturation"),
        True,
    ),
    Kind(
        "fourth",
        "amount of a torque with the velocity's sign",
        torque_as(signed_by_velocity),
        (*SIGN, *LAW, "torque-unsigned"),
        True,
    ),
    Kind(
        "fourth",
        "taut dress pack over two joints",
        added(dress_pack, whole=True),
        (*LAW, *CROSSED, "contact"),
        True,
    ),
    Kind("fourth", "balancer loses pressure", added(balancer_fades), (*WARMING, *LAW), True),
    Kind("fourth", "hose pulls the tool sideways", hose_pulls, ("contact", "gravity-direction", *LAW)),
    Kind("fourth", "base sways", base_sways, ("gravity-direction", "contact", *MIDWAY)),
    Kind("fourth", "protective stop with the drives off", protective_stop, (*CHANNEL, *MIDWAY, "contact")),
    Kind("fourth", "hysteresis of a torque sensor", torque_as(hysteresis), (*LAW, *LATE, "channel-coarse"), True),
    Kind("fourth", "torque tared six times", torque_as(tared), WARMING, True),
    Kind(
        "fourth",
        "set-points of a soft controller as positions",
        set_points,
        (*ZERO, *LAW, *LATE, "position-scale", "velocity-mismatch"),
    ),
    Kind(
        "fourth",
        "torques without 1.5 times the friction",
        friction_overcompensated,
        (*LAW, *SIGN, "description-does-not-match"),
    ),
    Kind(
        "fourth",
        "position extrapolated over breaks of a cable",
        extrapolated,
        (*SPIKES, *CHANNEL, "channel-noisy", "velocity-mismatch"),
        True,
    ),
    Kind("fourth", "torques polled one after another", polled, LATE),
    Kind("fourth", "torques stored on change", on_change, (*LATE, *CHANNEL, "channel-coarse", "rows-repeated")),
    Kind("fourth", "torques merged by row with packets lost", packets_lost, (*LATE, *MIDWAY, *CLOCK)),
    Kind("fourth", "rate of the recorder swings", uneven_recorder, (*CLOCK, *MIDWAY, "velocity-mismatch")),
    Kind("fourth", "stamps without leading zeros of nanoseconds", zeros_lost, (*CLOCK, "clock-unit")),
    Kind("fourth", "gaps filled by straight lines", gaps_bridged, (*CHANNEL, *CLOCK, "channel-coarse")),
    Kind(
        "fourth",
        "minus sign of large torques cut off",
        minus_cut_off,
        (*SIGN, *SPIKES, *LAW, "torque-unsigned", "saturation"),
    ),
    Kind(
        "fourth",
        "torques standardised",
        lambda s: s.with_effort(np.column_stack([standardised(column) for column in s.effort.T])),
        (*UNIT, *GAIN),
    ),
)
"""Kinds of corruption."""
