"""Options of the simulation of an arm with position servos; keys of a `lab.toml` are the fields of the classes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array, array
from armid.errors import LabError
from armid.input_boundary import boundary, read_toml
from armid.lab.faults import Fault
from armid.lab.options import Arm, made
from armid.lab.sensors import Sensing, SensorChannel

TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False, slots=True)
class Servo:
    """Servos of an arm: the torque K (c(t - δ) - q - b) - D q̇ for the command c, limited to ± the largest torque.

    One number holds for all joints. What is not given is that of the arm.

    Attributes:
        stiffness: K, shape (n,) [N·m/rad or N/m].
        damping: D, shape (n,) [N·m·s/rad or N·s/m].
        delay: δ, shape (n,) [s].
        offset: b, shape (n,) [rad or m].
        limit: Largest torque, shape (n,) [N·m or N].
    """

    stiffness: Array | None = None
    damping: Array | None = None
    delay: Array | None = None
    offset: Array | None = None
    limit: Array | None = None

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if value is None:
                continue
            given = array(np.atleast_1d(value), (None,), name)
            object.__setattr__(self, name, given)
            least = np.nextafter(0.0, 1.0) if name in ("stiffness", "limit") else 0.0
            if name != "offset" and (given < least).any():
                wanted = "above 0" if least else "0 or more"
                raise LabError(
                    f"The key `{name}` of a servo must be {wanted}; found {given.min():g}.",
                    remedy=f"correct `{name}` in the table [servo].",
                )

    def each(self, name: str, usual: Array) -> Array:
        """Values of a field for the joints of an arm, shape (n,); `usual`, shape (n,), if it is not given."""
        value = getattr(self, name)
        if value is None:
            return usual
        if value.size not in (1, usual.size):
            raise LabError(
                f"The key `{name}` of the servos has {value.size} values for {usual.size} joints.",
                remedy="give one value, or one for each joint.",
            )
        return np.broadcast_to(value, usual.shape).copy()


def _usual_sensing() -> Sensing:
    return Sensing(rate=50.0, position=SensorChannel(resolution=TURN / 2**12), side="link")


@dataclass(frozen=True, eq=False, slots=True)
class ServoLabOptions:
    """Options of the simulation of an arm with servos.

    Attributes:
        repetitions: Number of repetitions of the commands.
        physics_rate: Smallest number of simulation steps per second [Hz]; springs of gears may need more.
        link_deviation: Relative deviation of the true links from those of the description.
        arm_seed: Seed of the true links.
        arm: Friction, rotors, gears and effects that replace those of the arm or are added to them.
        servo: Servos.
        sensing: Encoders, rate and clock of the bus; the commands are sent at the times of the samples.
        faults: Faults that are added to the log.
    """

    repetitions: int = 1
    physics_rate: float = 2000.0
    link_deviation: float = 0.05
    arm_seed: int = 1
    arm: Arm = field(default_factory=Arm)
    servo: Servo = field(default_factory=Servo)
    sensing: Sensing = field(default_factory=_usual_sensing)
    faults: tuple[Fault, ...] = ()

    def __post_init__(self) -> None:
        if self.repetitions < 1 or isinstance(self.repetitions, bool):
            raise LabError(
                f"The number of repetitions must be a whole number of at least 1; found {self.repetitions}.",
                remedy="correct the key `repetitions` of the lab.toml.",
            )
        if not (self.physics_rate > 0.0 and 0.0 <= self.link_deviation <= 0.5):
            raise LabError(
                f"`physics_rate` must be positive and `link_deviation` from 0 to 0.5; found {self.physics_rate:g} "
                f"and {self.link_deviation:g}.",
                remedy="correct these keys of the lab.toml.",
            )


def servo_lab_table(path: Path | str) -> dict[str, Any]:
    """Tables of a `lab.toml`.

    Raises:
        LabError: The file is missing or not TOML.
    """
    return dict(read_toml(Path(path), "options of the lab", LabError, remedy="give the path of a lab.toml."))


def servo_lab_options(*tables: Mapping[str, Any]) -> ServoLabOptions:
    """Options from tables of a `lab.toml`; keys of later ones replace those of earlier ones.

    Raises:
        LabError: A key is unknown, or a value is wrong.
    """
    whole: dict[str, Any] = {}
    for table in tables:
        whole = _replaced(whole, table)
    sensing = whole.setdefault("sensing", {})
    if not isinstance(sensing, dict):
        raise LabError(
            f"`sensing` of the lab.toml must be a table; found {sensing!r}.", remedy="write [sensing] and its keys."
        )
    sensing.setdefault("rate", _usual_sensing().rate)
    sensing.setdefault("side", _usual_sensing().side)
    sensing.setdefault("position", {"resolution": TURN / 2**12})
    with boundary("options of the lab", "lab.toml", LabError, remedy="correct the keys that docs/lab.md explains."):
        return made(ServoLabOptions, whole, "lab.toml")


def _replaced(old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
    """Table `old` with the values of `new`, table by table."""
    result = dict(old)
    for key, value in new.items():
        both = isinstance(value, Mapping) and isinstance(result.get(key), Mapping)
        result[key] = _replaced(result[key], value) if both else value
    return result
