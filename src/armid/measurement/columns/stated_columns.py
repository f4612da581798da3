"""Columns by the names in a log format, the names of its preset, or the usual names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from armid.errors import RecordingError
from armid.measurement.columns.missing_channels import with_joints
from armid.measurement.columns.unread import no_such_column
from armid.measurement.log_format import PRESETS, QUANTITIES, LogFormat
from armid.remedy import Remedy, setting
from armid.robot.robot import Robot

DEFAULTS: Mapping[str, tuple[str, ...]] = {
    "time": ("t", "time", "timestamp"),
    "q": ("q{}", "q"),
    "dq": ("dq{}", "qd{}", "dq", "qd"),
    "ddq": ("ddq{}", "qdd{}", "ddq", "qdd"),
    "effort": ("tau{}", "effort{}", "torque{}", "tau", "effort", "torque", "i{}"),
    "command": ("command{}", "cmd{}", "q_cmd{}", "action{}", "command", "cmd", "q_cmd", "action"),
}
"""Column names that are tried, in this order, for a quantity without names in the log format; `{}` is replaced by the
numbers 1, 2, …."""


def stated_columns(
    present: Mapping[str, Any], log_format: LogFormat, path: Path, robot: Robot | None
) -> dict[str, tuple[str, ...]]:
    """Columns of each quantity by the names in the log format, the names of its preset, or the usual names."""
    chosen: dict[str, tuple[str, ...]] = {}
    for quantity in QUANTITIES:
        if quantity in log_format.columns:
            patterns = tuple(log_format.columns[quantity])
            chosen[quantity] = _named(patterns, present, quantity, path) if patterns else ()
        elif log_format.preset is not None:
            patterns = PRESETS[log_format.preset].columns.get(quantity, ())
            needed = patterns and quantity in ("time", "q")
            chosen[quantity] = (
                _named(patterns, present, quantity, path)
                if needed
                else tuple(chain.from_iterable(expand(pattern, present, path) for pattern in patterns))
            )
        else:
            joints = () if robot is None or robot.held or log_format.joints else robot.joint_names
            found = (expand(pattern, present, path, joints, usual=True) for pattern in DEFAULTS[quantity])
            chosen[quantity] = next((columns for columns in found if columns), ())
    return chosen


def _named(patterns: tuple[str, ...], present: Mapping[str, Any], quantity: str, path: Path) -> tuple[str, ...]:
    """Names of the columns that a single pattern or a list of names selects; all of them must exist in the file."""
    if len(patterns) == 1:
        found = expand(patterns[0], present, path)
        if not found:
            raise no_such_column(f"No column is called {patterns[0]!r}", present, quantity, path)
        return found
    missing = [name for name in patterns if name not in present]
    if missing:
        raise no_such_column(f"No column is called {', '.join(map(repr, missing))}", present, quantity, path)
    return patterns


def expand(
    pattern: str, present: Mapping[str, Any], path: Path, joints: Sequence[str] = (), *, usual: bool = False
) -> tuple[str, ...]:
    """Columns that match a pattern, in the order of their numbers.

    The numbers start at 1 for `{}` and at 0 for `{0}`; usual names from 0 do not match and are guessed later.
    """
    for braces, first in (("{}", 1), ("{0}", 0)):
        if braces not in pattern:
            continue
        before, after = pattern.split(braces, 1)
        form = re.compile(re.escape(before) + r"(\d+)" + re.escape(after))
        numbered = {int(hit[1]): name for name in present if (hit := form.fullmatch(name))}
        if not numbered:
            return ()
        if usual and sorted(numbered) == list(range(len(numbered))):
            return ()  # guessed instead, with a finding
        expected = range(first, first + len(numbered))
        if sorted(numbered) != list(expected):
            found = ", ".join(numbered[i] for i in sorted(numbered))
            last = min(max(numbered), first + 2 * len(numbered))  # a number can have any number of digits
            gaps = {i - first: f"{before}{i}{after}" for i in range(first, last) if i not in numbered}
            missing = f"; missing: {with_joints(gaps, joints)}" if len(gaps) < len(numbered) else ""
            raise RecordingError(
                f"{path}: the numbers of the columns {pattern!r} must start at {first} and have no gap; found "
                f"{found}{missing}.",
                possible="in a pattern, {} counts from 1 and {0} from 0; a list may contain any names",
                remedy="log the missing columns, too; or list the names of the columns under the key `columns`, and "
                "lock joints that were not recorded.",
            )
        return tuple(numbered[i] for i in expected)
    return (pattern,) if pattern in present else ()


def refuse_two_efforts(effort: tuple[str, ...], present: Mapping[str, Any], path: Path) -> None:
    """Raises an error if drive gains are given and the file has both torque and current columns."""
    current = expand("i{}", present, path)
    if effort and current and effort != current:
        raise RecordingError(
            f"{path} has the columns {effort[0]} … and {current[0]} …, and it is not clear to which of them "
            "`drive_gain` applies.",
            remedy=Remedy("name the effort columns, for instance ", setting("columns", {"effort": "i{}"}), "."),
        )
