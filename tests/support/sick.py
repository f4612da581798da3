"""Logs of virtual arms on motions drawn at random, sound or with one fault; for the tests of the doctor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.excitation.fourier import Excitation
from armid.lab.inverse_dynamics_recording import Sensors, record
from armid.maths.inertia import com_inertia_to_vector, vector_to_com_inertia
from armid.maths.signals.zero_phase_filters import butterworth, zero_phase
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import AsymmetricCoulomb, Coulomb, Offset, RigidBody, RotorInertia, Stribeck, Viscous
from armid.robot import Robot, load_robot
from armid.robot.kinematics import forward_kinematics, frame_pose

ARMS = ("iiwa14-r820", "iiwa7-r800", "panda", "ur5e", "ur10e")
DESCRIBED = ("iiwa14-r820", "ur5e", "ur10e")
"""Arms whose descriptions have inertias: where they have none, a torque has no scale to be seen by."""

RATES = (100.0, 125.0, 200.0, 500.0, 1000.0)
HARMONICS = 5
PATTERNS = {"q": "q{}", "dq": "dq{}", "ddq": "ddq{}", "effort": "tau{}"}
GRAVITY = 9.81

MASSES = {"panda": (3.0, 3.0, 2.8, 2.6, 2.9, 1.5, 0.8), "iiwa7-r800": (3.5, 3.5, 2.5, 2.6, 1.9, 1.8, 0.6)}
"""Arms that are described without inertias; these are of the size that publications give [kg]."""

MASS, COM, INERTIA = 0.15, 0.01, 0.3
"""Largest deviations of links from their description: shares of mass and inertia, centre of mass [m]."""


@dataclass(frozen=True, eq=False)
class Case:
    """A log, the arm that its reader believes in, and how he reads it.

    Attributes:
        robot: As described; gravity may be another than that of the lab.
        recording: What was logged.
        reading: How it is read.
        motion: What the arm did.
        torque: What its joints gave, without noise.
        fault: Name of the fault, empty for none.
        code: Code of the finding that names it.
        truth: Numbers of the fault, for those who check them.
    """

    robot: Robot
    recording: Recording
    reading: LogFormat
    motion: Motion
    torque: Array
    model: DynamicsModel
    theta: Array
    fault: str = ""
    code: str = ""
    truth: dict[str, Any] = field(default_factory=dict[str, Any])

    def logged(self, **changed: Any) -> Case:
        """The case with other channels of its recording."""
        log = replace(self.recording, **changed)
        return replace(self, recording=replace(log, columns=columns_of(log)))


@cache
def arm(name: str) -> Robot:
    return load_robot(name)


def true_parameters(model: DynamicsModel, rng: np.random.Generator, *, rotor: bool) -> Array:
    """Links that are off the description, friction of some percent of the joints' largest torque."""
    described = model.nominal_parameters()
    n, robot = model.n, model.robot
    theta = np.zeros(len(model.parameters)) if described is None else described.copy()
    for j in range(n):
        own = model.inertial_columns[10 * j : 10 * j + 10]
        if described is None:
            mass, com = MASSES[robot.name][j], rng.uniform(-0.06, 0.06, 3)
            inertia = mass * np.diag(rng.uniform(0.008, 0.012, 3))
        else:
            mass, com, inertia = vector_to_com_inertia(described[own])
        mass *= 1.0 + rng.uniform(-MASS, MASS)
        inertia = inertia * (1.0 + rng.uniform(-INERTIA, INERTIA))
        theta[own] = com_inertia_to_vector(mass, com + rng.uniform(-COM, COM, 3), inertia)
    effort = np.array([joint.effort_limit for joint in robot.joints])
    speed = np.array([joint.velocity_limit for joint in robot.joints])
    static, viscous = effort * rng.uniform(0.02, 0.05, n), effort / speed * rng.uniform(0.01, 0.05, n)
    values = {
        "FS": static,
        "FV": viscous,
        "FO": 0.2 * static * rng.standard_normal(n),
        "FT": static * rng.uniform(0.0, 0.2, n),
        "FSA": static * rng.uniform(-0.05, 0.05, n),
        "IA": (1.0 if rotor else 0.0) * effort * rng.uniform(0.005, 0.02, n),
    }
    for k, parameter in enumerate(model.parameters):
        if parameter.symbol in values:
            theta[k] = values[parameter.symbol][parameter.number - 1]
    return theta


