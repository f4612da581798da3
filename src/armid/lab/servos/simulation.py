"""Simulation of a recording of an arm with servos: commands and measured positions, without any torque."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, LabError
from armid.excitation.command_motion import CommandMotion
from armid.hashes import digest
from armid.lab.faults import spoil
from armid.lab.plant import Plant, stable_rate
from armid.lab.sensors import MOST_JITTER, logged_values
from armid.lab.servos.options import ServoLabOptions
from armid.lab.servos.virtual_arms import KnownServoArm
from armid.lab.simulated_motion import MARGIN, PROGRESS_INTERVAL, Tell, TrueMotion
from armid.lab.simulation import plain_record, true_model
from armid.measurement.recording import Recording
from armid.model.base_parameters import find_base_parameters
from armid.robot.robot import Robot

SETTLE = 1.5
"""Time for which the first command is held before the log begins [s]."""

POSES = 60
"""Number of commands in which the eigenfrequency of springs is computed."""

SATURATED = 0.05
"""Share of the time at the largest torque from which a finding says so."""


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedServoArm:
    """Result of the simulation of an arm with servos.

    Attributes:
        recording: The log, with commands and positions.
        trace: True motion.
        truth: The virtual arm.
        robot: Description of the arm, whose links differ from the true ones.
        commands: Commands that were sent.
        options: Options of the simulation.
        seed: Seed of noise, jitter and faults.
    """

    recording: Recording
    trace: TrueMotion
    truth: KnownServoArm
    robot: Robot
    commands: CommandMotion
    options: ServoLabOptions
    seed: int


def simulate_servo(
    truth: KnownServoArm,
    commands: CommandMotion,
    options: ServoLabOptions,
    *,
    seed: int = 1,
    tell: Tell | None = None,
) -> SimulatedServoArm:
    """Simulates an arm whose servos follow commands, and the log of its bus.

    The bus sends a command and reads the encoders at each sample. The servos control the drives at every step.

    Args:
        truth: The arm.
        commands: Commands; at another rate than that of the bus, each is held until the next one.
        options: Encoders, bus and faults.
        seed: Seed of noise, jitter and faults; the same seed gives the same log.
        tell: Function that is called with the share of the simulation that is done.

    Raises:
        LabError: The commands do not fit the arm, or the simulation became unstable.
        MissingExtraError: MuJoCo is not installed.
    """
    robot, sensing = truth.arm.robot, options.sensing
    if commands.n != robot.n:
        raise LabError(
            f"The commands are for {commands.n} joints; {robot.name} has {robot.n}.",
            remedy="give commands for this arm, or lock the joints that do not move with --lock.",
        )
    whole = commands.repeated(options.repetitions)
    rng = np.random.default_rng(seed)
    even = np.arange(round(whole.seconds * sensing.rate)) / sensing.rate
    most = MOST_JITTER / sensing.rate
    taken = even + np.clip(rng.normal(0.0, sensing.jitter, len(even)), -most, most) if sensing.jitter else even
    held = np.clip(np.floor(even * whole.rate + 1e-6).astype(np.intp), 0, len(whole.command) - 1)
    sent = whole.command[held]
    trace = _follow(truth, taken, sent, _rate(truth, sent, options), tell)
    links = sensing.side == "link" or trace.drive_q is None
    q, dq = (trace.q, trace.dq) if links else (trace.drive_q, trace.drive_dq)
    assert q is not None and dq is not None
    logged: dict[str, Any] = {"q": logged_values(trace.time, q, taken, sensing.position, rng), "command": sent}
    if sensing.velocity is not None:
        logged["dq"] = logged_values(trace.time, dq, taken, sensing.velocity, rng)
    recording = Recording(
        time={"true": taken, "even": even, "none": None}[sensing.stamps],
        rate=sensing.rate if sensing.stamps == "none" else None,
        joint_names=robot.joint_names,
        consecutive=True,
        source=f"virtual {robot.name}",
        sha256=digest(*logged.values()),
        **logged,
    )
    if options.faults:
        recording = spoil(recording, options.faults, seed)
    return SimulatedServoArm(recording, trace, truth, robot, commands, options, seed)


def _rate(truth: KnownServoArm, sent: Array, options: ServoLabOptions) -> float:
    """Number of simulation steps per second [Hz]: a multiple of the bus's rate with which the springs are stable."""
    poses = sent[:: max(1, len(sent) // POSES)]
    least = max(options.physics_rate, stable_rate(truth.arm, poses))
    return options.sensing.rate * max(1, math.ceil(least / options.sensing.rate))


def _follow(truth: KnownServoArm, taken: Array, sent: Array, rate: float, tell: Tell | None) -> TrueMotion:
    """True motion under commands (N, n) sent at times (N,) [s], from `MARGIN` before the first sample on."""
    n, h = truth.arm.robot.n, 1.0 / rate
    rows = round((MARGIN + taken[-1] + 2.0 * h) * rate)
    time = h * np.arange(-round(MARGIN * rate), rows - round(MARGIN * rate), dtype=np.float64)
    target = np.empty((rows, n))
    for j in range(n):
        last = np.searchsorted(taken + truth.delay[j], time + 1e-9, side="right") - 1
        target[:, j] = sent[np.clip(last, 0, len(sent) - 1), j]
    target -= truth.offset
    plant = Plant(truth.arm, h, target[0], np.zeros(n))
    for _ in range(round(SETTLE * rate)):
        plant.step(_torque(truth, target[0], plant))
    names = ["q", "dq", "ddq", "effort", "friction"]
    names += ["drive_q", "drive_dq", "drive_ddq"] if truth.arm.stiffness is not None else []
    stored = {name: np.empty((rows, n)) for name in names}
    for k in range(rows):
        instant = plant.step(_torque(truth, target[k], plant))
        for name, values in stored.items():
            values[k] = getattr(instant, name)
        if tell is not None and k % PROGRESS_INTERVAL == 0:
            tell(k / rows)
    acceleration = stored.pop("drive_ddq", stored["ddq"])
    transmitted = stored["effort"] - stored["friction"] - truth.arm.rotor * acceleration
    return TrueMotion(time, **stored, transmitted=transmitted)


def _torque(truth: KnownServoArm, target: Array, plant: Plant) -> Array:
    """Torque of the servos (n,) [N·m or N] for targets (n,) [rad or m]."""
    torque = truth.stiffness * (target - plant.drive_q) - truth.damping * plant.drive_dq
    return np.minimum(np.maximum(torque, -truth.limit), truth.limit)


def servo_findings(simulated: SimulatedServoArm) -> tuple[Finding, ...]:
    """Findings about a simulated motion in which servos are at their largest torque for long."""
    trace, limit = simulated.trace.from_time(0.0), simulated.truth.limit
    share = np.mean(np.abs(trace.effort) >= limit * (1.0 - 1e-9), axis=0)
    return tuple(
        Finding(
            "drive-saturated",
            "warning",
            joint.name,
            f"reaches the largest torque of its servo in {part:.0%} of the time.",
            "slow the commands down, or make them smaller.",
        )
        for joint, part in zip(simulated.robot.joints, share, strict=True)
        if part >= SATURATED
    )


def servo_truth_record(simulated: SimulatedServoArm, recording_sha256: str) -> dict[str, Any]:
    """Content of `truth.json`: the virtual arm, and the values that an identification should find."""
    truth = simulated.truth
    model, theta = true_model(truth.arm)
    base = find_base_parameters(model)
    return {
        "robot": simulated.robot.name,
        "joints": simulated.robot.joint_names,
        "gravity": simulated.robot.gravity,
        "recording_sha256": recording_sha256,
        "seed": simulated.seed,
        "commands": {"rate": simulated.commands.rate, "rows": len(simulated.commands.command)},
        "parameters": {p.name: value for p, value in zip(model.parameters, theta, strict=True)},
        "base_parameters": dict(zip(base.names, base.values_of(theta), strict=True)),
        "friction": plain_record(truth.arm.friction),
        "rotor": truth.arm.rotor,
        "stiffness": truth.arm.stiffness,
        "spring_damping": truth.arm.spring_damping,
        "backlash": truth.arm.backlash,
        "servo": {name: getattr(truth, name) for name in ("stiffness", "damping", "delay", "offset", "limit")},
        "options": plain_record(simulated.options),
    }
