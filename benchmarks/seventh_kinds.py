"""Further kinds of corruption as faults in laboratories make them, written before the doctor was run on them."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.signals.zero_phase_filters import butterworth, zero_phase
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from corruption_kinds import (
    CHANNEL,
    CLOCK,
    CROSSED,
    GAIN,
    LATE,
    LAW,
    MIDWAY,
    SPIKES,
    UNIT,
    WARMING,
    ZERO,
    Kind,
)
from corruption_scene import Scene
from corruptions import added, base_tilted, lagged, rows_taken, standardised, torque_as
from fifth_kinds import tool
from fourth_kinds import QUANTITIES, moving, sideways, stretches

# Drives, gears and brakes ----------------------------------------------------------------------------------------


def wrong_ratio(s: Scene) -> Recording:
    """Position, velocity and torque of one joint by a gear ratio of 100 in place of 121."""
    ratio = 121.0 / 100.0
    changed = {"q": s.raw.q + s.one((ratio - 1.0) * np.unwrap(s.raw.q[:, s.joint]))}
    if s.raw.dq is not None:
        changed["dq"] = s.raw.dq * (1.0 + s.one(ratio - 1.0))
    return replace(s.raw, effort=s.effort * (1.0 + s.one(1.0 / ratio - 1.0)), **changed)


def grease_warms(s: Scene) -> Array:
    """Friction (N, n) that is high in a cold arm, a half of it viscous, and falls as the grease warms up."""
    fastest = np.maximum(np.abs(s.motion.dq).max(axis=0), 1e-9)
    law = 0.3 * np.tanh(s.motion.dq / 0.02) + 0.6 * s.motion.dq / fastest
    return law * np.exp(-3.0 * s.share)[:, None]


def bearing_loaded(s: Scene) -> Array:
    """Friction (N,) of a bearing that grows with the torque of the other joint, which tilts it."""
    return 0.7 * np.abs(s.effort[:, s.other]) / max(float(s.size[s.other]), 1e-9) * moving(s)


def soft_start(s: Scene) -> Recording:
    """Torques that a soft start raises from a fifth to their full amount in the first third."""
    return s.with_effort(s.effort * np.clip(0.2 + 0.8 * s.share / 0.33, 0.0, 1.0)[:, None])


# Tools, cables and surroundings ----------------------------------------------------------------------------------


def cable_by_first(s: Scene) -> Array:
    """Torque (N,) of a cable that winds about the base: it depends on the angle of the first joint."""
    return 0.8 * standardised(np.sin(2.0 * s.motion.q[:, 0] + 0.5))


def edge_touched(s: Scene) -> Recording:
    """The middle link rests on the edge of a table for a tenth of the recording, as the torque shows it."""
    arm, theta = tool(s, 0.35, replace(s.model.robot, gravity=sideways(s, 1.0)))
    middle, last = (arm.inertial_columns.reshape(-1, 10)[k] for k in (s.raw.n // 2, -1))
    theta[middle], theta[last] = theta[last].copy(), 0.0
    return s.with_effort(s.effort + s.logged(arm.gravity_torque(s.motion.q, theta)) * s.between(0.4, 0.5)[:, None])


def gripped(s: Scene) -> Recording:
    """A gripper that takes a part of a tenth of the arm's weight and puts it down again, four times."""
    arm, theta = tool(s, 0.1)
    held = np.zeros(s.raw.samples)
    for rows in stretches(s, 4, max(2, s.raw.samples // 9)):
        held[rows] = 1.0
    return s.with_effort(s.effort + s.logged(arm.torque(s.motion, theta)) * held[:, None])


def wall_mounted(s: Scene) -> Recording:
    """Torques of an arm on a wall that is described as standing on the floor."""
    robot = s.model.robot
    turned = DynamicsModel(replace(robot, gravity=sideways(s, 1.0)), s.model.terms)
    difference = turned.torque(s.motion, s.parameters) - s.model.torque(s.motion, s.parameters)
    return s.with_effort(s.effort + s.logged(difference))


# Sensors ---------------------------------------------------------------------------------------------------------


def strongly_filtered(s: Scene, column: Array) -> Array:
    """Column (N,) behind two first-order low-passes of 0.12 s each, as one drive of several is set."""
    return lagged(s, lagged(s, column, 0.12), 0.12)


def zero_warms(s: Scene) -> Recording:
    """Position of one joint whose zero moves by 0.15 rad as the encoder warms up."""
    return replace(s.raw, q=s.raw.q + s.one(0.15 * (1.0 - np.exp(-4.0 * s.share))))


def counts_overflow(s: Scene) -> Recording:
    """Position of one joint whose counter of the motor's turns overflows once, which is 1.3 rad of the joint."""
    return replace(s.raw, q=s.raw.q - s.one(np.where(s.between(0.62), 1.3, 0.0)))


def late_when_fast(s: Scene, column: Array) -> Array:
    """Column (N,) that is late by 90 ms where the joint is faster than a half of its RMS speed."""
    speed = np.abs(s.motion.dq[:, s.joint])
    share = lagged(s, np.where(speed > 0.5 * np.sqrt(np.mean(speed**2)), 1.0, 0.0), 0.05)
    return (1.0 - share) * column + share * s.late(column, 0.09)


def square_law(s: Scene, column: Array) -> Array:
    """Column (N,) of a sensor that reads the square, with its sign, and was calibrated at one load."""
    return column * np.abs(column) / max(float(np.quantile(np.abs(column), 0.8)), 1e-9)


# Loggers, buses and exports --------------------------------------------------------------------------------------


def half_precision(s: Scene) -> Recording:
    """All channels as numbers of half precision, eleven bits."""
    known = {name: v for name in QUANTITIES if (v := getattr(s.raw, name)) is not None}
    return replace(s.raw, **{name: v.astype(np.float16).astype(np.float64) for name, v in known.items()})


def commanded(s: Scene) -> Recording:
    """Commanded position of one joint, which its drive follows with a lag of 0.15 s, beside its measured velocity."""
    sign = np.broadcast_to(s.reading.position_sign, s.raw.n)[s.joint]
    return replace(s.raw, q=s.raw.q + s.one(0.15 * sign * s.motion.dq[:, s.joint]))


def velocity_of_other(s: Scene) -> Recording:
    """Velocity of another joint in place of a joint's own; velocities are added where the log has none."""
    sign = np.broadcast_to(s.reading.position_sign, s.raw.n)
    dq = (s.motion.dq * sign if s.raw.dq is None else s.raw.dq).copy()
    dq[:, s.joint] = dq[:, s.other]
    return replace(s.raw, dq=dq)


def pauses_dropped(s: Scene) -> NDArray[np.integer]:
    """Rows without three dropouts of 0.3 s."""
    missing = np.concatenate([np.arange(r.start, r.stop) for r in stretches(s, 3, max(2, round(0.3 / s.step)))])
    return np.delete(np.arange(s.raw.samples), missing)


def chunks_overlap(s: Scene) -> NDArray[np.integer]:
    """Rows of eight files that each begin with the last 0.4 s of the one before."""
    more = max(2, round(0.4 / s.step))
    parts = np.array_split(np.arange(s.raw.samples), 8)
    return np.concatenate([np.arange(max(0, p[0] - (more if k else 0)), p[-1] + 1) for k, p in enumerate(parts)])


def ring_buffer(s: Scene) -> Recording:
    """Motion of a ring buffer that was full: positions and velocities of the last quarter are those of the first."""
    changed, count = {}, s.raw.samples // 4
    for name in ("q", "dq", "ddq"):
        if (values := getattr(s.raw, name)) is not None:
            changed[name] = values.copy()
            changed[name][-count:] = values[:count]
    return replace(s.raw, **changed)


def averaged_and_held(s: Scene) -> Recording:
    """Torques as means over 0.15 s that stand in all rows of the next 0.15 s."""
    length = max(2, round(0.15 / s.step))
    parts = [slice(k, min(k + length, s.raw.samples)) for k in range(0, s.raw.samples, length)]
    effort = s.effort.copy()
    for before, rows in pairwise(parts):
        effort[rows] = s.effort[before].mean(axis=0)
    return s.with_effort(effort)


def clock_corrected(s: Scene) -> Recording:
    """Torques of a computer whose clock was 0.2 s wrong for a third of the recording, merged by stamps."""
    late = np.column_stack([s.late(column, 0.2) for column in s.effort.T])
    return s.with_effort(np.where(s.between(0.4, 0.73)[:, None], late, s.effort))


def hundredths_joined(s: Scene) -> Recording:
    """Torques in two integers, units and hundredths, that were joined without the leading zero: 3.05 as 3.5."""
    hundredths = np.round(np.abs(s.effort) * 100.0)
    units, rest = hundredths // 100.0, hundredths % 100.0
    joined = units + np.where(rest < 10.0, rest / 10.0, rest / 100.0)
    return s.with_effort(np.sign(s.effort) * joined)


def wrists_in_millis(s: Scene) -> Recording:
    """Torques of the last three joints, whose drives are of another make, a thousand times as large."""
    factor = np.where(np.arange(s.raw.n) >= s.raw.n - 3, 1000.0, 1.0)
    return s.with_effort(s.effort * factor)


def weight_taken_since(s: Scene) -> Recording:
    """Torques from which the controller takes the weight, once it is switched to another mode in the middle."""
    weight = s.logged(s.model.gravity_torque(s.motion.q, s.parameters))
    return s.with_effort(s.effort - weight * s.between(0.5)[:, None])


def one_way_clipped(s: Scene, column: Array) -> Array:
    """Column (N,) that is clipped at a half of its largest value, in one direction only."""
    middle = float(np.median(column))
    return np.minimum(column, middle + 0.5 * (float(column.max()) - middle))


def hum(s: Scene) -> Array:
    """Torques (N, n) of an alias of the drives' frequency, at 0.8 Hz, in opposite phases from joint to joint."""
    phase = np.pi * np.arange(s.raw.n)
    return 0.5 * np.sin(2.0 * np.pi * 0.8 * s.time[:, None] + phase)


def dropped_tool(s: Scene) -> Recording:
    """A tool of a seventh of the arm's weight that falls off at 55 % of the recording."""
    arm, theta = tool(s, 1.0 / 7.0)
    return s.with_effort(s.effort + s.logged(arm.torque(s.motion, theta)) * s.between(0.0, 0.55)[:, None])


def quiet_line(s: Scene, column: Array) -> Array:
    """Column (N,) whose slow part is as it was and whose fast part, above 0.5 Hz, is lost by a half."""
    slow = zero_phase(butterworth(2, 0.5, 1.0 / s.step), column[:, None])[:, 0]
    return slow + 0.5 * (column - slow)


GRAVITY = ("gravity-direction",)

SEVENTH: tuple[Kind, ...] = (
    Kind("seventh", "gear ratio wrong", wrong_ratio, ("motor-side", "position-scale", *GAIN, *ZERO), True),
    Kind("seventh", "grease of all joints warms", added(grease_warms, whole=True), WARMING),
    Kind("seventh", "friction of a bearing follows another torque", added(bearing_loaded), (*LAW, *CROSSED), True),
    Kind("seventh", "soft start in the first third", soft_start, (*MIDWAY, *GAIN)),
    Kind("seventh", "cable about the base", added(cable_by_first), (*LAW, *CROSSED, "contact"), True),
    Kind("seventh", "middle link rests on an edge", edge_touched, ("contact", *MIDWAY)),
    Kind("seventh", "gripper takes a part four times", gripped, ("contact", *MIDWAY)),
    Kind("seventh", "wall mounted", wall_mounted, (*GRAVITY, *ZERO)),
    Kind("seventh", "base tilted by 3°", base_tilted(0.0, 3.0), (*GRAVITY, *ZERO)),
    Kind(
        "seventh",
        "one torque behind a strong filter",
        torque_as(strongly_filtered),
        (*LATE, "filtered-before-logging"),
        True,
    ),
    Kind("seventh", "zero moves as an encoder warms", zero_warms, (*ZERO, *MIDWAY, "position-drift"), True),
    Kind("seventh", "counter overflows once", counts_overflow, (*MIDWAY, *ZERO, "position-wrapped"), True),
    Kind("seventh", "torque late in fast motion", torque_as(late_when_fast), (*LATE, *LAW), True),
    Kind("seventh", "torque sensor of a square law", torque_as(square_law), (*GAIN, *LAW), True),
    Kind(
        "seventh",
        "half precision",
        half_precision,
        ("channel-coarse", "channel-noisy", "velocity-mismatch"),
    ),
    Kind("seventh", "commanded position of one joint", commanded, (*LATE, "velocity-mismatch"), True),
    Kind("seventh", "velocity of another joint", velocity_of_other, ("velocity-mismatch",), True),
    Kind(
        "seventh",
        "three dropouts of 0.3 s, stamps written anew",
        rows_taken(pauses_dropped, evenly=True),
        (*CLOCK, "velocity-mismatch"),
    ),
    Kind(
        "seventh",
        "files that overlap by 0.4 s, stamps written anew",
        rows_taken(chunks_overlap, evenly=True),
        (*CLOCK, "velocity-mismatch"),
    ),
    Kind("seventh", "motion of a full ring buffer", ring_buffer, (*CLOCK, *MIDWAY, *LATE, "velocity-mismatch")),
    Kind(
        "seventh",
        "torques averaged over 0.15 s and held",
        averaged_and_held,
        (*LATE, "rows-repeated", "channel-coarse", "filtered-before-logging"),
    ),
    Kind("seventh", "torques' clock wrong for a third", clock_corrected, (*MIDWAY, *LATE, *CLOCK)),
    Kind(
        "seventh",
        "hundredths without leading zeros",
        hundredths_joined,
        (*SPIKES, "channel-noisy", "channel-coarse"),
    ),
    Kind("seventh", "three wrists in mN·m", wrists_in_millis, (*UNIT, *GAIN)),
    Kind(
        "seventh",
        "weight taken off the torques, second half",
        weight_taken_since,
        (*MIDWAY, *GRAVITY, "description-does-not-match"),
    ),
    Kind("seventh", "torque clipped in one direction", torque_as(one_way_clipped), ("saturation",), True),
    Kind("seventh", "hum of 0.8 Hz on all torques", added(hum, whole=True), ("channel-noisy", *LAW, *CHANNEL)),
    Kind("seventh", "tool falls off midway", dropped_tool, MIDWAY),
    Kind(
        "seventh",
        "fast half of a torque lost",
        torque_as(quiet_line),
        (*GAIN, *LATE, "filtered-before-logging"),
        True,
    ),
)
"""Kinds of corruption."""
