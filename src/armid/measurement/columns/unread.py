"""Findings and errors about columns that were not read and that may contain a missing quantity."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path

from armid.errors import Finding, RecordingError
from armid.measurement.columns.clocks import ClockRequest, unit_of_step
from armid.measurement.columns.column_guessing import shortened
from armid.measurement.columns.column_name_parsing import split_unit, words
from armid.measurement.columns.joint_name_comparison import columns_of_joints
from armid.measurement.columns.missing_channels import incomplete_effort, remedy_of, with_joints
from armid.measurement.log_format import PRESETS, LogFormat
from armid.measurement.remedy_builders import naming
from armid.remedy import Remedy, setting
from armid.robot.robot import Robot

NAMED = 12
"""Largest number of columns that are named in a message."""

LISTED = 60
"""Largest number of names in a list of all columns, because the log of a controller may have hundreds."""


def effort_possible(
    names: Sequence[str],
    chosen: Mapping[str, Sequence[str]],
    log_format: LogFormat,
    labels: Sequence[str],
    joints: Sequence[str] = (),
) -> tuple[Finding, ...]:
    """Finding that lists the unread columns of a file without effort, with a remedy that declares them as effort.

    Args:
        names: All columns.
        chosen: Names of the columns of each quantity.
        log_format: Log format of the file.
        labels: Names that the joints have in the file.
        joints: Names of the joints of numbered channels; empty if they are unknown.
    """
    if chosen["effort"] or "effort" in log_format.columns or log_format.preset is not None:
        return ()
    used = set(chain.from_iterable(chosen.values()))
    unread = [name for name in names if name not in used]
    if not unread:
        return ()
    listed = unread if len(unread) <= NAMED else [*unread[: NAMED - 1], f"… {unread[-1]}"]
    evidence = f"No column was read as effort; unread columns: {', '.join(listed)}."
    sets = channel_sets(unread, labels, len(chosen["q"]))
    partly = max((columns_of_joints(unread, labels, (each,)) for each in ("effort", "current")), key=len)
    without = [label for label in labels if label not in partly]
    missing = ", ".join(without[:NAMED]) if partly else ""
    if missing:
        evidence += f" Some joints have a column of effort, but not {missing}."
        sets = [each for each in sets if not set(each) & {*partly.values()}]
    if sets:
        remedy = naming(log_format, {"effort": pattern_of(sets[0], names)}, "if they hold torque or current")
    elif missing:
        remedy = f"log the effort of {missing}, too, or lock joints that stood still (--lock, or lock in [robot])"
    else:
        remedy = ""
    numbered, absent = ((), {}) if partly or sets else incomplete_effort(unread, chosen["q"])
    if absent:
        evidence = (
            "Effort is read only if each joint has a column: the file has "
            f"{', '.join(numbered)}, but not {with_joints(absent, joints)}."
        )
        remedy = remedy_of(absent, numbered, chosen, joints, log_format)
    if len(sets) > 1:
        evidence += f" These sets have one column for each joint: {'; '.join(shortened(each) for each in sets)}."
    return (Finding("effort-possible", "info", "effort", evidence, remedy),)


def positions_missing(
    present: Iterable[str],
    chosen: Mapping[str, Sequence[str]],
    log_format: LogFormat,
    path: Path,
    robot: Robot | None,
    labels: Sequence[str],
    *,
    clocks: Mapping[str, float],
) -> RecordingError:
    """Error for a file without positions; its message also names other missing quantities and possible columns.

    Args:
        present: All columns.
        chosen: Names of the columns of each quantity.
        log_format: Log format of the file.
        path: The file.
        robot: The arm, if it is known.
        labels: Names that the joints of the arm have in the file.
        clocks: Unread columns that increase uniformly, with their median steps; one of them may be a missing clock.
    """
    used = {*chain.from_iterable(chosen.values()), *clocks}
    present = list(present)
    unread = [name for name in present if name not in used]
    sets = channel_sets(unread, labels, len(chosen["effort"]) if robot is None else robot.n)
    order = "" if robot is None else f" in the order {', '.join(robot.joint_names)}"
    missing = _missing(chosen, log_format)
    if sets:
        found: dict[str, str | Sequence[str]] = {}
        if "time" in missing and clocks:
            found["time"] = next(iter(clocks))
        found["q"] = pattern_of(sets[0], present)
        if "effort" in missing and len(sets) > 1:
            found["effort"] = pattern_of(sets[-1], present)
        note = f"if they hold {_listing([missing[name] for name in found], 'and')},{order}" if order else ""
        unknown = [missing[name] for name in missing if name not in found]
        note += f"; name the columns of {_listing(unknown, 'and')}, too" if unknown and order else ""
        remedy = naming(log_format, found, note)
        if "time" in found and (counted := unit_of_step(next(iter(clocks.values())))) is not None:
            remedy = Remedy(*remedy.parts, setting("time_unit", counted[0]), note=note)
    else:
        named = {name: "…" if name == "time" else ["…", "…"] for name in missing}
        remedy = Remedy(
            f"log the position of each joint; if the file has these columns, name them{order}: ",
            setting("columns", named),
            f"; or give a preset: --preset {', '.join(PRESETS)}, or the key `preset` in a study.",
        )
    taken = [f"{name} is {shortened(columns)}" for name, columns in chosen.items() if columns]
    guessed = f" From the names, {'; '.join(taken)}." if taken else ""
    problem = f"{path}: No column holds {_listing(list(missing.values()), 'or')}.{guessed}"
    return RecordingError(problem, possible=_listed(present), remedy=remedy)


def _missing(chosen: Mapping[str, Sequence[str]], log_format: LogFormat) -> dict[str, str]:
    """Names of the quantities that an identification needs and that have no columns, by their keys."""
    names = {"q": "positions", "effort": "effort (torque or current)", "time": "time"}
    left_out = {name for name, columns in log_format.columns.items() if not columns}
    if log_format.rate is not None or log_format.consecutive is False:
        left_out.add("time")
    return {key: name for key, name in names.items() if not chosen[key] and key not in left_out}


def _listing(names: Sequence[str], word: str) -> str:
    """Text that lists names: `a, b and c`, with the given word before the last name."""
    return f" {word} ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part)


def ambiguous_columns(request: ClockRequest, q: Sequence[str], log_format: LogFormat, path: Path) -> RecordingError:
    """Error that asks the user to choose the columns of all quantities with ambiguous guesses.

    For each quantity, the remedy proposes one set: the set whose names have most words in common with the columns of
    positions or, if these are unknown, with the first set.

    Args:
        request: Ambiguous guess of one quantity, with the guesses of the others.
        q: Columns of positions, if these are known.
        log_format: Log format of the file.
        path: The file.
    """
    requests = (request, *request.others)
    first = {*words(q[0] if q else request.sets[0][0])}
    proposed = {each.quantity: max(each.sets, key=lambda names: len(first & {*words(names[0])})) for each in requests}
    sets = [
        f"{len(each.sets)} sets of columns may hold {each.quantity}: {'; '.join(map(shortened, each.sets))}."
        for each in requests
    ]
    possible = "one of them" if len(requests) == 1 else "one of them for each quantity"
    return RecordingError(f"{path}: {' '.join(sets)}", possible=possible, remedy=naming(log_format, proposed))


def no_such_column(problem: str, present: Iterable[str], quantity: str, path: Path) -> RecordingError:
    """Error for a column that is named in the log format but does not exist in the file."""
    wanted = setting("columns", {quantity: "…" if quantity == "time" else ["…", "…"]})
    return RecordingError(
        f"{path}: {problem} for {quantity}.",
        possible=_listed(present),
        remedy=Remedy("give names that the file has: ", wanted, "."),
    )


def _listed(present: Iterable[str]) -> str:
    """Text that lists the names of columns; if there are too many, only the first names."""
    names = list(present)
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return (", ".join(names[:LISTED]) or "the file has no columns") + more


def channel_sets(names: Sequence[str], labels: Sequence[str], count: int) -> list[tuple[str, ...]]:
    """Sets of `count` columns, one column for each channel, whose names differ only in the joint.

    If there is no such set, but there are exactly `count` columns, all of them are one set.

    Args:
        names: Columns.
        labels: Names that the joints have in the file.
        count: Number of channels.
    """
    found: dict[tuple[str, ...], dict[str, str]] = {}
    longest = sorted(((label, words(label)) for label in labels), key=lambda each: -len(each[1]))
    for name in names:
        parts = words(split_unit(name)[0])
        for label, form in longest:
            at = next((k for k in range(len(parts)) if parts[k : k + len(form)] == form), None)
            if at is not None:
                found.setdefault((*parts[:at], "*", *parts[at + len(form) :]), {})[label] = name
                break
        else:
            number = next((k for k, part in enumerate(parts) if part.isdigit()), None)
            if number is not None:
                found.setdefault((*parts[:number], "#", *parts[number + 1 :]), {})[parts[number]] = name
    sets = [_in_order(members, labels) for members in found.values() if len(members) == count > 0]
    return sets or ([tuple(names)] if len(names) == count > 0 else [])


def pattern_of(columns: Sequence[str], names: Sequence[str]) -> str | Sequence[str]:
    """Pattern, such as `m{}_torque`, that matches exactly the given columns; if there is none, the columns."""
    for number in re.finditer(r"\d+", columns[0]):
        before, after = columns[0][: number.start()], columns[0][number.end() :]
        braces = {"0": "{0}", "1": "{}"}.get(number[0])
        numbered = re.compile(re.escape(before) + r"\d+" + re.escape(after))
        counted = [f"{before}{k + int(number[0])}{after}" for k in range(len(columns))]
        matched = {name for name in names if numbered.fullmatch(name)}
        if braces and len(columns) > 1 and counted == list(columns) and matched == set(columns):
            return before + braces + after
    return columns


def _in_order(members: Mapping[str, str], labels: Sequence[str]) -> tuple[str, ...]:
    if all(each in labels for each in members):
        return tuple(members[label] for label in labels if label in members)
    return tuple(members[each] for each in sorted(members, key=lambda each: (len(each), each)))
