"""Further kinds of corruption as faults in the field make them, written without knowledge of the doctor's checks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.maths.inertia import com_inertia_to_vector
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.robot import Robot
from corruption_kinds import CHANNEL, CLOCK, CROSSED, GAIN, LATE, LAW, MIDWAY, ORDER, SPIKES, WARMING, ZERO, Kind
from corruption_scene import Scene
from corruptions import added, lagged, rows_taken, torque_as
from fourth_kinds import QUANTITIES, sideways, stretches


def each_of(s: Scene, change: Callable[[Array], Array]) -> Recording:
    """The recording with each quantity (N, n) as a function of itself, positions without wraps."""
    known = {name: v for name in QUANTITIES if (v := getattr(s.raw, name)) is not None}
    return replace(s.raw, **{name: change(np.unwrap(v, axis=0) if name == "q" else v) for name, v in known.items()})


# Gears, bearings and tools ---------------------------------------------------------------------------------------


def belt_with_play(s: Scene) -> Recording:
    """Position and velocity of one joint behind a loose belt, with a play of 0.04 rad either way."""
    q = np.unwrap(s.raw.q[:, s.joint])
    behind = q.copy()
    for k in range(1, len(q)):
        behind[k] = np.clip(behind[k - 1], q[k] - 0.04, q[k] + 0.04)
    changed = {"q": s.raw.q + s.one(behind - q)}
    if s.raw.dq is not None:
        carried = np.diff(behind, prepend=behind[0]) != 0.0
        changed["dq"] = s.raw.dq * (1.0 - s.one(np.where(carried, 0.0, 1.0)))
    return replace(s.raw, **changed)


def stiff_grease(s: Scene) -> Array:
    """Friction (N, n) as the cube root of speed."""
    speed = s.motion.dq
    return 0.7 * np.cbrt(speed / np.maximum(np.abs(speed).max(axis=0), 1e-9))


def tool(s: Scene, share: float, robot: Robot | None = None) -> tuple[DynamicsModel, Array]:
    """Rigid-body model, and parameters (p,) of a tool with a share of the arm's weight, 10 cm from the flange."""
    described = s.model.robot.inertial_vector
    mass = 20.0 * share if described is None else share * float(described[:, 0].sum())
    arm = DynamicsModel(robot or s.model.robot, (RigidBody(),))
    theta = np.zeros(len(arm.parameters))
    theta[arm.inertial_columns[-10:]] = com_inertia_to_vector(mass, np.array([0.0, 0.03, 0.1]), np.zeros((3, 3)))
    return arm, theta


def tool_swings(s: Scene) -> Recording:
    """A loosely mounted tool with 12 % of the arm's weight that swings at 1.5 Hz, with a damping ratio of 0.08."""
    arm, theta = tool(s, 0.12)
    rigid = arm.torque(s.motion, theta)
    omega, swung, speed = 2.0 * np.pi * 1.5, rigid.copy(), np.zeros(s.raw.n)
    for k in range(1, len(rigid)):
        speed = speed + s.step * (omega**2 * (rigid[k] - swung[k - 1]) - 0.16 * omega * speed)
        swung[k] = swung[k - 1] + s.step * speed
    return s.with_effort(s.effort + s.logged(swung))


def foam(s: Scene) -> Recording:
    """Foam that the tip presses in a fifth of the rows with up to 20 % of the arm's weight, as the torque shows."""
    arm, theta = tool(s, 0.2, replace(s.model.robot, gravity=sideways(s, -1.0)))
    force = arm.gravity_torque(s.motion.q, theta)
    way = np.cumsum(np.sum(force * s.motion.dq, axis=1) * np.gradient(s.time))
    depth = np.clip(way - np.quantile(way, 0.8), 0.0, None)
    return s.with_effort(s.effort + s.logged(force) * (depth / max(float(depth.max()), 1e-9))[:, None])


