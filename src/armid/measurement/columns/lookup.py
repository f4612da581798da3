"""Selection of the columns of a file with time, position, velocity, acceleration and effort."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.errors import Finding, RecordingError
from armid.measurement.columns.clocks import Values, evenly_growing, unit_of_step
from armid.measurement.columns.guesses import ClockRequest, Guess, guess_columns, shortened
from armid.measurement.columns.units import factors, is_current, stated_units, unit_fields
from armid.measurement.columns.unread import effort_possible
from armid.measurement.log_format import PRESETS, QUANTITIES, LogFormat
from armid.measurement.recording import Recording
from armid.measurement.remedy import lines, naming
from armid.robot.robot import Robot
from armid.values import Array

__all__ = ["Selection", "assemble", "select"]

DEFAULTS: Mapping[str, tuple[str, ...]] = {
    "time": ("t", "time", "timestamp"),
    "q": ("q{}", "q"),
    "dq": ("dq{}", "qd{}", "dq", "qd"),
    "ddq": ("ddq{}", "qdd{}", "ddq", "qdd"),
    "effort": ("tau{}", "effort{}", "torque{}", "tau", "effort", "torque", "i{}"),
}
"""Names tried in this order where the reading gives none; `{}` counts from 1."""

CURRENT = re.compile(r"i([_\[]?\d+\]?)?|.*current.*", re.IGNORECASE)
"""Names of columns with motor current: i1, i_1, i[0], actual_current_0; others are known by their unit."""

LISTED = 60
"""Largest number of names in a message; the log of a controller may have hundreds."""


@dataclass(frozen=True, slots=True)
class Selection:
    """Columns chosen in one file.

    Attributes:
        time: None, one, or two (seconds and nanoseconds).
        q: A column for each channel, or one matrix.
        dq: Likewise, or none.
        ddq: Likewise, or none.
        effort: Likewise, or none.
        guessed: Fields of the reading that were found out by the names.
        findings: What was found out, in words.
    """

    time: tuple[str, ...]
    q: tuple[str, ...]
    dq: tuple[str, ...]
    ddq: tuple[str, ...]
    effort: tuple[str, ...]
    guessed: Mapping[str, Any] = field(default_factory=dict[str, Any])
    findings: tuple[Finding, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """All chosen columns, each once."""
        return tuple(dict.fromkeys((*self.time, *self.q, *self.dq, *self.ddq, *self.effort)))


def select(
    names: Sequence[str],
    reading: LogFormat,
    path: Path,
    robot: Robot | None = None,
    *,
    matrices: bool = False,
    values: Values | None = None,
) -> Selection:
    """Chooses columns by the stated names, the preset, the usual names, or a guess.

    Args:
        names: Columns or variables of the file.
        reading: How to read it.
        path: The file, for messages.
        robot: The arm, whose joints may stand in the names.
        matrices: Whether a variable may hold all channels.
        values: Gives the numbers under a name, so that a clock whose name says nothing is found, or named.

    Raises:
        RecordingError: A named column is not there, a number is missing in a row of columns, or no column holds
            positions, or several sets of columns may; the message lists what is there.
    """
    present = dict.fromkeys(names)
    chosen = _stated(present, reading, path)
    guess = Guess({})
    if reading.preset is None and (
        open_ := [name for name in QUANTITIES if not chosen[name] and name not in reading.columns]
    ):
        guess = _guess(present, open_, chosen, reading, robot, path, matrices=matrices, values=values)
        chosen |= guess.columns
    if not chosen["q"]:
        raise _unknown("No column holds positions", present, "q", path, robot)
    if reading.drive_gain is not None and "effort" not in reading.columns and reading.preset is None:
        _refuse_two_efforts(chosen["effort"], present, path)
    guessed = _as_reading(guess, reading, robot) | unit_fields(chosen, reading, path)
    findings = _findings(guess, guessed, chosen)
    if values is not None and _lacks_clock(chosen, reading):
        findings += _possible_clocks(present, chosen, values, reading)
    findings += effort_possible(list(present), chosen, reading, _labels(reading, robot)[0])
    return Selection(**chosen, guessed=guessed, findings=findings)


def _stated(present: Mapping[str, Any], reading: LogFormat, path: Path) -> dict[str, tuple[str, ...]]:
    """Columns that the log format names, that its preset has, or that have the usual names."""
    chosen: dict[str, tuple[str, ...]] = {}
    for quantity in QUANTITIES:
        if quantity in reading.columns:
            patterns = tuple(reading.columns[quantity])
            chosen[quantity] = _named(patterns, present, quantity, path) if patterns else ()
        elif reading.preset is not None:
            patterns = PRESETS[reading.preset].columns.get(quantity, ())
            needed = patterns and quantity in ("time", "q")
            chosen[quantity] = (
                _named(patterns, present, quantity, path)
                if needed
                else tuple(chain.from_iterable(_expand(pattern, present, path) for pattern in patterns))
            )
        else:
            found = (_expand(pattern, present, path, usual=True) for pattern in DEFAULTS[quantity])
            chosen[quantity] = next((columns for columns in found if columns), ())
    return chosen


def assemble(
    selection: Selection,
    column: Callable[[str], NDArray[Any]],
    reading: LogFormat,
    path: Path,
    joint_names: Sequence[str] = (),
) -> Recording:
    """Builds the recording from the chosen columns of a file.

    Args:
        selection: Chosen names.
        column: Gives the numbers under a name, shape (N,) or (N, n).
        reading: How to read it.
        path: The file.
        joint_names: Names of the channels, where the file has them.
    """
    quantities = (*selection.q, *selection.dq, *selection.ddq, *selection.effort)
    scale = factors(quantities, selection.guessed.get("units", reading.units))

    def scaled(name: str) -> NDArray[Any]:
        return column(name) if scale.get(name, 1.0) == 1.0 else column(name) * scale[name]

    q = _matrix(selection.q, scaled, path)
    effort = _matrix(selection.effort, scaled, path) if selection.effort else None
    if effort is not None and effort.ndim == q.ndim == 2 and effort.shape[1] != q.shape[1]:
        raise _uneven(selection, q.shape[1], effort.shape[1], path)
    return Recording(
        time=_time(selection.time, column, _time_unit(reading, selection)),
        q=q,
        dq=_matrix(selection.dq, scaled, path) if selection.dq else None,
        ddq=_matrix(selection.ddq, scaled, path) if selection.ddq else None,
        effort=effort,
        joint_names=tuple(joint_names),
        rate=reading.rate,
        consecutive=reading.consecutive,
        effort_is_current=any(CURRENT.fullmatch(name) or is_current(name) for name in selection.effort),
        columns={name: found for name in QUANTITIES if (found := getattr(selection, name))},
        guessed=selection.guessed,
        findings=selection.findings,
        source=str(path),
    )


def _guess(
    present: Mapping[str, Any],
    quantities: Sequence[str],
    chosen: Mapping[str, tuple[str, ...]],
    reading: LogFormat,
    robot: Robot | None,
    path: Path,
    *,
    matrices: bool,
    values: Values | None,
) -> Guess:
    """Guessed columns of the quantities that are not known yet.

    Raises:
        RecordingError: Several sets of columns are equally good.
    """
    wanted, labels = _labels(reading, robot)
    guess = guess_columns(
        list(present),
        quantities,
        wanted=wanted,
        labels=labels,
        channels=len(chosen["q"]),
        matrices=matrices,
        values=values,
    )
    if isinstance(guess, ClockRequest):
        raise RecordingError(
            f"{path}: {len(guess.sets)} sets of columns may hold {guess.quantity}: "
            f"{'; '.join(shortened(each) for each in guess.sets)}.",
            possible="one of them",
            remedy=naming(reading, {guess.quantity: guess.sets[0]}),
        )
    return guess


def _labels(reading: LogFormat, robot: Robot | None) -> tuple[list[str], list[str]]:
    """Names in the file of the arm's joints, and of all that its description has."""
    in_file = {joint: name for name, joint in reading.joint_map.items() if joint}
    wanted, labels = ([], []) if robot is None else (robot.joint_names, robot.described_joints)
    return [in_file.get(name, name) for name in wanted], [in_file.get(name, name) for name in labels]


