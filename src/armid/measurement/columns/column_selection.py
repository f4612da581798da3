"""Selection of the columns of a file that contain time, position, velocity, acceleration, effort and command."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding, RecordingError
from armid.measurement.columns.clocks import Values, evenly_growing, unit_of_step
from armid.measurement.columns.column_guessing import ClockRequest, Guess, are_numbers, guess_columns, shortened
from armid.measurement.columns.joint_name_comparison import missing_joints, other_arm, refuse_other_joints
from armid.measurement.columns.missing_channels import joints_of_channels, uneven_channels
from armid.measurement.columns.stated_columns import refuse_two_efforts, stated_columns
from armid.measurement.columns.units import factors, hold_current, overruled, stated_units, unit_fields
from armid.measurement.columns.unread import ambiguous_columns, effort_possible, positions_missing
from armid.measurement.log_format import QUANTITIES, LogFormat
from armid.measurement.recording import Recording
from armid.measurement.remedy_builders import lines, naming
from armid.remedy import Remedy
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class Selection:
    """Columns of one file that were chosen for each quantity.

    Attributes:
        time: Names of the time columns: none, one, or two (seconds and nanoseconds).
        q: Names of the position columns, one for each channel, or the name of one matrix with all channels.
        dq: Names of the velocity columns, as for `q`; empty if there are none.
        ddq: Names of the acceleration columns, as for `q`; empty if there are none.
        effort: Names of the effort columns, as for `q`; empty if there are none.
        command: Names of the columns of commanded positions, as for `q`; empty if there are none.
        guessed: Fields of the log format that were guessed from the names of the columns.
        findings: Findings about the guesses.
    """

    time: tuple[str, ...]
    q: tuple[str, ...]
    dq: tuple[str, ...]
    ddq: tuple[str, ...]
    effort: tuple[str, ...]
    command: tuple[str, ...] = ()
    guessed: Mapping[str, Any] = field(default_factory=dict[str, Any])
    findings: tuple[Finding, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all chosen columns, without duplicates."""
        return tuple(dict.fromkeys((*self.time, *self.q, *self.dq, *self.ddq, *self.effort, *self.command)))


def select(
    names: Sequence[str],
    log_format: LogFormat,
    path: Path,
    robot: Robot | None = None,
    *,
    matrices: bool = False,
    values: Values | None = None,
) -> Selection:
    """Chooses columns by the names in the log format, the names of its preset, the usual names, or a guess.

    Args:
        names: Columns or variables of the file.
        log_format: Log format of the file.
        path: The file, for messages.
        robot: The arm; the names of its joints may occur in the names of the columns.
        matrices: True if one variable of the file may contain all channels as a matrix.
        values: Function that returns the numbers of a column. It is used to detect a clock that its name does not
            indicate.

    Raises:
        RecordingError: A named column does not exist, numbered columns have a gap, no columns contain positions, or
            several sets of columns may contain positions. The message lists the columns.
    """
    present = dict.fromkeys(names)
    chosen = stated_columns(present, log_format, path, robot)
    guess = Guess({})
    if log_format.preset is None and (
        open_ := [name for name in QUANTITIES if not chosen[name] and name not in log_format.columns]
    ):
        guess = _guess(present, open_, chosen, log_format, robot, path, matrices=matrices, values=values)
        chosen |= guess.columns
    chosen["command"] = _command(chosen, guess, log_format, path, values)
    labels = _labels(log_format, robot)[0]
    if robot is not None and not guess.joints and (not chosen["q"] or "q" in guess.columns):
        incomplete = None if chosen["q"] else missing_joints(names, robot, labels, path)
        refuse_other_joints(names, log_format, robot, labels, chosen["q"], path, incomplete)
    if not chosen["q"]:
        clocks: dict[str, float] = {}
        if values is not None and _lacks_clock(chosen, log_format):
            clocks = evenly_growing(list(present), set(chain.from_iterable(chosen.values())), values)
        raise positions_missing(present, chosen, log_format, path, robot, labels, clocks=clocks)
    if log_format.drive_gain is not None and "effort" not in log_format.columns and log_format.preset is None:
        refuse_two_efforts(chosen["effort"], present, path)
    guessed = _as_fields(guess, log_format, robot) | unit_fields(chosen, log_format)
    contradicted = overruled(chosen, log_format)
    doubt = "" if robot is None or guess.joints else other_arm(guess.columns.get("q", ()), labels, robot.name)
    findings = _findings(guess, guessed, chosen, contradicted, doubt)
    if contradicted:
        remedy = "correct the names of the columns, or remove these keys from the study"
        findings += (Finding("units-of-header", "warning", "", " ".join(contradicted.values()), remedy),)
    if values is not None and _lacks_clock(chosen, log_format):
        findings += _possible_clocks(present, chosen, values, log_format)
    joints = joints_of_channels(len(chosen["q"]), log_format, robot)
    if len(chosen["q"]) > 1 and len(chosen["effort"]) > 1 and len(chosen["q"]) != len(chosen["effort"]):
        raise uneven_channels(chosen, len(chosen["q"]), len(chosen["effort"]), path, log_format, joints)
    findings += _undecided(guess, log_format)
    findings += effort_possible(list(present), chosen, log_format, labels, joints)
    return Selection(**chosen, guessed=guessed, findings=findings)


