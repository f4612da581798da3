"""Study: the inputs and options of an identification, as a file `study.toml` contains them.

A `study.toml` has the tables `[robot]`, `[model]`, `[[recording]]`, `[processing]`, `[estimation]` and `[servo]`. Its
keys are the fields of the dataclasses in this module, of `LogFormat`, `ProcessingOptions` and `ServoChoice`. An
unknown key is an error that lists the known keys. Paths are relative to the folder of the study.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

from armid.errors import ArmidError, StudyError, did_you_mean
from armid.estimation.catalogue import ESTIMATORS, Estimator
from armid.input_boundary import boundary, naming, read_toml
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import DEFAULT_TERMS, TERMS, RotorInertia, Term
from armid.notebook_display import Displayed, Summary
from armid.robot import Robot, builtin_arms, load_robot
from armid.study.servos.choice import ServoChoice
from armid.study.study_overview import study_summary

T = TypeVar("T")

Shapes = Mapping[str, Any] | Sequence[Mapping[str, Any]]
"""Options of one torque term, or a list of the options of several terms with the same name."""

PLAIN_METHOD = "wls"
AUTOMATIC_METHOD = "auto"
"""Default estimation methods: for terms that the study names, and for terms that armid selects (a fitting one)."""


@dataclass(frozen=True, slots=True)
class RobotChoice:
    """Options of the arm of a study.

    Attributes:
        description: Name of a built-in arm or path to a URDF, xacro, MJCF or DH table.
        gravity: Acceleration of gravity in the base frame [m/s²]; if not given, the gravity of the description.
        lock: Joints that are locked: names or patterns, `"name=position"`, or a table of positions. If no position is
            given, a joint is locked at the position within its limits that is closest to 0.
        tip: Frame of the tool flange. If `only` is not given, only the joints between the base and this frame move.
        only: Names or patterns of the joints that move; all other joints are locked.
    """

    description: str
    gravity: tuple[float, float, float] | None = None
    lock: Mapping[str, float] | Sequence[str] = ()
    tip: str | None = None
    only: Sequence[str] = ()

    def __post_init__(self) -> None:
        gravity, lock = self.gravity, self.lock
        _require(_are_texts([self.description]), "description", "text", self.description)
        _require(self.tip is None or _are_texts([self.tip]), "tip", "text", self.tip)
        _require(gravity is None or _are_numbers(gravity, 3), "gravity", "three numbers", gravity)
        names, values = (list(lock), list(lock.values())) if isinstance(lock, Mapping) else (lock, [])
        good = _are_texts(names) and _are_numbers(values, len(values))
        _require(good, "lock", "a list of names, or { name = value }", lock)
        _require(_are_texts(self.only), "only", "a list of names", self.only)


@dataclass(frozen=True, slots=True)
class ModelChoice:
    """Torque terms of a study.

    Attributes:
        terms: Names of the terms; if no names are given, the terms follow from the kind of effort (joint torque or
            motor torque). A name may occur several times; `default` stands for the default terms with their shapes.
        shapes: Options of terms, by the name of the term: one table, or a list of tables if a term has different
            shapes on different joints.
        automatic: True if armid selects friction terms for each joint and adds them (`terms = "auto"` in a study).
    """

    terms: tuple[str, ...] = ()
    shapes: Mapping[str, Shapes] = field(default_factory=dict[str, "Shapes"])
    automatic: bool = False

    def __post_init__(self) -> None:
        _require(_are_texts(self.terms), "terms", "a list of names", self.terms)
        _require(hasattr(self.shapes, "items"), "shapes", "a table", self.shapes)
        object.__setattr__(self, "terms", tuple(self.terms))


@dataclass(frozen=True, eq=False, slots=True)
class RecordingChoice:
    """Options of one recording of a study.

    Attributes:
        path: The file.
        role: `train` or `validate`.
        reading: Log format.
        part: Beginning and end of the part of the recording that is used, as shares of its length from 0 to 1. One
            part of a file may be used for training and another part for validation.
    """

    path: str
    role: Literal["train", "validate"] = "train"
    reading: LogFormat = field(default_factory=LogFormat)
    part: tuple[float, float] = (0.0, 1.0)

    def __post_init__(self) -> None:
        _require(_are_texts([self.path]), "path", "text", self.path)
        if self.role not in ("train", "validate"):
            problem, roles = f"{self.path}: unknown role {self.role!r}.", ("train", "validate")
            raise StudyError(problem, possible=", ".join(roles), remedy=did_you_mean(self.role, roles))
        _require(_are_numbers(self.part, 2), "part", "two numbers", self.part)
        low, high = self.part
        if not 0.0 <= low < high <= 1.0:
            problem = f"{self.path}: the key `part` must be two increasing shares from 0 to 1; found {self.part}."
            raise StudyError(problem, remedy="write for instance part = [0.0, 0.7] for the first 70 %.")


PER_RECORDING = ("friction_per_recording", "offset_per_recording")
"""Keys of the table [estimation] that give each recording friction or offsets of its own."""


@dataclass(frozen=True, slots=True)
class EstimationChoice:
    """Options of the estimation of a study.

    Attributes:
        method: Name of the estimator.
        friction_per_recording: True if every recording has its own friction and offsets; the links are common.
        options: Options of estimators, by the name of the estimator and the name of the option.
        offset_per_recording: True if every recording has its own offsets; links and friction are common.
    """

    method: str = PLAIN_METHOD
    friction_per_recording: bool = False
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: {})
    offset_per_recording: bool = False

    def __post_init__(self) -> None:
        if self.method not in ESTIMATORS and self.method != AUTOMATIC_METHOD:
            names, nearest = ", ".join(ESTIMATORS), did_you_mean(self.method, ESTIMATORS)
            raise StudyError(f"Unknown estimation method {self.method!r}.", possible=names, remedy=nearest)
        good = hasattr(self.options, "items") and all(hasattr(each, "items") for each in self.options.values())
        _require(good, "options", "a table of tables", self.options)
        for key in PER_RECORDING:
            _require(getattr(self, key) in (True, False), key, "true or false", getattr(self, key))


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Study(Displayed):
    """Inputs and options of an identification.

    Attributes:
        robot: Options of the arm.
        model: Torque terms of the arm.
        recordings: Recordings; at least one of them has the role `train`.
        processing: Processing options.
        estimation: Estimation options.
        folder: Folder to which paths are relative.
        servo: Options of the servos, for recordings of commands without torque.
    """

    robot: RobotChoice
    model: ModelChoice
    recordings: tuple[RecordingChoice, ...]
    processing: ProcessingOptions = field(default_factory=ProcessingOptions)
    estimation: EstimationChoice = field(default_factory=EstimationChoice)
    folder: str = "."
    servo: ServoChoice = field(default_factory=ServoChoice)

    def __post_init__(self) -> None:
        every = self.processing.needs_all_samples
        kept = [replace(r, reading=r.reading.with_all_samples()) if every else r for r in self.recordings]
        object.__setattr__(self, "recordings", tuple(kept))
        if not any(recording.role == "train" for recording in self.recordings):
            raise StudyError('No recording has the role "train".', remedy='write role = "train" in a [[recording]].')
        if self.estimation.method == AUTOMATIC_METHOD and not self.model.automatic:
            raise StudyError('The method "auto" needs terms = "auto".', remedy='name a method such as "wls".')

    @property
    def is_motor_side(self) -> bool:
        """True if the effort of every recording is the effort of the motors."""
        readings = [choice.reading for choice in self.recordings]
        return all(each.transmission is not None or each.drive_gain is not None for each in readings)

    def summary(self) -> Summary:
        """Summary of a study: arm, terms, method, recordings, and options that differ from the defaults."""
        return study_summary(self)


def load_study(path: Path | str) -> Study:
    """Reads a `study.toml`.

    Raises:
        StudyError: The file is missing, is not valid TOML, has an unknown key or contradicts itself.
    """
    path = Path(path)
    table = read_toml(path, "a study", StudyError, remedy="give the path of a study.toml.")
    with naming(path), boundary("a study", path, StudyError, remedy="correct the keys that docs/study.md explains."):
        return parse_study(table, str(path.parent))


def parse_study(table: Mapping[str, Any], folder: str = ".") -> Study:
    """Makes a study from the tables of a `study.toml`.

    Raises:
        StudyError: A key is unknown or missing, or keys contradict each other.
    """
    _known(table, ("robot", "model", "recording", "processing", "estimation", "servo"), "The study")
    if "robot" not in table:
        raise StudyError("The study has no table [robot].", remedy='add [robot] with description = "…".')
    recordings = table.get("recording", [])
    if not isinstance(recordings, list) or not all(isinstance(each, Mapping) for each in recordings):
        raise StudyError(
            f"The key `recording` of the study must be a list of tables; found {recordings!r:.80}.",
            remedy="write [[recording]], with double brackets, above the keys of each recording.",
        )
    model = _model_choice(table.get("model", {}))
    return Study(
        parse_robot(table["robot"]),
        model,
        tuple(_recording_choice(each) for each in recordings),
        _make(ProcessingOptions, table.get("processing", {}), "[processing]"),
        _estimation_choice(table.get("estimation", {}), default_estimation(model).method),
        folder,
        _make(ServoChoice, table.get("servo", {}), "[servo]"),
    )


def load_choice(choice: RobotChoice, folder: Path | str = ".") -> Robot:
    """Loads the arm that a study or a command line names; the path of its description is relative to `folder`."""
    name = choice.description if choice.description in builtin_arms() else Path(folder) / choice.description
    return load_robot(name, gravity=choice.gravity, lock=choice.lock, only=choice.only, tip=choice.tip)


def parse_robot(table: Any) -> RobotChoice:
    """Makes the options of the arm from a `[robot]` table; `locked` is the former name of `lock`."""
    if isinstance(table, Mapping) and "locked" in table and "lock" not in table:
        table = {"lock" if key == "locked" else key: value for key, value in table.items()}
    return _make(RobotChoice, table, "[robot]")


def default_estimation(model: ModelChoice) -> EstimationChoice:
    """Default estimation options for the torque terms of a study: a method with a prior if armid selects friction."""
    return EstimationChoice(AUTOMATIC_METHOD if model.automatic else PLAIN_METHOD)


def build_estimator(choice: EstimationChoice) -> Estimator:
    """Makes the estimator of a study, with the options that the study gives for this estimator."""
    return _make(ESTIMATORS[choice.method], choice.options.get(choice.method, {}), f"[estimation.{choice.method}]")


DEFAULT = "default"
"""Name in a list of terms that stands for the default terms with their shapes."""


def build_model(robot: Robot, choice: ModelChoice, *, motor_side: bool = False) -> DynamicsModel:
    """Makes the model that a study defines.

    Args:
        robot: The arm.
        choice: Names of the torque terms, and their options.
        motor_side: True if the recorded effort is the effort of the motors; rotor inertia is then added by default.
            If friction is selected, rotor inertia is always added, because joint torques in logs are often converted
            motor torques, and under a prior an unnecessary rotor inertia does not change the result much.
    """
    usual = {term.name: dataclasses.asdict(term) for term in DEFAULT_TERMS}  # pyright: ignore[reportArgumentType]
    plain = {} if choice.terms and DEFAULT not in choice.terms else usual
    asked = choice.terms or (DEFAULT, *((RotorInertia.name,) if motor_side or choice.automatic else ()))
    further = tuple(name for name in usual if name not in asked)
    names = tuple(name for each in asked for name in (further if each == DEFAULT else (each,)))
    for name in choice.shapes:
        if name not in names:
            problem = f"The table [model] gives options of {name!r}, but this is not one of the terms of the study."
            remedy = did_you_mean(name, names) or f"add {name!r} to `terms`, or remove its options."
            raise StudyError(problem, possible=", ".join(names), remedy=remedy)
    tables = {name: _tables(choice.shapes.get(name, {})) for name in names}
    terms: list[Term] = []
    for k, name in enumerate(names):
        if name not in TERMS:
            raise StudyError(
                f"Unknown torque term {name!r}.",
                possible=", ".join((*TERMS, DEFAULT)),
                remedy=did_you_mean(name, TERMS),
            )
        # A repeated name takes one of its tables at each occurrence, and all remaining ones at the last.
        taken = tables[name] if name not in names[k + 1 :] else tables[name][:1]
        tables[name] = tables[name][len(taken) :]
        for options in taken or [{}]:
            terms.append(_make(TERMS[name], {**plain.get(name, {}), **options}, f"[model.{name}]"))
    return DynamicsModel(robot, tuple(terms))


def _tables(shapes: Shapes) -> list[dict[str, Any]]:
    """Options of all torque terms that have one name, as a list of tables; a single table becomes a list of one."""
    return [dict(each) for each in ([shapes] if isinstance(shapes, Mapping) else shapes)]


def resolve_model(model: DynamicsModel) -> ModelChoice:
    """Options from which `build_model` makes the given model; default values of its terms are written out."""
    shapes: dict[str, list[dict[str, Any]]] = {}
    for term in model.terms:
        options = dataclasses.asdict(term)  # pyright: ignore[reportArgumentType]
        shapes.setdefault(term.name, []).append({k: v for k, v in options.items() if v is not None})
    given = {name: each[0] if len(each) == 1 else tuple(each) for name, each in shapes.items()}
    return ModelChoice(tuple(term.name for term in model.terms), {k: v for k, v in given.items() if v})


def _model_choice(table: Mapping[str, Any]) -> ModelChoice:
    """Reads the table [model]: names of terms, and options of each term under the name of the term."""
    _known(table, ("terms", *TERMS), "[model]")
    terms = table.get("terms", ())
    automatic = terms == "auto"
    shapes = {name: value for name, value in table.items() if name != "terms"}
    for name, value in shapes.items():
        several = isinstance(value, list) and all(isinstance(each, Mapping) for each in value)
        good = isinstance(value, Mapping) or several
        _require(good, name, "a table of options, or a list of such tables", value, "[model] ")
    chosen = {"terms": () if automatic else terms, "shapes": shapes, "automatic": automatic}
    return _make(ModelChoice, chosen, "[model]")


def _estimation_choice(table: Mapping[str, Any], method: str) -> EstimationChoice:
    """Reads the table [estimation]; `method` is the default; each estimator has a table of options with its name."""
    possible = ("method", *PER_RECORDING, *ESTIMATORS)
    if unknown := sorted(table.keys() - set(possible)):  # only then are all estimators imported
        owner = {option: name for name, kind in ESTIMATORS.items() for option in getattr(kind, "__slots__", ())}
        chosen = str(table.get("method", method))
        owner |= dict.fromkeys(getattr(ESTIMATORS.get(chosen), "__slots__", ()), chosen)
        for key in (key for key in unknown if key in owner):
            raise StudyError(f"[estimation] has no key {key!r}.", remedy=f"write it in [estimation.{owner[key]}].")
    _known(table, possible, "[estimation]")
    options = {name: value for name, value in table.items() if name in ESTIMATORS}
    for name, value in options.items():
        _require(isinstance(value, Mapping), name, "a table of options", value, "[estimation] ")
    own = {name: value for name, value in table.items() if name not in ESTIMATORS}
    choice = _make(EstimationChoice, {"method": method, **own, "options": options}, "[estimation]")
    for name in options:
        build_estimator(replace(choice, method=name))  # refuses wrong options
    return choice


def _recording_choice(table: Mapping[str, Any]) -> RecordingChoice:
    """Makes a recording with its log format from the keys of one table [[recording]]."""
    own = [f.name for f in dataclasses.fields(RecordingChoice) if f.name != "reading"]
    _known(table, (*own, *(f.name for f in dataclasses.fields(LogFormat))), "[[recording]]")
    if "path" not in table:
        raise StudyError("A recording has no key `path`.", remedy='give path = "…" in every [[recording]].')
    how = {key: value for key, value in table.items() if key not in own}
    choice = {key: value for key, value in table.items() if key in own}
    reading = _make(LogFormat, how, f"[[recording]] {table['path']}:")
    return _make(RecordingChoice, {**choice, "reading": reading}, "[[recording]]")


def _make(kind: type[T], table: Mapping[str, Any], where: str) -> T:
    """Makes a dataclass from a table whose keys are the fields of the class; lists become tuples."""
    fields = [f for f in dataclasses.fields(kind) if f.init]  # pyright: ignore[reportArgumentType]
    _known(table, [f.name for f in fields], where)
    needed = [f.name for f in fields if f.default is f.default_factory is dataclasses.MISSING]
    if missing := [name for name in needed if name not in table]:
        raise StudyError(f"{where} has no value for {', '.join(missing)}.", remedy="add the missing keys.")
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in table.items()}
    try:
        return kind(**values)
    except ArmidError as error:
        raise StudyError(f"{where} {error.problem}", possible=error.possible, remedy=error.remedy) from error
    except (TypeError, ValueError) as error:
        raise StudyError(f"{where} has a value of the wrong type: {error}.", remedy="correct the value.") from error


def _known(table: object, known: Iterable[str], where: str) -> None:
    """Raises an error if a value is not a table, or if the table has a key that is not in `known`."""
    known = list(known)
    if not isinstance(table, Mapping):
        raise StudyError(f"{where} must be a table; found {table!r}.", remedy=f"write the keys {', '.join(known)}.")
    for key in table:
        if key not in known:
            raise StudyError(
                f"{where} has no key {key!r}.", possible=", ".join(known), remedy=did_you_mean(key, known)
            )


def _require(good: bool, key: str, wanted: str, found: object, table: str = "") -> None:
    """Raises an error if the value of a key is not of the wanted kind."""
    if not good:
        raise StudyError(f"{table}`{key}` must be {wanted}; found {found!r}.", remedy="correct the value of the key.")


def _are_texts(values: object) -> bool:
    return isinstance(values, tuple | list) and all(isinstance(value, str) and value for value in values)


def _are_numbers(values: object, count: int) -> bool:
    """True if `values` is a list of exactly `count` finite numbers."""
    if not isinstance(values, tuple | list) or len(values) != count:
        return False
    return all(isinstance(x, int | float) and not isinstance(x, bool) and math.isfinite(x) for x in values)
