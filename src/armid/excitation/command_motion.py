"""Motion of commands for position servos: samples that a program sends one after another."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.input_boundary import boundary, read_text, within
from armid.robot.robot import Robot

WIDEST = 1.5
"""Largest distance of a command from the middle of an unlimited joint [rad or m]."""

USUAL_SPEED = 2.0
"""Largest speed of a random command, and of a joint whose description states no limit [rad/s or m/s]."""

MARGIN = 0.02
"""Share of the range of a joint that is kept at each end of it."""

SINES = 5
"""Number of sines of a random motion, joint by joint."""

SLOWEST, FASTEST = 0.05, 1.2
"""Frequencies between which those of a random motion lie [Hz]."""

RAMP = 1.0
"""Time in which a random motion begins and ends [s]."""


@dataclass(frozen=True, eq=False, slots=True)
class CommandMotion:
    """Commands of n joints at a constant rate, each held until the next one.

    Attributes:
        rate: Commands per second [Hz].
        command: Commands, shape (N, n) [rad or m].
    """

    rate: float
    command: Array

    def __post_init__(self) -> None:
        command = array(self.command, (None, None), "command")
        if not 0.0 < self.rate < np.inf or len(command) < 2:
            raise ArmidError(
                f"A motion of commands needs a positive rate and at least two rows; found {self.rate:g} Hz and "
                f"{len(command)} rows.",
                remedy="give the time of each row in the column t.",
            )
        object.__setattr__(self, "command", command)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.command.shape[1]

    @property
    def time(self) -> Array:
        """Times of the commands, shape (N,) [s]."""
        return np.arange(len(self.command)) / self.rate

    @property
    def seconds(self) -> float:
        """Duration [s]."""
        return len(self.command) / self.rate

    def repeated(self, times: int) -> CommandMotion:
        """The motion, several times in a row."""
        within("motion", times * len(self.command), "A motion of commands")
        return CommandMotion(self.rate, np.tile(self.command, (times, 1)))

    def csv(self) -> str:
        """Text of a table with the columns t, command1, command2 and so on."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["t", *(f"command{j + 1}" for j in range(self.n))])
        writer.writerows(np.column_stack([self.time, self.command]).tolist())
        return text.getvalue()


def load_commands(path: Path | str) -> CommandMotion:
    """Reads a motion of commands from a table with the columns t, command1, command2 and so on.

    Raises:
        ArmidError: The file is missing, or is no such table with uniform times.
    """
    remedy = "give a CSV file with the columns t, command1, command2, …, as `armid excite --servo` writes it."
    text = read_text(Path(path), "commands", ArmidError, remedy=remedy)
    with boundary("commands", path, ArmidError, remedy=remedy):
        rows = list(csv.reader(text.splitlines()))
        names = [f"command{j + 1}" for j in range(len(rows[0]) - 1)] if rows else []
        if not names or rows[0] != ["t", *names]:
            found = ", ".join(rows[0][:8]) if rows else "nothing"
            raise ArmidError(f"{path} has other columns than t, command1, …: {found}.", remedy=remedy)
        table = array([[float(x) for x in row] for row in rows[1:]], (None, len(rows[0])), f"the table of {path}")
    steps = np.diff(table[:, 0])
    step = float(np.mean(steps)) if len(steps) else 0.0
    if not step > 0.0 or np.abs(steps - step).max() > 0.01 * step:
        raise ArmidError(f"The times in {path} are not uniform.", remedy="give rows at a constant rate.")
    return CommandMotion(float(f"{1.0 / step:.9g}"), table[:, 1:])


def command_ranges(robot: Robot) -> tuple[Array, Array, Array]:
    """Lowest and highest command of each joint [rad or m], and its largest speed [rad/s or m/s], shape (n,) each."""
    limits = np.array([joint.position_limits for joint in robot.joints], dtype=np.float64)
    low, high = limits[:, 0], limits[:, 1]
    low = np.where(np.isfinite(low), low, np.where(np.isfinite(high), high - 2.0 * WIDEST, -WIDEST))
    high = np.where(np.isfinite(high), high, low + 2.0 * WIDEST)
    speed = np.array([joint.velocity_limit for joint in robot.joints])
    spare = MARGIN * (high - low)
    return low + spare, high - spare, np.where(np.isfinite(speed) & (speed > 0.0), speed, USUAL_SPEED)


def random_commands(robot: Robot, seconds: float, rate: float, rng: np.random.Generator) -> CommandMotion:
    """Random sums of sines within the limits of position and speed.

    Args:
        robot: The arm.
        seconds: Duration [s].
        rate: Commands per second [Hz].
        rng: Random generator.
    """
    within("motion", seconds * rate, f"A motion of {seconds:.4g} s at {rate:.4g} Hz")
    low, high, speed = command_ranges(robot)
    reach = np.minimum(0.5 * (high - low), WIDEST)
    t = np.arange(max(2, round(seconds * rate))) / rate
    wave = np.zeros((len(t), robot.n))
    for _ in range(SINES):
        f = np.exp(rng.uniform(np.log(SLOWEST), np.log(FASTEST), robot.n))
        phase = rng.uniform(0.0, 2.0 * np.pi, robot.n)
        wave += np.minimum(1.0, 0.4 / f) * rng.uniform(0.3, 1.0, robot.n) * np.sin(2 * np.pi * f * t[:, None] + phase)
    s = np.clip(np.minimum(t, t[-1] - t) / RAMP, 0.0, 1.0)[:, None]
    wave *= s * s * (3.0 - 2.0 * s)
    wave *= 0.7 * reach / np.maximum(np.abs(wave).max(axis=0), 1e-12)
    fastest = np.abs(np.diff(wave, axis=0)).max(axis=0) * rate
    wave *= np.minimum(1.0, np.minimum(speed, USUAL_SPEED) / np.maximum(fastest, 1e-12))
    room = reach - np.abs(wave).max(axis=0)
    return CommandMotion(rate, 0.5 * (low + high) + rng.uniform(-1.0, 1.0, robot.n) * room + wave)
