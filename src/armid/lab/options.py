"""Options of a simulation, and reader of a file `lab.toml` with them; keys are the fields of the classes."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import ArmidError, LabError, did_you_mean
from armid.input_boundary import boundary, read_toml
from armid.lab.controller import Controller, Drive
from armid.lab.faults import FAULTS, Fault
from armid.lab.friction import Friction
from armid.lab.known_arms import KnownArm, with_effects
from armid.lab.pushes import Push
from armid.lab.sensors import Sensing

T = TypeVar("T")

MODES = ("closed-loop", "inverse-dynamics")
"""Modes of a simulation, the values of the key `mode` of a `lab.toml`."""


@dataclass(frozen=True, eq=False, slots=True)
class Arm:
    """Properties of a simulated arm that replace the built-in ones or are added to them.

    Attributes:
        effects: Names of additional effects, keys of `armid.lab.known_arms.EFFECTS`. Most effects are proportional to
            the friction of the arm.
        friction: Friction that replaces the built-in one.
        rotor: Rotor inertia, shape (n,) [kg·m² or kg].
        stiffness: Stiffness of elastic drives, shape (n,) [N·m/rad or N/m].
        spring_damping: Damping of elastic drives, shape (n,) [N·m·s/rad or N·s/m].
        backlash: Play of elastic drives, from one side to the other, shape (n,) [rad or m].
    """

    effects: tuple[str, ...] = ()
    friction: Friction | None = None
    rotor: Array | None = None
    stiffness: Array | None = None
    spring_damping: Array | None = None
    backlash: Array | None = None

    def of(self, truth: KnownArm) -> KnownArm:
        """Applies the properties to a simulated arm; most effects are proportional to `friction`, if it is given."""
        if self.friction is not None:
            truth = replace(truth, friction=self.friction)
        truth = with_effects(truth, self.effects)
        given = {name: getattr(self, name) for name in ("rotor", "stiffness", "spring_damping", "backlash")}
        return replace(truth, **{name: value for name, value in given.items() if value is not None})


@dataclass(frozen=True, eq=False, slots=True)
class LabOptions:
    """Options of a simulation.

    Attributes:
        mode: `closed-loop` for a controlled arm in MuJoCo, or `inverse-dynamics` for an exact motion along the plan.
        repetitions: Number of repetitions of the motion.
        lead_in: Duration of the transition from rest to the planned motion, in the mode `closed-loop` [s].
        physics_rate: Smallest number of simulation steps per second [Hz]; the next multiple of the log's rate is
            used.
        arm: Properties of the arm that replace the built-in properties or are added to them.
        controller: Controller of the joints.
        drive: Dynamics and limits of the drives.
        sensing: Sensors, rate and clock of the log.
        faults: Faults that are added to the log.
        pushes: External torques on the links.
    """

    mode: Literal["closed-loop", "inverse-dynamics"] = "closed-loop"
    repetitions: int = 1
    lead_in: float = 2.0
    physics_rate: float = 4000.0
    arm: Arm = field(default_factory=Arm)
    controller: Controller = field(default_factory=Controller)
    drive: Drive = field(default_factory=Drive)
    sensing: Sensing = field(default_factory=Sensing)
    faults: tuple[Fault, ...] = ()
    pushes: tuple[Push, ...] = ()

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise LabError(
                f"Unknown mode {self.mode!r}.", possible=", ".join(MODES), remedy=did_you_mean(self.mode, MODES)
            )
        if self.repetitions < 1 or isinstance(self.repetitions, bool):
            raise LabError(
                f"The number of repetitions must be a whole number of at least 1; found {self.repetitions}.",
                remedy="correct the key `repetitions` of the lab.toml.",
            )
        if not (self.lead_in >= 0.0 and self.physics_rate > 0.0):
            raise LabError(
                f"`lead_in` must not be negative and `physics_rate` must be positive; found {self.lead_in} and "
                f"{self.physics_rate}.",
                remedy="correct these keys of the lab.toml.",
            )


def load_options(path: Path | str) -> LabOptions:
    """Reads the options of a simulation from a `lab.toml`.

    Raises:
        LabError: The file is missing or not TOML, or has an unknown key or a wrong value.
    """
    path = Path(path)
    table = read_toml(path, "options of the lab", LabError, remedy="give the path of a lab.toml.")
    with boundary("options of the lab", path, LabError, remedy="correct the keys that docs/lab.md explains."):
        return parse_options(table)


def parse_options(table: Mapping[str, Any]) -> LabOptions:
    """Options from the tables of a `lab.toml`; each fault is a table `[[faults]]` with the key `kind`."""
    return made(LabOptions, table, "lab.toml")


def made(kind: type[T], table: object, where: str) -> T:
    """Makes an object of a dataclass from a TOML table with the fields of the class as keys; tables may be nested."""
    if not isinstance(table, Mapping):
        raise LabError(f"{where} must be a table; found {table!r:.60}.", remedy="write this value as a TOML table.")
    fields = {f.name: f for f in dataclasses.fields(kind) if f.init}  # pyright: ignore[reportArgumentType]
    hints = typing.get_type_hints(kind)
    for key in table:
        if key not in fields:
            raise LabError(
                f"{where} has no key {key!r}.", possible=", ".join(fields), remedy=did_you_mean(key, fields)
            )
    missing = [
        name
        for name, f in fields.items()
        if name not in table and f.default is dataclasses.MISSING and f.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise LabError(
            f"In {where}, these keys are missing: {', '.join(missing)}.", remedy="add these keys to the lab.toml."
        )
    values = {key: _value(hints[key], value, f"{where}: {key}") for key, value in table.items()}
    try:
        return kind(**values)
    except ArmidError as error:
        raise LabError(f"{where}: {error.problem}", possible=error.possible, remedy=error.remedy) from error
    except (TypeError, ValueError) as error:
        raise LabError(f"{where} has a value of the wrong type: {error}.", remedy="correct the value.") from error


def _value(hint: Any, value: Any, where: str) -> Any:
    """Converts the value of a key to the type that the dataclass declares for its field."""
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        hint = next(each for each in typing.get_args(hint) if each is not type(None))
    if dataclasses.is_dataclass(hint):
        return made(typing.cast("type[Any]", hint), value, where)
    if typing.get_args(hint)[:1] == (Fault,):
        return tuple(_fault(each, where) for each in _listed(value, where))
    if typing.get_args(hint)[:1] == (Push,):
        return tuple(made(Push, each, where) for each in _listed(value, where))
    if typing.get_origin(hint) is np.ndarray or hint == NDArray[np.float64]:
        return value
    if typing.get_origin(hint) is tuple:
        if typing.get_args(hint)[:1] == (str,) and not all(isinstance(each, str) for each in _listed(value, where)):
            raise LabError(f"{where} must be a list of texts; found {value!r:.60}.", remedy="write names in quotes.")
        return tuple(_listed(value, where))
    plain = {float: (int, float), int: (int,), str: (str,), bool: (bool,)}.get(hint)
    if plain is not None and (not isinstance(value, plain) or (isinstance(value, bool) and hint is not bool)):
        raise LabError(
            f"{where} must be {'a number' if hint in (float, int) else 'a text'}; found {value!r:.60}.",
            remedy="correct the value in the lab.toml.",
        )
    return value


def _listed(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list | tuple):
        raise LabError(
            f"{where} must be a list; found {value!r:.60}.", remedy="write the value in brackets, for instance [1.0]."
        )
    return list(typing.cast("list[Any]", value))


def _fault(table: Any, where: str) -> Fault:
    kind = str(table.get("kind")) if isinstance(table, Mapping) else ""
    if kind not in FAULTS:
        raise LabError(
            f"{where} has an unknown kind of fault {kind!r}.", possible=", ".join(FAULTS), remedy="correct `kind`."
        )
    return made(FAULTS[kind], {key: value for key, value in table.items() if key != "kind"}, f"{where}: {kind}")