def base_rocks(s: Scene) -> Recording:
    """Base on loose bolts that leans by 6° to either side with the direction of the first joint."""
    robot = s.model.robot
    leant = DynamicsModel(replace(robot, gravity=robot.gravity + sideways(s, 0.1)), s.model.terms)
    difference = leant.torque(s.motion, s.parameters) - s.model.torque(s.motion, s.parameters)
    side = lagged(s, np.tanh(s.motion.dq[:, 0] / 0.05), 0.1)
    return s.with_effort(s.effort + s.logged(difference) * side[:, None])


# Drives and sensors ----------------------------------------------------------------------------------------------


def derated(s: Scene, column: Array) -> Array:
    """Column (N,) whose limit falls to a half of its largest amount as the drive warms up."""
    limit = np.abs(column).max() * (1.0 - 0.5 * s.share)
    return np.clip(column, -limit, limit)


def off_centre(s: Scene) -> Recording:
    """Position and velocity of one joint by an encoder whose disc is off its centre: 0.08 rad once a turn."""
    q = s.raw.q[:, s.joint]
    changed = {"q": s.raw.q + s.one(0.08 * np.sin(q + 1.0))}
    if s.raw.dq is not None:
        changed["dq"] = s.raw.dq * (1.0 + s.one(0.08 * np.cos(q + 1.0)))
    return replace(s.raw, **changed)


def bent(s: Scene, column: Array) -> Array:
    """Column (N,) of a torque sensor that reads the other joint's torque too, with the sine of its own angle."""
    other = s.effort[:, s.other] / max(float(np.sqrt(np.mean(s.effort[:, s.other] ** 2))), 1e-9)
    return column + 0.8 * s.size[s.joint] * other * np.sin(s.motion.q[:, s.joint])


# Controllers and recorders ---------------------------------------------------------------------------------------


def feedforward(s: Scene) -> Recording:
    """Torques of the controller's rigid-body model in place of measured ones in the middle two fifths."""
    rigid = np.zeros_like(s.parameters)
    rigid[s.model.inertial_columns] = s.parameters[s.model.inertial_columns]
    computed = s.logged(s.model.torque(s.motion, rigid))
    return s.with_effort(np.where(s.between(0.3, 0.7)[:, None], computed, s.effort))


def half_rate(s: Scene) -> NDArray[np.integer]:
    """Rows of which every other is left out in the second half."""
    rows = np.arange(s.raw.samples)
    return rows[~s.between(0.5) | (rows % 2 == 0)]


def buffers_repeated(s: Scene) -> NDArray[np.integer]:
    """Rows where ten buffers of a quarter of a second are those before them."""
    length = max(2, round(0.25 / s.step))
    rows = np.arange(s.raw.samples)
    for buffer in stretches(s, 10, length):
        rows[buffer] = np.arange(buffer.start - length, buffer.stop - length)
    return rows


def packets_swapped(s: Scene) -> Recording:
    """Torques in packets of 0.2 s, a half of which stand in the wrong order beside the next one."""
    length = max(2, round(0.2 / s.step))
    rows = np.arange(s.raw.samples)
    for start in range(0, len(rows) - 2 * length, 2 * length):
        if s.rng.random() < 0.5:
            rows[start : start + 2 * length] = np.roll(rows[start : start + 2 * length], length)
    return s.with_effort(s.effort[rows])


def other_part(s: Scene) -> Recording:
    """Torques of a quarter of the program beside the motion of another quarter."""
    effort, count = s.effort.copy(), s.raw.samples
    first, second, length = round(0.35 * count), round(0.65 * count), round(0.25 * count)
    effort[first : first + length] = s.effort[second : second + length]
    return s.with_effort(effort)


def set_back(s: Scene) -> Recording:
    """Stamps of a clock that is set back by an hour in the middle."""
    return replace(s.raw, time=s.time - np.where(s.between(0.5), 3600.0, 0.0))


# Exports and spreadsheets ----------------------------------------------------------------------------------------


def parts_by_name(s: Scene) -> NDArray[np.integer]:
    """Rows of 24 files that were joined in the order of their names: 1, 10, 11, …, 19, 2, 20, …."""
    parts = np.array_split(np.arange(s.raw.samples), 24)
    return np.concatenate([parts[k - 1] for k in sorted(range(1, 25), key=str)])