def random_plan(robot: Robot, rng: np.random.Generator) -> Excitation:
    """Joints together, over a third to two thirds of their range, at up to three quarters of their speed."""
    period = rng.uniform(8.0, 14.0)
    limits = np.array([joint.position_limits for joint in robot.joints])
    speed = np.array([joint.velocity_limit for joint in robot.joints])
    middle, half = limits.mean(axis=1), np.minimum(np.diff(limits, axis=1)[:, 0] / 2, np.pi)
    a, b = rng.standard_normal((2, robot.n, HARMONICS))
    drawn = Excitation(2 * np.pi / period, a, b, np.zeros(robot.n)).sample(50.0)
    by_speed = rng.uniform(0.4, 0.75, robot.n) * speed / np.abs(drawn.dq).max(axis=0)
    by_range = rng.uniform(0.5, 0.8, robot.n) * half / np.abs(drawn.q).max(axis=0)
    scale = np.minimum(by_speed, by_range)[:, None]
    room = half - scale[:, 0] * np.abs(drawn.q).max(axis=0)
    return Excitation(2 * np.pi / period, scale * a, scale * b, middle + rng.uniform(-0.8, 0.8, robot.n) * room)


def sound(
    seed: int,
    *,
    name: str | None = None,
    robot: Robot | None = None,
    rotor: bool = False,
    gravity: Array | None = None,
    plan: Any = None,
) -> Case:
    """A log without a fault."""
    rng = np.random.default_rng((17, seed))
    robot = robot or arm(name or ARMS[int(rng.integers(len(ARMS)))])
    there = robot if gravity is None else robot.with_gravity(tuple(gravity))
    speed = float(rng.uniform(0.05, 0.15))
    terms = (RigidBody(), Viscous(), Coulomb(width=0.02), Offset(), RotorInertia())
    model = DynamicsModel(there, (*terms, Stribeck(velocity=speed, width=0.02), AsymmetricCoulomb(width=0.02)))
    theta = true_parameters(model, rng, rotor=rotor)
    rate = float(rng.choice(RATES))
    excitation = plan(robot, rng) if plan else random_plan(robot, rng)
    excitation = excitation.stretched(round(excitation.period * rate) / rate)
    noise = float(rng.uniform(0.003, 0.01)) * np.array([joint.effort_limit for joint in robot.joints])
    repetitions = 2 if excitation.period > 11.0 else 3
    log, motion, torque = record(model, theta, excitation, Sensors(1e-5, 0.0, rate), rng, repetitions=repetitions)
    motion = excitation.sample(rate, repetitions)
    torque = np.tile(torque, (repetitions, 1))
    assert log.effort is not None
    with_velocity = rng.random() < 0.6
    log = replace(
        log,
        effort=torque + noise * rng.standard_normal(log.effort.shape),
        dq=motion.dq + 2e-3 * rng.standard_normal(motion.dq.shape) if with_velocity else None,
        joint_names=(),
        consecutive=None,
    )
    log = replace(log, columns=columns_of(log))
    reading = LogFormat(period=excitation.period, start=0.0) if rng.random() < 0.5 else LogFormat()
    return Case(robot, log, reading, motion, torque, model, theta)


def columns_of(log: Recording) -> dict[str, tuple[str, ...]]:
    """Names that a table of the log would have."""
    found = {} if log.time is None else {"time": ("t",)}
    for name, pattern in PATTERNS.items():
        if getattr(log, name) is not None:
            found[name] = tuple(pattern.format(j + 1) for j in range(log.n))
    return found


# Faults ---------------------------------------------------------------------------------------------------------

Fault = Callable[[int], Case]


def _rng(seed: int) -> np.random.Generator:
    return np.random.default_rng((99, seed))


def torque_sign(seed: int) -> Case:
    case, rng = sound(seed), _rng(seed)
    sign = -np.ones(case.robot.n)
    if rng.random() < 0.5:  # only some of the joints
        sign = np.where(rng.random(case.robot.n) < 0.3, -1.0, 1.0)
        sign[rng.integers(case.robot.n)] = -1.0
    assert case.recording.effort is not None
    return replace(case.logged(effort=case.recording.effort * sign), truth={"sign": sign})


