"""Further kinds of corruption as faults in the field make them, written before any check was tuned to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.maths.signals.zero_phase_filters import butterworth, zero_phase
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from corruption_kinds import CHANNEL, CLOCK, GAIN, LATE, LAW, MIDWAY, SPIKES, WARMING, ZERO, Kind
from corruption_scene import SMOOTH, Scene
from corruptions import added, lagged, torque_as
from fifth_kinds import each_of, tool
from fourth_kinds import sideways, stretches

# Belts, brakes and stops -----------------------------------------------------------------------------------------


def belt_skips(s: Scene) -> Recording:
    """Position of one joint behind a belt that skips a tooth of 0.06 rad at the six largest torques."""
    load = np.abs(zero_phase(butterworth(2, SMOOTH, 1.0 / s.step), s.effort)[:, s.joint])
    skipped, apart = np.zeros(s.raw.samples), s.raw.samples // 20
    for _ in range(6):
        row = int(np.argmax(load))
        skipped[row:] += 0.06
        load[max(0, row - apart) : row + apart] = -1.0
    return replace(s.raw, q=s.raw.q + s.one(skipped))


def brake_holds(s: Scene, column: Array) -> Array:
    """Column (N,) that falls to zero within 0.15 s wherever the joint is slow, as a brake then bears the load."""
    speed = np.abs(s.motion.dq[:, s.joint])
    free = np.where(speed > 0.25 * float(np.sqrt(np.mean(speed**2))), 1.0, 0.0)
    return column * lagged(s, free, 0.05)


def rubber_stop(s: Scene) -> Array:
    """Torque (N,) of a rubber stop in the last eighth of the range of a joint."""
    q = s.motion.q[:, s.joint]
    begin = float(q.max() - 0.125 * np.ptp(q))
    pressed = np.clip(q - begin, 0.0, None)
    return 2.5 * pressed / max(float(pressed.max()), 1e-9)


def gear_winds_up(s: Scene) -> Recording:
    """Position and velocity of one joint before a soft gear that winds up by 0.12 rad at the largest torque."""
    smooth = zero_phase(butterworth(2, SMOOTH, 1.0 / s.step), s.effort)[:, s.joint]
    sign = np.broadcast_to(s.reading.position_sign, s.raw.n) * np.broadcast_to(s.reading.torque_sign, s.raw.n)
    wound = 0.12 * sign[s.joint] * smooth / max(float(np.abs(smooth).max()), 1e-9)
    changed = {"q": s.raw.q + s.one(wound)}
    if s.raw.dq is not None:
        changed["dq"] = s.raw.dq + s.one(np.gradient(wound, s.time))
    return replace(s.raw, **changed)


# Hands, tanks and vehicles ---------------------------------------------------------------------------------------


def hand_guides(s: Scene) -> Recording:
    """A hand that holds the flange all the time, with a force that wanders by 10 % of the arm's weight."""
    total = np.zeros_like(s.effort)
    for axis in np.eye(3):
        pull = np.linalg.norm(s.model.robot.gravity) * axis
        arm, theta = tool(s, 0.1, replace(s.model.robot, gravity=pull))
        force = lagged(s, lagged(s, s.rng.standard_normal(s.raw.samples), 0.7), 0.7)
        total += arm.gravity_torque(s.motion.q, theta) * (force / max(float(force.std()), 1e-9))[:, None]
    return s.with_effort(s.effort + s.logged(total))


def tank_empties(s: Scene) -> Recording:
    """A paint pot at the flange whose weight falls from 15 % of the arm's to nothing."""
    arm, theta = tool(s, 0.15)
    return s.with_effort(s.effort + s.logged(arm.torque(s.motion, theta)) * (1.0 - s.share)[:, None])


def vehicle_brakes(s: Scene) -> Recording:
    """Arm on a vehicle that starts or stops eight times for 0.8 s with a fifth of gravity."""
    robot = s.model.robot
    pushed = DynamicsModel(replace(robot, gravity=robot.gravity + sideways(s, 0.2)), s.model.terms)
    difference = pushed.torque(s.motion, s.parameters) - s.model.torque(s.motion, s.parameters)
    size = np.zeros(s.raw.samples)
    for k, rows in enumerate(stretches(s, 8, max(2, round(0.8 / s.step)))):
        size[rows] = (-1.0) ** k * np.sin(np.linspace(0.0, np.pi, len(size[rows])))
    return s.with_effort(s.effort + s.logged(difference) * size[:, None])


# Drives and sensors ----------------------------------------------------------------------------------------------


def without_mean(s: Scene, column: Array) -> Array:
    """Column (N,) behind a coupling that lets constant values fade within 4 s."""
    return column - lagged(s, column, 4.0)


def supply_sags(s: Scene) -> Recording:
    """Torques of drives that get up to 45 % weaker than their currents say where all joints together need power."""
    size = np.maximum(s.size, 1e-9)
    power = np.sum(np.abs(s.motion.dq) * np.abs(s.effort) / size, axis=1)
    load = np.clip(power / max(float(np.quantile(power, 0.98)), 1e-9), 0.0, 1.0)
    return s.with_effort(s.effort / (1.0 - 0.45 * load)[:, None])