def smoothed(s: Scene) -> Recording:
    """All channels as means over a centred window of 1.5 s."""
    half = max(1, round(0.75 / s.step))
    window = np.full(2 * half + 1, 1.0 / (2 * half + 1))

    def mean(values: Array) -> Array:
        padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
        return np.column_stack([np.convolve(column, window, mode="valid") for column in padded.T])

    return each_of(s, mean)


def far_to_mean(s: Scene) -> Recording:
    """Torques of which samples that are more than 1.5 standard deviations from the mean are set to the mean."""
    mean = s.effort.mean(axis=0)
    return s.with_effort(np.where(np.abs(s.effort - mean) > 1.5 * s.size, mean, s.effort))


def field_too_many(s: Scene) -> Recording:
    """Table whose fields stand one column further in 4 % of the rows, behind a zero, as after a decimal comma."""
    known = {name: v for name in QUANTITIES if (v := getattr(s.raw, name)) is not None}
    table = np.column_stack(list(known.values()))
    moved = np.column_stack([np.zeros(len(table)), table[:, :-1]])
    rows = s.rng.random(len(table)) < 0.04
    parts = np.split(np.where(rows[:, None], moved, table), len(known), axis=1)
    return replace(s.raw, **dict(zip(known, parts, strict=True)))


FIFTH: tuple[Kind, ...] = (
    Kind("fifth", "loose belt with play", belt_with_play, (*LATE, *LAW), True),
    Kind(
        "fifth",
        "stiff grease in all gears",
        added(stiff_grease, whole=True),
        (*LAW, "friction-rise", "recordings-disagree"),
    ),
    Kind("fifth", "loose tool swings", tool_swings, ("contact", "recordings-disagree", "mass-far-from-description")),
    Kind("fifth", "tip presses foam", foam, ("contact", *LAW)),
    Kind("fifth", "base rocks on loose bolts", base_rocks, ("gravity-direction", "contact", *LAW)),
    Kind(
        "fifth",
        "limit of a torque falls as the drive warms up",
        torque_as(derated),
        ("saturation", *WARMING, *GAIN),
        True,
    ),
    Kind(
        "fifth", "disc of an encoder off its centre", off_centre, (*ZERO, "position-scale", "residual-by-angle"), True
    ),
    Kind(
        "fifth",
        "creep of a torque sensor",
        torque_as(lambda s, x: x + 0.4 * lagged(s, x, 3.0)),
        (*GAIN, *LATE, *WARMING),
        True,
    ),
    Kind("fifth", "torque sensor reads bending", torque_as(bent), (*CROSSED, *LAW), True),
    Kind(
        "fifth",
        "torque of another joint for a quarter",
        torque_as(lambda s, x: np.where(s.between(0.4, 0.65), s.effort[:, s.other], x)),
        (*MIDWAY, *ORDER, *CROSSED),
        True,
    ),
    Kind("fifth", "computed torques for two fifths", feedforward, (*MIDWAY, *LAW)),
    Kind(
        "fifth",
        "half the rate, second half, stamps written anew",
        rows_taken(half_rate, evenly=True),
        (*CLOCK, *MIDWAY, "velocity-mismatch"),
    ),
    Kind("fifth", "ten buffers repeated", rows_taken(buffers_repeated, evenly=True), CLOCK),
    Kind("fifth", "packets of torques swapped", packets_swapped, (*LATE, *CLOCK, *SPIKES)),
    Kind("fifth", "torques of another part of the program", other_part, (*MIDWAY, *LATE, *CLOCK)),
    Kind("fifth", "clock set back by an hour", set_back, CLOCK),
    Kind(
        "fifth",
        "files joined in the order of their names, stamps written anew",
        rows_taken(parts_by_name, evenly=True),
        (*CLOCK, "velocity-mismatch"),
    ),
    Kind("fifth", "all channels smoothed over 1.5 s", smoothed, ("filtered-before-logging",)),
    Kind("fifth", "large torques set to the mean", far_to_mean, (*SPIKES, *CHANNEL, "saturation")),
    Kind("fifth", "a field too many in 4 % of the rows", field_too_many, (*SPIKES, *ORDER, "channel-noisy")),
)
"""Kinds of corruption."""