def position_sign(seed: int) -> Case:
    """One joint counts against the description; not the last, where a turned torque looks the same."""
    case, rng = sound(seed), _rng(seed)
    sign = np.ones(case.robot.n)
    sign[rng.integers(case.robot.n - 1)] = -1.0
    log = case.recording
    dq = None if log.dq is None else log.dq * sign
    return replace(case.logged(q=log.q * sign, dq=dq), truth={"sign": sign})


def joint_order(seed: int) -> Case:
    """Two channels exchanged, or all in reverse; of all quantities, of the torque or of the positions alone."""
    case, rng = sound(seed), _rng(seed)
    n = case.robot.n
    order = np.arange(n)
    if rng.random() < 0.25:
        order = order[::-1]
    else:
        i, j = rng.choice(n, 2, replace=False)
        order[[i, j]] = order[[j, i]]
    log = case.recording
    assert log.effort is not None
    which = int(rng.integers(3))
    if which == 0:
        return replace(case.logged(effort=log.effort[:, order]), truth={"order": order})
    dq = None if log.dq is None else log.dq[:, order]
    effort = log.effort if which == 1 else log.effort[:, order]
    return replace(case.logged(q=log.q[:, order], dq=dq, effort=effort), truth={"order": order})


def degrees(seed: int) -> Case:
    """Degrees that are read as radians, of all joints or of one, or radians that are read as degrees."""
    case, rng = sound(seed), _rng(seed)
    log = case.recording
    kind = int(rng.integers(3))
    if kind == 0:
        return replace(case, reading=replace(case.reading, units="deg"))
    unit = np.ones(case.robot.n)
    unit[slice(None) if kind == 1 else int(rng.integers(case.robot.n))] = 180.0 / np.pi
    return replace(case.logged(q=log.q * unit, dq=None if log.dq is None else log.dq * unit), truth={"unit": unit})


def position_offset(seed: int) -> Case:
    case, rng = sound(seed), _rng(seed)
    j = int(rng.integers(1, 4))  # the zeros of wrists hardly show in torques, that of a vertical joint not at all
    offset = np.zeros(case.robot.n)
    offset[j] = rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.6)
    return replace(case.logged(q=case.recording.q + offset), truth={"offset": offset})


def position_wrapped(seed: int) -> Case:
    """The joint that moves most passes the angle at which the log begins anew."""
    case = sound(seed)
    q = case.recording.q.copy()
    j = int(np.argmax(np.ptp(q, axis=0)))
    low = (q[:, j].min() + q[:, j].max()) / 2
    low -= 2 * np.pi if q[0, j] < low else 0.0
    q[:, j] = (q[:, j] - low) % (2 * np.pi) + low
    return case.logged(q=q)


def gravity_direction(seed: int) -> Case:
    rng = _rng(seed)
    directions = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0.5, 0, -0.866]], dtype=float)
    g = GRAVITY * directions[int(rng.integers(len(directions)))]
    return replace(sound(seed, gravity=g), truth={"gravity": g})


def motor_side(seed: int) -> Case:
    case, rng = sound(seed, name=DESCRIBED[seed % 3]), _rng(seed)
    ratio = rng.choice([80.0, 100.0, 120.0, 160.0], case.robot.n)
    log = case.recording
    assert log.effort is not None
    if rng.random() < 0.5:
        return replace(case.logged(effort=log.effort / ratio), truth={"ratio": ratio})
    dq = None if log.dq is None else log.dq * ratio
    return replace(case.logged(q=log.q * ratio, dq=dq, effort=log.effort / ratio), truth={"ratio": ratio})


def rotor_inertia_missing(seed: int) -> Case:
    return sound(seed, rotor=True)


def current_without_gain(seed: int) -> Case:
    case, rng = sound(seed, name=DESCRIBED[seed % 3]), _rng(seed)
    assert case.recording.effort is not None
    said = bool(rng.random() < 0.5)  # by the name of the column
    gain = rng.uniform(9.0, 16.0, case.robot.n)
    return case.logged(effort=case.recording.effort / gain, effort_is_current=said)