def assemble(
    selection: Selection,
    column: Callable[[str], NDArray[Any]],
    log_format: LogFormat,
    path: Path,
    joint_names: Sequence[str] = (),
) -> Recording:
    """Builds the recording from the chosen columns of a file.

    Args:
        selection: Names of the chosen columns.
        column: Function that returns the numbers of a column or matrix, given its name; shape (N,) or (N, n).
        log_format: Log format of the file.
        path: Path of the file.
        joint_names: Names of the channels in the file; empty if it has none.
    """
    quantities = (*selection.q, *selection.dq, *selection.ddq, *selection.effort, *selection.command)
    names_hold = "units" not in overruled({"q": selection.q, "time": selection.time}, log_format)
    scale = factors(quantities, selection.guessed.get("units", log_format.units), angles=names_hold)

    def scaled(name: str) -> NDArray[Any]:
        return column(name) if scale.get(name, 1.0) == 1.0 else column(name) * scale[name]

    q = _matrix(selection.q, scaled, path)
    effort = _matrix(selection.effort, scaled, path) if selection.effort else None
    if effort is not None and effort.ndim == q.ndim == 2 and effort.shape[1] != q.shape[1]:
        chosen = {name: found for name in QUANTITIES if (found := getattr(selection, name))}
        raise uneven_channels(chosen, q.shape[1], effort.shape[1], path, log_format)
    command = _matrix(selection.command, scaled, path) if selection.command else None
    if command is not None and command.ndim == q.ndim == 2 and command.shape[1] != q.shape[1]:
        if "command" in log_format.columns:
            raise _uneven_command(q.shape[1], command.shape[1], path)
        command, selection = None, replace(selection, command=())  # another quantity of that name
    return Recording(
        time=_time(selection.time, column, selection.guessed.get("time_unit", log_format.clock_unit)),
        q=q,
        dq=_matrix(selection.dq, scaled, path) if selection.dq else None,
        ddq=_matrix(selection.ddq, scaled, path) if selection.ddq else None,
        effort=effort,
        command=command,
        joint_names=tuple(joint_names),
        rate=log_format.rate,
        consecutive=log_format.consecutive,
        effort_is_current=hold_current(selection.effort, selection.q),
        columns={name: found for name in QUANTITIES if (found := getattr(selection, name))},
        guessed=selection.guessed,
        findings=selection.findings,
        source=str(path),
    )