def _as_reading(guess: Guess, reading: LogFormat, robot: Robot | None) -> dict[str, Any]:
    """Guessed columns in the form of fields of a log format."""
    if not guess.columns:
        return {}
    said: dict[str, Any] = {"columns": {**reading.columns, **guess.columns}}
    if robot is not None and guess.joints and not reading.joints:
        said["joints"] = guess.joints
    elif guess.joints:
        said["joints"] = tuple(reading.joint_map.get(label, label) for label in guess.joints)
    if robot is not None and said.get("joints") == robot.joint_names:
        del said["joints"]
    return said


def _findings(guess: Guess, guessed: Mapping[str, Any], chosen: Mapping[str, tuple[str, ...]]) -> tuple[Finding, ...]:
    """Findings about guessed columns and units, with the lines of a study that state them."""
    units = stated_units(chosen)
    told = [f"By the names of the columns: {'; '.join(guess.reasons)}."] if guess.columns else []
    told += [f"By their names, {units}."] if units else []
    if not told:
        return ()
    plain: dict[str, Any] = {
        key: list(value) if isinstance(value, tuple) else value for key, value in guessed.items()
    }
    if guess.columns:
        every: Mapping[str, tuple[str, ...]] = guessed["columns"]
        plain["columns"] = {name: each[0] if len(each) == 1 else list(each) for name, each in every.items()}
    severity = "warning" if guess.commanded else "info"
    code = "columns-guessed" if guess.columns else "units-of-header"
    return (Finding(code, severity, "", " ".join(told), lines(**plain) if plain else ""),)