def dead_time(s: Scene, column: Array) -> Array:
    """Column (N,) of a current sensor that is off by 0.5 standard deviations in the direction of the current."""
    return column + 0.5 * column.std() * np.tanh(column / max(0.02 * float(column.std()), 1e-9))


def subdivided(s: Scene) -> Recording:
    """Position and velocity of one joint by an encoder with an error of 0.02 rad that repeats 16 times a turn."""
    q = s.raw.q[:, s.joint]
    changed = {"q": s.raw.q + s.one(0.02 * np.sin(16.0 * q))}
    if s.raw.dq is not None:
        changed["dq"] = s.raw.dq * (1.0 + s.one(0.32 * np.cos(16.0 * q)))
    return replace(s.raw, **changed)


def rate_limited(s: Scene, column: Array) -> Array:
    """Column (N,) that follows itself by at most 0.8 standard deviations a second."""
    most, result = 0.8 * float(column.std()) * s.step, column.copy()
    for k in range(1, len(column)):
        result[k] = result[k - 1] + np.clip(column[k] - result[k - 1], -most, most)
    return result


# Controllers and recorders ---------------------------------------------------------------------------------------


def filter_restarts(s: Scene) -> Recording:
    """Torques behind a filter of 0.4 s that begins at zero every five seconds."""
    run = np.mod(s.time - s.time[0], 5.0)
    return s.with_effort(s.effort * (1.0 - np.exp(-run / 0.4))[:, None])


def straight_lines(s: Scene) -> Recording:
    """All channels as straight lines between samples that are a third of a second apart."""
    few = np.append(np.arange(0, s.raw.samples - 1, max(2, round(0.33 / s.step))), s.raw.samples - 1)
    return each_of(s, lambda x: np.column_stack([np.interp(s.time, s.time[few], c[few]) for c in x.T]))


def cells_deleted(s: Scene) -> Recording:
    """Positions of one joint that move up where 80 ms of cells were deleted, at three places."""
    length, changed = max(1, round(0.08 / s.step)), {}
    missing = np.concatenate([np.arange(k, k + length) for k in (s.raw.samples * np.array([1, 2, 3]) // 4)])
    for name in ("q", "dq"):
        if (values := getattr(s.raw, name)) is not None:
            left = np.delete(values[:, s.joint], missing)
            changed[name] = values.copy()
            changed[name][:, s.joint] = np.append(left, np.full(s.raw.samples - len(left), left[-1]))
    return replace(s.raw, **changed)


SIXTH: tuple[Kind, ...] = (
    Kind("sixth", "belt skips teeth at peaks of torque", belt_skips, (*MIDWAY, *ZERO, *SPIKES), True),
    Kind("sixth", "brake holds the joint when it is slow", torque_as(brake_holds), (*CHANNEL, *LAW), True),
    Kind("sixth", "rubber stop at the end of the range", added(rubber_stop), (*LAW, "contact"), True),
    Kind(
        "sixth",
        "position before a soft gear",
        gear_winds_up,
        (*ZERO, *LAW, *LATE, "position-scale", "velocity-mismatch"),
        True,
    ),
    Kind("sixth", "hand holds the flange", hand_guides, ("contact", *LAW)),
    Kind("sixth", "paint pot empties", tank_empties, (*MIDWAY, "recordings-disagree")),
    Kind("sixth", "vehicle starts and stops", vehicle_brakes, ("gravity-direction", "contact", *MIDWAY)),
    Kind(
        "sixth",
        "torque without constant values",
        torque_as(without_mean),
        (*LATE, *GAIN, *WARMING, "filtered-before-logging", "description-does-not-match"),
        True,
    ),
    Kind("sixth", "supply sags under load", supply_sags, (*GAIN, *LAW, *MIDWAY)),
    Kind("sixth", "dead time of a drive", torque_as(dead_time), (*GAIN, *LAW), True),
    Kind(
        "sixth",
        "encoder subdivides unevenly",
        subdivided,
        ("residual-by-angle", "velocity-mismatch", "channel-noisy", "position-scale", *ZERO),
        True,
    ),
    Kind(
        "sixth",
        "torque limited in its rate",
        torque_as(rate_limited),
        (*LATE, *LAW, "filtered-before-logging", "saturation"),
        True,
    ),
    Kind("sixth", "filter of torques restarts", filter_restarts, (*SPIKES, *CHANNEL, *LATE, *MIDWAY)),
    Kind(
        "sixth",
        "straight lines between few samples",
        straight_lines,
        (*CHANNEL, *CLOCK, "channel-coarse", "filtered-before-logging"),
    ),
    Kind("sixth", "cells of a position deleted", cells_deleted, (*LATE, *MIDWAY, *SPIKES, *CLOCK), True),
)
"""Kinds of corruption."""