def clock_missing(seed: int) -> Case:
    return sound(seed).logged(time=None)


def clock_unit(seed: int) -> Case:
    """Time stamps in milliseconds, or in nanoseconds."""
    case, rng = sound(seed), _rng(seed)
    assert case.recording.time is not None
    unit = float(rng.choice([1e-3, 1e-9]))
    return replace(case.logged(time=case.recording.time / unit), truth={"unit": unit})


def time_scale(seed: int) -> Case:
    """Time stamps of another rate, by a factor of 2 or 4 either way, in a log without velocities."""
    case, rng = sound(seed), _rng(seed)
    assert case.recording.time is not None
    factor = float(rng.choice([2.0, 4.0])) ** float(rng.choice([-1.0, 1.0]))
    log = case.logged(time=case.recording.time * factor, dq=None, ddq=None)
    return replace(log, truth={"unit": 1.0 / factor})


def clock_jitter(seed: int) -> Case:
    case, rng = sound(seed), _rng(seed)
    time = case.recording.time
    assert time is not None
    step = float(np.median(np.diff(time)))
    return case.logged(time=np.sort(time + step * rng.uniform(-0.45, 0.45, len(time)) * rng.uniform(0.5, 1.0)))


def clock_gap(seed: int) -> Case:
    case, rng = sound(seed), _rng(seed)
    log = case.recording
    assert log.time is not None and log.effort is not None
    at = int(rng.uniform(0.2, 0.8) * log.samples)
    rate = 1.0 / float(np.median(np.diff(log.time)))
    keep = np.ones(log.samples, dtype=np.bool_)
    keep[at : at + max(4, int(rng.uniform(0.1, 1.0) * rate))] = False
    dq = None if log.dq is None else log.dq[keep]
    return case.logged(time=log.time[keep], q=log.q[keep], dq=dq, effort=log.effort[keep], valid=True)


def rows_repeated(seed: int) -> Case:
    case, rng = sound(seed), _rng(seed)
    log = case.recording
    again = np.arange(log.samples)
    for k in np.flatnonzero(rng.random(log.samples - 1) < rng.uniform(0.01, 0.1)) + 1:
        again[k] = again[k - 1]
    assert log.effort is not None
    return case.logged(q=log.q[again], dq=None if log.dq is None else log.dq[again], effort=log.effort[again])


def rows_not_consecutive(seed: int) -> Case:
    case, rng = sound(seed), _rng(seed)
    log, order = case.recording, rng.permutation(case.recording.samples)
    assert log.effort is not None
    return replace(
        case.logged(
            time=None, q=log.q[order], dq=case.motion.dq[order], ddq=case.motion.ddq[order], effort=log.effort[order]
        ),
        reading=LogFormat(rate=float(1.0 / case.motion.time[1])),
    )


def channel_delay(seed: int) -> Case:
    """The torque lags behind the positions by 10 to 40 ms."""
    case, rng = sound(seed), _rng(seed)
    log = case.recording
    assert log.effort is not None
    rate = 1.0 / float(case.motion.time[1])
    samples = max(2, round(rng.uniform(0.01, 0.04) * rate)) * int(rng.choice([-1, 1]))
    return replace(case.logged(effort=np.roll(log.effort, samples, axis=0)), truth={"delay": samples / rate})


def joint_delay(seed: int) -> Case:
    """Position and velocity of the joint that lifts the arm lag; a wrist is hardly felt by the others."""
    case, rng = sound(seed), _rng(seed)
    log, j = case.recording, 1
    rate = 1.0 / float(case.motion.time[1])
    samples = max(2, round(rng.uniform(0.05, 0.08) * rate))
    q, dq = log.q.copy(), None if log.dq is None else log.dq.copy()
    for values in (q, dq):
        if values is not None:
            values[:, j] = np.roll(values[:, j], samples)
    return replace(case.logged(q=q, dq=dq), truth={"delay": samples / rate, "joint": j})