def _lacks_clock(chosen: Mapping[str, tuple[str, ...]], reading: LogFormat) -> bool:
    """Tests whether a clock is needed and the log format does not leave it out."""
    asked = reading.rate is None and reading.consecutive is not False and reading.preset is None
    return asked and not chosen["time"] and "time" not in reading.columns


def _possible_clocks(
    present: Mapping[str, Any], chosen: Mapping[str, tuple[str, ...]], values: Values, reading: LogFormat
) -> tuple[Finding, ...]:
    """Finding about unused columns that increase uniformly: one of them may be the missing clock."""
    found = evenly_growing(list(present), set(chain.from_iterable(chosen.values())), values)
    if not found:
        return ()
    told = ", ".join(f"{name!r} (by {step:.6g} a row)" for name, step in found.items())
    evidence = f"Of the columns that are not used, {told} grow{'' if len(found) > 1 else 's'} evenly."
    name, step = next(iter(found.items()))
    counted = unit_of_step(step)
    remedy = naming(reading, {"time": name}, "if it is the clock" if counted is None else "")
    if counted is not None:
        remedy += "\n" + lines(f"if it is the clock; by its steps it counts {counted[1]}", time_unit=counted[0])
    return (Finding("clock-possible", "info", "time", evidence, remedy),)


def _time_unit(reading: LogFormat, selection: Selection) -> float:
    """Length of one unit of the time column [s], from log format or header, else from the preset."""
    if reading.time_unit is not None or "time_unit" in selection.guessed:
        return float(reading.time_unit or selection.guessed["time_unit"])
    preset = PRESETS.get(reading.preset or "")
    return 1.0 if preset is None or "time" in reading.columns else preset.time_unit


def _uneven(selection: Selection, q: int, effort: int, path: Path) -> RecordingError:
    """Error for more channels of one quantity than of another."""
    listed = [
        f"{count} of {name} ({' … '.join(dict.fromkeys((*names[:1], *names[-1:])))})"
        for name, names, count in (("q", selection.q, q), ("effort", selection.effort, effort))
    ]
    fewer = "effort" if effort < q else "q"
    return RecordingError(
        f"{path} has {listed[0]}, but {listed[1]}: {abs(q - effort)} of {fewer} missing.",
        remedy=f"add what is missing of {fewer}; or name as many of each in columns, and lock the joints that were "
        "not recorded.",
    )


def numeric(values: NDArray[Any], name: str, path: Path) -> Array:
    """Values of a column as float64.

    Raises:
        RecordingError: It holds something else than real numbers, or is no vector or matrix.
    """
    if values.dtype.kind not in "fiub":
        raise RecordingError(
            f"{path}: {name!r} holds {values.dtype.name}, not numbers.",
            remedy="save plain arrays of real numbers, or name another column.",
        )
    if values.ndim not in (1, 2):
        raise RecordingError(
            f"{path}: {name!r} has {values.ndim} dimensions.", remedy="give one row a sample and one column a joint."
        )
    return values.astype(np.float64)