def _command(
    chosen: Mapping[str, tuple[str, ...]], guess: Guess, log_format: LogFormat, path: Path, values: Values | None
) -> tuple[str, ...]:
    """Columns of the command beside the chosen positions; empty if columns with usual names cannot be the command.

    They must be numbers, one column for each column of measured positions, or one matrix; the positions must not be
    commanded positions, which are used if none were measured.

    Raises:
        RecordingError: The log format names a number of columns that is not that of the positions.
    """
    columns, q = chosen["command"], chosen["q"]
    even = len(columns) in (1, len(q)) or len(q) == 1
    if not columns or "command" in guess.columns:
        return columns
    if "command" in log_format.columns:
        if q and not even:
            raise _uneven_command(len(q), len(columns), path)
        return columns
    fits = even and columns != q and "q" not in guess.commanded
    return columns if fits and (values is None or are_numbers(columns, values)) else ()


def _uneven_command(q: int, command: int, path: Path) -> RecordingError:
    """Error for positions and a command with different numbers of channels."""
    return RecordingError(
        f"{path} has {q} channels of positions (q), but {command} of the command.",
        remedy="name the same number of columns for `q` and `command` in `columns`, and lock the joints that were "
        "not recorded; or leave the command out with an empty name.",
    )


def _undecided(guess: Guess, log_format: LogFormat) -> tuple[Finding, ...]:
    """Finding about several sets of columns that may contain the commanded position."""
    if not guess.undecided:
        return ()
    sets = "; ".join(shortened(columns) for columns in guess.undecided)
    evidence = f"Several sets of columns may hold the commanded position: {sets}. None of them is used."
    remedy = naming(log_format, {"command": guess.undecided[0]}, "if it is the position that the drive was given")
    return (Finding("command-possible", "info", "command", evidence, remedy),)


def _guess(
    present: Mapping[str, Any],
    quantities: Sequence[str],
    chosen: Mapping[str, tuple[str, ...]],
    log_format: LogFormat,
    robot: Robot | None,
    path: Path,
    *,
    matrices: bool,
    values: Values | None,
) -> Guess:
    """Guesses the columns of the quantities for which no columns are chosen yet.

    Raises:
        RecordingError: Several sets of columns fit equally well.
    """
    wanted, labels = _labels(log_format, robot)
    guess = guess_columns(
        list(present),
        quantities,
        wanted=wanted,
        labels=labels,
        channels=len(chosen["q"]),
        matrices=matrices,
        in_file_order=log_format.joints_numbered,
        values=values,
    )
    if isinstance(guess, ClockRequest):
        raise ambiguous_columns(guess, chosen["q"], log_format, path)
    return guess


def _labels(log_format: LogFormat, robot: Robot | None) -> tuple[list[str], list[str]]:
    """Names, in the file, of the joints of the arm and of all joints of its description (including locked joints)."""
    named = {} if log_format.joints_numbered else log_format.joint_map
    in_file = {joint: name for name, joint in named.items() if joint}
    wanted, labels = ([], []) if robot is None else (robot.joint_names, robot.described_joints)
    return [in_file.get(name, name) for name in wanted], [in_file.get(name, name) for name in labels]


def _as_fields(guess: Guess, log_format: LogFormat, robot: Robot | None) -> dict[str, Any]:
    """Fields of a log format (`columns`, `joints`) with which the guessed columns would be selected."""
    if not guess.columns:
        return {}
    fields: dict[str, Any] = {"columns": {**log_format.columns, **guess.columns}}
    if robot is not None and guess.joints and not log_format.joints:
        fields["joints"] = guess.joints
    elif guess.joints and not log_format.joints_numbered:
        fields["joints"] = tuple(log_format.joint_map.get(label, label) for label in guess.joints)
    if robot is not None and not log_format.joints and fields.get("joints") == robot.joint_names:
        del fields["joints"]
    return fields