def torque_gain(seed: int) -> Case:
    """The torque of one loaded joint has another scale, or another unit."""
    case, rng = sound(seed), _rng(seed)
    assert case.recording.effort is not None
    j, factor = int(rng.integers(1, 4)), float(rng.choice([0.4, 0.5, 1.8, 2.5, 0.1, 10.0, 1000.0]))
    effort = case.recording.effort.copy()
    effort[:, j] *= factor
    return replace(case.logged(effort=effort), truth={"factor": factor, "joint": j})


def velocity_mismatch(seed: int) -> Case:
    """One joint's velocity has another sign or scale or is that of its neighbour, or all of them lag."""
    case, rng = sound(seed), _rng(seed)
    dq = case.motion.dq + 2e-3 * rng.standard_normal(case.motion.dq.shape)
    j, kind = int(rng.integers(case.robot.n)), int(rng.integers(4))
    if kind == 0:
        dq[:, j] *= -1.0
    elif kind == 1:
        dq[:, j] *= rng.choice([0.5, 1.2, 2.0, 180 / np.pi])
    elif kind == 2:
        k = (j + 1) % case.robot.n
        dq[:, [j, k]] = dq[:, [k, j]]
    else:
        dq = np.roll(dq, max(2, round(0.04 / float(case.motion.time[1]))), axis=0)
    return replace(case.logged(dq=dq), truth={"kind": kind, "joint": j})


def saturation(seed: int) -> Case:
    case, rng = sound(seed), _rng(seed)
    assert case.recording.effort is not None
    effort = case.recording.effort.copy()
    j = int(rng.integers(case.robot.n))
    level = np.quantile(np.abs(effort[:, j]), rng.uniform(0.85, 0.97))
    effort[:, j] = np.clip(effort[:, j], -level, level)
    return replace(case.logged(effort=effort), truth={"joint": j})


def spikes(seed: int) -> Case:
    """A few lost packets, logged as zeros of positions, or bit errors of the torque or the velocity of a joint."""
    case, rng = sound(seed), _rng(seed)
    log = case.recording
    kinds = ["q", "effort", *([] if log.dq is None else ["dq"])]
    name = str(rng.choice(kinds))
    values = np.array(getattr(log, name))
    rows = rng.choice(log.samples, int(rng.integers(1, 12)), replace=False)
    if name == "q":
        values[rows] = 0.0
    else:
        j = int(rng.integers(case.robot.n))
        joint = case.robot.joints[j]
        limit = joint.effort_limit if name == "effort" else joint.velocity_limit
        values[rows, j] = rng.choice([-1.0, 1.0], len(rows)) * rng.uniform(2.0, 20.0, len(rows)) * limit
    return replace(case.logged(**{name: values}), truth={"quantity": name, "rows": np.sort(rows)})


def channel_dead(seed: int) -> Case:
    """A channel that is constant throughout, or sticks from some time on."""
    case, rng = sound(seed), _rng(seed)
    log = case.recording
    assert log.effort is not None
    name = str(rng.choice(["q", "effort"]))
    values = np.array(getattr(log, name))
    j, kind = int(rng.integers(case.robot.n)), int(rng.integers(3))
    first = int(rng.uniform(0.2, 0.8) * log.samples)
    last = log.samples if kind == 1 else first + int(rng.uniform(0.05, 0.15) * log.samples)
    if kind == 0:
        values[:, j] = 0.0
    else:
        values[first:last, j] = values[first, j]
    return replace(case.logged(**{name: values}), truth={"kind": kind, "joint": j})


def value_missing(seed: int) -> Case:
    """Numbers that are none, in one channel: a row, some segments, or all of it."""
    case, rng = sound(seed), _rng(seed)
    name = str(rng.choice(["q", "effort"]))
    values = np.array(getattr(case.recording, name))
    j, kind = int(rng.integers(case.robot.n)), int(rng.integers(3))
    if kind == 2:
        values[:, j] = np.nan
    else:
        for first in rng.integers(0, len(values) - 20, 1 + 2 * kind):
            values[first : first + 1 + 10 * kind, j] = np.nan
    return replace(case.logged(**{name: values}), truth={"kind": kind, "joint": j})


def filtered_before_logging(seed: int) -> Case:
    case, rng = sound(seed), _rng(seed)
    assert case.recording.effort is not None
    rate = 1.0 / float(case.motion.time[1])
    low = butterworth(int(rng.integers(2, 5)), float(rng.uniform(0.05, 0.12)) * rate, rate)
    return case.logged(effort=zero_phase(low, case.recording.effort))


