"""Simulation of an arm with servos, and files with the log, the true values and the description of the arm."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armid.errors import OutputError
from armid.excitation.command_motion import CommandMotion, load_commands, random_commands
from armid.lab.servos.options import ServoLabOptions
from armid.lab.servos.simulation import SimulatedServoArm, servo_truth_record, simulate_servo
from armid.lab.servos.virtual_arms import VIRTUAL_ARMS, description_of, known_servo_arm
from armid.measurement.writers.lerobot import DATA, INFO, Episode, lerobot_files
from armid.measurement.writing import WRITERS, recording_bytes
from armid.output.file_group import replace_files
from armid.robot.robot import Robot
from armid.study.plans.plan_reading import series_of
from armid.study.plans.simulation_files import NOISE_FREE, RECORDING, TRUTH, refuse_format
from armid.study.storage.records import to_json

LEROBOT = "lerobot"
"""Name of the format of a LeRobot data set, a folder."""

SEED_OF_MOTION = 1000
"""Number that is added to the seed of a random motion, so that it differs from that of the noise."""


@dataclass(frozen=True, eq=False, slots=True)
class WrittenServoSimulation:
    """Files of a simulation of an arm with servos.

    Attributes:
        simulated: Result of the simulation.
        recording: Path of the log.
        truth: Path of the JSON file with the true values.
        description: Path of the description, if the arm is one of armid's own virtual arms.
    """

    simulated: SimulatedServoArm
    recording: Path
    truth: Path
    description: Path | None


def servo_description(name: str) -> str:
    """Path of the description if the name is that of a virtual arm of armid, otherwise the name."""
    return str(description_of(name)) if name in VIRTUAL_ARMS and not Path(name).exists() else name


def commands_of(
    plan: str | None, robot: Robot, rate: float, seconds: float, seed: int, period: float | None = None
) -> CommandMotion:
    """Commands of a table, of a plan, or of a random motion if there is no plan.

    Args:
        plan: CSV file with commands, plan of `armid excite` or name of a built-in plan.
        robot: The arm.
        rate: Commands per second for a plan and a random motion [Hz].
        seconds: Duration of a random motion [s].
        seed: Seed of a random motion.
        period: Period to which a plan is slowed down or sped up [s].
    """
    if plan is None:
        return random_commands(robot, seconds, rate, np.random.default_rng(SEED_OF_MOTION + seed))
    path = Path(plan) / "commands.csv" if (Path(plan) / "commands.csv").is_file() else Path(plan)
    if path.suffix == ".csv":
        return load_commands(path)
    series = series_of(plan) if period is None else series_of(plan).stretched(period)
    return CommandMotion(rate, series.sample(rate).q)


def simulate_servo_to(
    folder: Path | str,
    robot: Robot,
    commands: CommandMotion,
    options: ServoLabOptions,
    *,
    kind: str = "csv",
    seed: int = 1,
    noise_free: bool = False,
    tell: Callable[[float], None] | None = None,
) -> WrittenServoSimulation:
    """Simulates an arm and writes `recording.*`, `truth.json` and the description of a virtual arm into a folder.

    The files of an earlier simulation in this folder are replaced, all of them or none.

    Args:
        folder: Output folder; files that are not of a simulation are not changed.
        robot: The arm.
        commands: The motion.
        options: Options of the simulation.
        kind: Format of the recording: a suffix without the dot, or `lerobot` for a data set with angles in degrees.
        seed: Seed of noise, jitter and faults.
        noise_free: True if motion and torque without noise are written, too.
        tell: Function that is called with the share of the simulation that is done.
    """
    refuse_servo_format(kind, robot)
    done = simulate_servo(known_servo_arm(robot, options), commands, options, seed=seed, tell=tell)
    files: dict[str, bytes | str] = {}
    if kind == LEROBOT:
        assert done.recording.command is not None
        episode = Episode(done.recording.command, done.recording.q)
        written = lerobot_files([episode], robot.joint_names, options.sensing.rate, robot.name)
        files |= {f"{RECORDING}/{path}": content for path, content in written.items()}
        log, content = f"{RECORDING}/{DATA}", written[DATA]
    else:
        log = f"{RECORDING}.{kind.lstrip('.')}"
        content = recording_bytes(done.recording, Path(log).suffix)
        files[log] = content
    files[TRUTH] = to_json(servo_truth_record(done, hashlib.sha256(content).hexdigest())) + "\n"
    own = robot.name in VIRTUAL_ARMS
    if own:
        files[f"{robot.name}.xml"] = description_of(robot.name).read_bytes()
    if noise_free:
        files[NOISE_FREE] = _archive(done)
    stale = [NOISE_FREE, *(f"{RECORDING}{each}" for each in WRITERS)]
    stale += [f"{RECORDING}/{DATA}", f"{RECORDING}/{INFO}", *(f"{name}.xml" for name in VIRTUAL_ARMS)]
    replace_files(folder, files, stale=stale)
    place = Path(folder)
    recording = place / (RECORDING if kind == LEROBOT else log)
    return WrittenServoSimulation(done, recording, place / TRUTH, place / f"{robot.name}.xml" if own else None)


def refuse_servo_format(kind: str, robot: Robot) -> None:
    """Raises an error, before any work is done, if a format cannot be written."""
    if kind != LEROBOT:
        refuse_format(kind)
    elif any(joint.is_prismatic for joint in robot.joints):
        raise OutputError(
            f"A LeRobot data set has angles in degrees, but {robot.name} has sliding joints.",
            possible=", ".join(suffix[1:] for suffix in WRITERS),
            remedy="choose another --format.",
        )


def _archive(done: SimulatedServoArm) -> bytes:
    """Content of an NPZ file with the true motion at the rate of the bus, without jitter of its clock."""
    trace = done.trace.from_time(0.0)
    every = round(1.0 / (done.options.sensing.rate * (trace.time[1] - trace.time[0])))
    names = {name: getattr(trace, name) for name in trace.__slots__}
    buffer = io.BytesIO()
    np.savez(buffer, **{name: x[::every] for name, x in names.items() if x is not None})
    return buffer.getvalue()