def _named(patterns: tuple[str, ...], present: Mapping[str, Any], quantity: str, path: Path) -> tuple[str, ...]:
    """Columns of one pattern or a list of names; all of them must exist."""
    if len(patterns) == 1:
        found = _expand(patterns[0], present, path)
        if not found:
            raise _unknown(f"No column is called {patterns[0]!r}", present, quantity, path)
        return found
    missing = [name for name in patterns if name not in present]
    if missing:
        raise _unknown(f"No column is called {', '.join(map(repr, missing))}", present, quantity, path)
    return patterns


def _expand(pattern: str, present: Mapping[str, Any], path: Path, *, usual: bool = False) -> tuple[str, ...]:
    """Columns that match a pattern, in the order of their numbers; a usual name may also count from 0."""
    for braces, first in (("{}", 1), ("{0}", 0)):
        if braces not in pattern:
            continue
        before, after = pattern.split(braces, 1)
        form = re.compile(re.escape(before) + r"(\d+)" + re.escape(after))
        numbered = {int(hit[1]): name for name in present if (hit := form.fullmatch(name))}
        if not numbered:
            return ()
        if usual and sorted(numbered) == list(range(len(numbered))):
            return ()  # guessed, and said
        expected = range(first, first + len(numbered))
        if sorted(numbered) != list(expected):
            found = ", ".join(numbered[i] for i in sorted(numbered))
            raise RecordingError(
                f"{path}: columns {pattern!r} must count from {first} without a gap; found {found}.",
                possible="{} counts from 1, {0} from 0; a list of names takes any",
                remedy="say which columns to take in columns.",
            )
        return tuple(numbered[i] for i in expected)
    return (pattern,) if pattern in present else ()


def _refuse_two_efforts(effort: tuple[str, ...], present: Mapping[str, Any], path: Path) -> None:
    """Raises an error where drive gains are given and both torque and current could be meant."""
    current = _expand("i{}", present, path)
    if effort and current and effort != current:
        raise RecordingError(
            f"{path} has {effort[0]} … and {current[0]} …; drive_gain does not say which of them it belongs to.",
            remedy='name the effort, for instance columns = { effort = "i{}" }.',
        )


def _unknown(
    problem: str, present: Mapping[str, Any], quantity: str, path: Path, robot: Robot | None = None
) -> RecordingError:
    names = list(present)
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    count = 3 if robot is None else robot.n
    form = ", ".join(f'"{name}"' for name in names[:count]) or '"…"'
    order = "" if robot is None else f" in the order {', '.join(robot.joint_names)}"
    return RecordingError(
        f"{path}: {problem} for {quantity}.",
        possible=(", ".join(names[:LISTED]) or "the file has no columns") + more,
        remedy=f"name them{order}, with the names that it has: columns = {{ {quantity} = [{form}] }}; or give a "
        f"preset ({', '.join(PRESETS)}) in a study.",
    )


def _matrix(names: tuple[str, ...], column: Callable[[str], NDArray[Any]], path: Path) -> NDArray[Any]:
    """Columns as one matrix, shape (N, n)."""
    values = [column(name) for name in names]
    if len(values) == 1:
        return values[0] if values[0].ndim == 2 else values[0][:, None]
    if len({len(column) for column in values}) > 1:
        found = ", ".join(f"{name} {len(column)}" for name, column in zip(names, values, strict=True))
        raise RecordingError(f"{path}: columns differ in length: {found}.", remedy="give each channel every sample.")
    return np.column_stack(values)


def _time(names: tuple[str, ...], column: Callable[[str], NDArray[Any]], unit: float) -> NDArray[Any] | None:
    """Times [s]; a second column counts nanoseconds."""
    if not names:
        return None
    first = column(names[0]).reshape(-1)
    if len(names) == 1:
        return first * unit
    # The first whole second is taken off before the sum, or 1e9 s would eat the nanoseconds' digits.
    return (first - first[:1]) + 1e-9 * column(names[1]).reshape(-1)