def period_misaligned(seed: int) -> Case:
    """The later repetitions begin late: the plan went on after a pause that the log does not show."""
    case, rng = sound(seed), _rng(seed)
    log, rate = case.recording, 1.0 / float(case.motion.time[1])
    period = case.reading.period or _period(case)
    samples, late = round(period * rate), max(3, round(rng.uniform(0.02, 0.2) * rate))
    index = np.arange(log.samples)
    index[samples:] -= late
    assert log.effort is not None
    changed = case.logged(q=log.q[index], dq=None if log.dq is None else log.dq[index], effort=log.effort[index])
    return replace(changed, reading=LogFormat(period=period, start=0.0), truth={"late": late / rate})


def _period(case: Case) -> float:
    q, rate = case.motion.q, 1.0 / float(case.motion.time[1])
    for repetitions in (3, 2):
        samples = len(q) // repetitions
        if len(q) % repetitions == 0 and np.allclose(q[:samples], q[samples : 2 * samples], atol=1e-9):
            return samples / rate
    raise AssertionError("the motion does not repeat")


def excitation_weak(seed: int) -> Case:
    """One joint after the other, each by a little."""

    def timid(robot: Robot, rng: np.random.Generator) -> Excitation:
        plan = random_plan(robot, rng)
        share = np.full((robot.n, 1), 0.05)
        share[int(rng.integers(robot.n))] = 0.3
        return replace(plan, a=plan.a * share, b=plan.b * share)

    return sound(seed, plan=timid)


def temperature_drift(seed: int) -> Case:
    """Friction falls to two thirds or a half while the arm warms up."""
    case, rng = sound(seed), _rng(seed)
    assert case.recording.effort is not None
    friction = np.where([p.symbol in ("FV", "FS") for p in case.model.parameters], case.theta, 0.0)
    torque = case.model.torque(case.motion, friction)
    share = np.linspace(0.0, -rng.uniform(0.35, 0.5), len(torque))[:, None]
    return case.logged(effort=case.recording.effort + share * torque)


def contact(seed: int) -> Case:
    """Somebody pushes for a moment: a force at the tip, felt by every joint."""
    case, rng = sound(seed), _rng(seed)
    assert case.recording.effort is not None
    time = case.motion.time
    at, wide = rng.uniform(0.25, 0.75) * time[-1], rng.uniform(0.15, 0.4)
    push = np.exp(-0.5 * ((time - at) / wide) ** 2)[:, None]
    limits = np.array([joint.effort_limit for joint in case.robot.joints])
    direction = rng.standard_normal(3)
    felt = felt_at_tip(case.robot, case.motion.q, direction / np.linalg.norm(direction)) * push
    share = float(np.abs(felt / limits).max())
    return case.logged(effort=case.recording.effort + rng.uniform(0.15, 0.4) / share * felt)


def felt_at_tip(robot: Robot, q: Array, force: Array) -> Array:
    """Torque (N, n) that joints need against a force at the tip, in the base frame: Jᵀ f with the other sign."""
    R, p = forward_kinematics(robot, q)
    tip = frame_pose(robot, q)[1]
    torque = np.empty_like(q)
    for j, joint in enumerate(robot.joints):
        axis = R[:, j] @ joint.axis
        arm = axis if joint.is_prismatic else np.cross(axis, tip - p[:, j])
        torque[:, j] = -arm @ force
    return torque


FAULTS: dict[str, Fault] = {
    fault.__name__.replace("_", "-"): fault
    for fault in (
        torque_sign, position_sign, joint_order, degrees, position_offset, position_wrapped, gravity_direction,
        motor_side, rotor_inertia_missing, current_without_gain, clock_missing, clock_unit, time_scale, clock_jitter,
        clock_gap, rows_repeated, rows_not_consecutive, channel_delay, joint_delay, torque_gain, velocity_mismatch,
        saturation, spikes, channel_dead,
        value_missing, filtered_before_logging, period_misaligned, excitation_weak, temperature_drift, contact,
    )
}  # fmt: skip
"""Faults by the code of the finding that names each."""