def _findings(
    guess: Guess,
    guessed: Mapping[str, Any],
    chosen: Mapping[str, tuple[str, ...]],
    contradicted: Collection[str],
    doubt: str,
) -> tuple[Finding, ...]:
    """Findings about guessed columns and units, each with the lines of a study that state them explicitly."""
    units = stated_units(chosen, contradicted)
    chosen_by = "The time column was chosen by its name" if set(guess.columns) == {"time"} else ""
    chosen_by = chosen_by or "The columns were chosen by their names"
    sentences = [f"{chosen_by}: {'; '.join(guess.reasons)}."] if guess.columns else []
    sentences += [f"The units were taken from the names of the columns: {units}."] if units else []
    sentences += [doubt] if doubt else []
    if not sentences:
        return ()
    plain: dict[str, Any] = {
        key: list(value) if isinstance(value, tuple) else value for key, value in guessed.items()
    }
    if guess.columns:
        every: Mapping[str, tuple[str, ...]] = guessed["columns"]
        plain["columns"] = {name: each[0] if len(each) == 1 else list(each) for name, each in every.items()}
    severity = "warning" if guess.commanded or doubt else "info"
    code = "columns-guessed" if guess.columns else "units-of-header"
    return (Finding(code, severity, "", " ".join(sentences), lines(**plain) if plain else ""),)


def _lacks_clock(chosen: Mapping[str, tuple[str, ...]], log_format: LogFormat) -> bool:
    """Checks whether a time column is needed but missing.

    None is needed if the log format has a rate or a preset, or states that the rows are not consecutive.
    """
    needed = log_format.rate is None and log_format.consecutive is not False and log_format.preset is None
    return needed and not chosen["time"] and "time" not in log_format.columns


def _possible_clocks(
    present: Mapping[str, Any], chosen: Mapping[str, tuple[str, ...]], values: Values, log_format: LogFormat
) -> tuple[Finding, ...]:
    """Finding that lists unused columns that increase uniformly, of which one may be the missing clock."""
    found = evenly_growing(list(present), set(chain.from_iterable(chosen.values())), values)
    if not found:
        return ()
    columns = ", ".join(f"{name!r} (by {step:.6g} per row)" for name, step in found.items())
    evidence = f"Of the unused columns, {columns} increase{'' if len(found) > 1 else 's'} uniformly, like a clock."
    name, step = next(iter(found.items()))
    counted = unit_of_step(step)
    remedy = naming(log_format, {"time": name}, "if it is the clock" if counted is None else "")
    if counted is not None:
        unit = lines(f"if it is the clock; its steps suggest that it counts {counted[1]}", time_unit=counted[0])
        remedy = Remedy(*remedy.parts, *unit.parts, note=unit.note)
    return (Finding("clock-possible", "info", "time", evidence, remedy),)


def numeric(values: NDArray[Any], name: str, path: Path) -> Array:
    """Converts the values of a column to float64.

    Raises:
        RecordingError: The column has values other than real numbers, or is not a vector or matrix.
    """
    kind = getattr(values, "dtype", None)  # an archive may hold files of other kinds
    if kind is None or kind.kind not in "fiub":
        raise RecordingError(
            f"{path}: {name!r} holds {type(values).__name__ if kind is None else kind.name}, not numbers.",
            remedy="save plain arrays of real numbers, or name another column.",
        )
    if values.ndim not in (1, 2):
        raise RecordingError(
            f"{path}: {name!r} has {values.ndim} dimensions.",
            remedy="save a matrix with one row for each sample and one column for each joint.",
        )
    return values.astype(np.float64)


def _matrix(names: tuple[str, ...], column: Callable[[str], NDArray[Any]], path: Path) -> NDArray[Any]:
    """Reads several columns, or one matrix, into one matrix of shape (N, n)."""
    values = [column(name) for name in names]
    if len(values) == 1:
        return values[0] if values[0].ndim == 2 else values[0][:, None]
    if len({len(column) for column in values}) > 1:
        found = ", ".join(f"{name} {len(column)}" for name, column in zip(names, values, strict=True))
        raise RecordingError(f"{path}: columns differ in length: {found}.", remedy="save all channels completely.")
    return np.column_stack(values)


def _time(names: tuple[str, ...], column: Callable[[str], NDArray[Any]], unit: float) -> NDArray[Any] | None:
    """Times [s] from one column, or from a column of seconds and a column of nanoseconds; `None` without columns."""
    if not names:
        return None
    first = column(names[0]).reshape(-1)
    if len(names) == 1:
        return first * unit
    # The first whole second is subtracted before the sum, since 1e9 s would leave no digits for nanoseconds.
    return (first - first[:1]) + 1e-9 * column(names[1]).reshape(-1)
