"""Reader of the folders of SAGE: states and commands of the joints in two files with time stamps of their own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding, RecordingError
from armid.measurement.held_command import last_command, with_held_command
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording, select_rows
from armid.measurement.remedy_builders import naming
from armid.measurement.text_table import TextTable, decoded, numbers_of, table_of
from armid.robot.robot import Robot

STATES, COMMANDS, JOINTS, EVENTS = "state_motor.csv", "control.csv", "joint_list.txt", "event.csv"

TIME = "timestamp"

OF_STATES = {"q": "positions", "dq": "velocities", "effort": "torques"}
"""Columns of the states, whose fields are lists with one number for each joint."""

MICROSECOND = 1e-6
"""Unit of the time stamps [s]."""

SWITCHED_ON, SWITCHED_OFF = "CONTROL_MODE_ENABLE", "DISABLE"
"""Events between which the drives are switched on."""


def read(path: Path, log_format: LogFormat, robot: Robot | None = None) -> Recording:
    """Reads `state_motor.csv` and, if they are there, `control.csv`, `joint_list.txt` and `event.csv` of a folder.

    Each state has the last command at or before it. States while the drives are switched off are left out. Torques
    without a negative value are a load without sign and are not read, unless the log format names them as effort.

    Raises:
        RecordingError: A file has no table or lacks a column, or the files have different numbers of joints.
    """
    table = _table(path / STATES)
    unit = MICROSECOND if log_format.time_unit is None else log_format.time_unit
    named = {key: name for key, name in OF_STATES.items() if log_format.columns.get(key) != () or key == "q"}
    named |= {key: names[0] for key, names in log_format.columns.items() if key in OF_STATES and names}
    wanted = {
        key: name for key, name in named.items() if key == "q" or key in log_format.columns or name in table.names
    }
    values = _columns(table, (TIME, *wanted.values()), path / STATES)
    found = {key: values[name] for key, name in wanted.items()}
    findings = list(table.findings)
    if "effort" in found and "effort" not in log_format.columns and not (found["effort"] < 0.0).any():
        del found["effort"]
        findings.append(_unsigned(named["effort"], log_format))
    time = values[TIME][:, 0]
    recording = Recording(
        time=time * unit,
        joint_names=_joint_names(path, found["q"].shape[1]),
        rate=log_format.rate,
        consecutive=log_format.consecutive,
        source=str(path),
        q=found["q"],
        dq=found.get("dq"),
        effort=found.get("effort"),
    )
    recording, off = _switched_on(recording, time, path)
    findings += off
    if (path / COMMANDS).is_file() and log_format.columns.get("command") != ():
        recording, finding = _with_command(recording, path / COMMANDS, unit)
        findings.append(finding)
    return replace(recording, number=None, findings=tuple(findings))


def _table(path: Path) -> TextTable:
    return table_of(decoded(path.read_bytes(), path), path)


def _columns(table: TextTable, names: tuple[str, ...], path: Path) -> dict[str, Array]:
    """Columns of a table by name, as matrices."""
    missing = [name for name in names if name not in table.names]
    if missing:
        raise RecordingError(
            f"{path} has no column {missing[0]!r}.",
            possible=", ".join(table.names),
            remedy="record again, or name the columns of q, dq and effort under `columns`.",
        )
    found = numbers_of(table, names, path)
    return {name: values if values.ndim == 2 else values[:, None] for name, values in found.items()}


def _joint_names(path: Path, joints: int) -> tuple[str, ...]:
    """Names in the list of joints, one in each line; empty if there is no list."""
    if not (path / JOINTS).is_file():
        return ()
    text = decoded((path / JOINTS).read_bytes(), path / JOINTS)
    names = tuple(line.strip() for line in text.splitlines() if line.strip())
    if len(names) != joints:
        raise RecordingError(
            f"{path / JOINTS} lists {len(names)} joints, but {STATES} has {joints} positions in each row.",
            possible=", ".join(names),
            remedy="correct the list of joints: one name in each line, in the order of the positions.",
        )
    return names


def _unsigned(column: str, log_format: LogFormat) -> Finding:
    evidence = (
        f"The column {column!r} has no negative value: it is a load without sign, not a torque. It was not read."
    )
    return Finding("effort-possible", "info", "effort", evidence, naming(log_format, {"effort": column}, "if it is"))


def _switched_on(recording: Recording, stamps: NDArray[np.float64], path: Path) -> tuple[Recording, list[Finding]]:
    """Leaves out the states before the drives are switched on and after they are switched off.

    Args:
        recording: Recording of all states.
        stamps: Time stamps of the states in the unit of the file, shape (N,).
        path: The folder.
    """
    if not (path / EVENTS).is_file():
        return recording, []
    table = _table(path / EVENTS)
    times = _columns(table, (TIME,), path / EVENTS)[TIME][:, 0]
    words = [table.fields(k)[-1].strip() for k in range(len(times))]
    on = min((t for t, word in zip(times, words, strict=True) if word == SWITCHED_ON), default=-np.inf)
    off = min((t for t, word in zip(times, words, strict=True) if word == SWITCHED_OFF and t > on), default=np.inf)
    inside = (stamps >= on) & (stamps <= off)
    if inside.all() or not inside.any():
        return recording, []
    evidence = (
        f"{int((~inside).sum())} states while the drives were switched off are left out, according to {EVENTS}."
    )
    return select_rows(recording, inside), [Finding("switched-off", "info", "", evidence)]


def _with_command(recording: Recording, path: Path, unit: float) -> tuple[Recording, Finding]:
    """Adds the last command at or before each state."""
    values = _columns(_table(path), (TIME, "positions"), path)
    given, command = values[TIME][:, 0] * unit, values["positions"]
    if command.shape[1] != recording.n:
        raise RecordingError(
            f"{path} has commands for {command.shape[1]} joints, but {STATES} has positions of {recording.n}.",
            remedy="record both files with the same joints.",
        )
    order = np.argsort(given, kind="stable")
    given, command = given[order], command[order]
    assert recording.time is not None
    last, before = last_command(recording.time, given)
    oldest = float((recording.time - given[last]).max(initial=0.0))
    return with_held_command(recording, command[last], before, oldest, path.name)
