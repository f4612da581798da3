"""Comparison of the joint names in a log with the joints of the description."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from fnmatch import fnmatchcase
from itertools import takewhile
from pathlib import Path

from armid.errors import RecordingError
from armid.measurement.columns.column_name_parsing import (
    COMMANDED,
    MEASURED,
    OTHER,
    QUANTITIES,
    WORDS,
    named,
    quantity_of,
    split_unit,
    words,
)
from armid.measurement.log_format import LogFormat
from armid.measurement.remedy_builders import naming
from armid.remedy import Remedy, setting
from armid.robot.robot import Robot

LISTED = 12
"""Largest number of joints that are named in a message."""

ANGLES = frozenset(("roll", "pitch", "yaw"))
"""Words that describe the orientation of a body and are also usual in names of joints."""

GENERIC = frozenset("joint joints jnt axis axes arm robot motor motors link ch channel dof state states".split())
"""Words that do not identify an arm. Words of fewer than three letters do not identify an arm, either."""


def stated_joints(names: Sequence[str], quantity: str) -> dict[str, str]:
    """Columns of a quantity, by the names of the joints that the column names contain.

    The name of the joint is the name of the column without the words for the quantity.

    Args:
        names: All columns.
        quantity: `q`, `dq`, `ddq`, `effort` or `current`.
    """
    said = {*QUANTITIES[quantity], *MEASURED, *COMMANDED, "actual"}
    found: dict[str, str] = {}
    for column in names:
        text = split_unit(column)[0]
        parts = words(text)
        if quantity_of(parts) != quantity or (OTHER - ANGLES) & set(parts):
            continue
        spans = [hit.span() for hit in WORDS.finditer(text) if hit[0].lower() not in said]
        if spans:
            found.setdefault(text[spans[0][0] : spans[-1][1]], column)
    return found


def refuse_other_joints(
    names: Sequence[str],
    log_format: LogFormat,
    robot: Robot,
    labels: Sequence[str],
    numbered: Sequence[str],
    path: Path,
    incomplete: RecordingError | None = None,
) -> None:
    """Raises an error if the columns of a log name joints that do not match the joints of the description.

    The error is also raised if they name only some of its joints. Columns whose names differ only in a number are
    numbered channels; for these, an error is raised if their number differs from the number of joints and their names
    contain the name of another arm.

    Args:
        names: All columns.
        log_format: Log format of the file.
        robot: The arm.
        labels: Names that the joints of the arm have in the file.
        numbered: Columns of positions that would be read by their numbers.
        path: The file.
        incomplete: Error that is raised if the log has only some of the joints; `None` if it has all or none of them.

    Raises:
        RecordingError: The log names other joints; the message lists both and the columns to name.
    """
    stated = stated_joints(names, "q")
    known = (*labels, *robot.described_joints)
    if incomplete is not None and all(any(same_joint(label, name) for label in known) for name in stated):
        raise incomplete
    stems = Counter(_stem(name) for name in stated)
    by_word = [name for name in stated if stems[_stem(name)] == 1]
    fitting = len(numbered) in (robot.n, len(robot.described_joints))
    words_differ = len(by_word) >= 2 and not (fitting and len(numbered) > len(by_word))
    other_series = not fitting and other_arm(numbered, labels, robot.name) != ""
    if log_format.joints or not (words_differ or other_series):
        if incomplete is not None:
            raise incomplete
        return
    columns = {quantity: stated_joints(names, quantity) for quantity in ("q", "dq", "ddq", "effort")}
    if not columns["effort"]:
        columns["effort"] = stated_joints(names, "current")
    compared = comparison(tuple(stated.values()), labels, robot.name, what="has positions")
    raise RecordingError(
        f"{path}: {compared}",
        possible=f"columns of positions: {', '.join(stated.values())}",
        remedy=_remedy(columns, log_format, robot, labels),
    )


def missing_joints(names: Sequence[str], robot: Robot, labels: Sequence[str], path: Path) -> RecordingError | None:
    """Error for a log with columns of positions for only some joints of the arm; `None` for all or no joints.

    Args:
        names: All columns.
        robot: The arm.
        labels: Names that the joints of the arm have in the file.
        path: The file.
    """
    columns = columns_of_joints(names, labels, ("q",))
    missing = [joint for joint, label in zip(robot.joint_names, labels, strict=True) if label not in columns]
    recorded = [joint for joint in robot.joint_names if joint not in missing]
    if not recorded or not missing:
        return None
    locked = ""
    if len(missing) <= min(len(recorded), LISTED):
        still = f"{', '.join(missing)} stood still, lock {'it' if len(missing) == 1 else 'them'}"
        locks = " ".join(f"--lock {joint}" for joint in missing)
        locked = f"if {still}: {locks} (with =VALUE after the name if the position is not 0); or "
    return RecordingError(
        f"{path}: No column holds the position of {_listed(missing)}; the log has positions of {len(recorded)} of "
        f"the {robot.n} joints of {robot.name}: {_listed(recorded)}.",
        possible=f"columns of positions: {_listed(list(columns.values()))}",
        remedy=f"{locked}select the recorded joints: --only {shlex.quote(_selection(recorded, robot))}, or --tip "
        "with another link. In a study, lock, only and tip are keys of [robot].",
    )


def columns_of_joints(names: Sequence[str], labels: Sequence[str], quantities: Collection[str]) -> dict[str, str]:
    """First column of the given quantities for each joint that has one, by the name of the joint in the file.

    Args:
        names: Columns.
        labels: Names of the joints in the file.
        quantities: Selection of `q`, `dq`, `ddq`, `effort` and `current`.
    """
    longest = sorted(labels, key=lambda label: -len(words(label)))
    found: dict[str, str] = {}
    for column in names:
        for each in named(column, longest):
            if each.quantity in quantities and isinstance(each.channel, str) and each.channel:
                found.setdefault(each.channel, column)
    return {label: found[label] for label in labels if label in found}


def _selection(joints: Sequence[str], robot: Robot) -> str:
    """Value of an option such as `--only` that selects the given joints: a pattern, or the list of their names."""
    same = takewhile(lambda letters: len(set(letters)) == 1, zip(*joints, strict=False))
    pattern = "".join(letters[0] for letters in same) + "*"
    selected = [name for name in robot.described_joints if fnmatchcase(name, pattern)]
    return pattern if len(joints) > 1 and selected == list(joints) else ",".join(joints)


def comparison(in_log: Sequence[str], labels: Sequence[str], robot: str, *, what: str = "names joints") -> str:
    """Text that compares the joint names in a log with the joints of the description and counts the matches.

    Args:
        in_log: Names of joints in the log.
        labels: Names that the joints of the description would have in the log.
        robot: Name of the arm.
        what: Verb and object of the statement about the log: `names joints` or `has positions`.
    """
    matching = sum(any(same_joint(label, name) for name in in_log) for label in labels)
    count = f"{matching} of {len(labels)} match" if matching else "none match"
    return f"The log {what} {_listed(in_log)}; {robot} has {_listed(labels)}: {count}."


def same_joint(label: str, name: str) -> bool:
    """Checks whether a name in a log contains all words of a joint name; a prefix, for instance, is ignored."""
    parts, form = words(name), words(label)
    return any(parts[k : k + len(form)] == form for k in range(len(parts) - len(form) + 1))


def other_arm(columns: Sequence[str], labels: Sequence[str], robot: str) -> str:
    """Text with a warning if the names of numbered columns contain the name of another arm; otherwise empty.

    Args:
        columns: Columns of positions that are read by their numbers.
        labels: Names that the joints of the arm have in the file.
        robot: Name of the arm.
    """
    names = list(stated_joints(columns, "q"))
    known = {word for label in (*labels, robot) for word in words(label)}
    telling = [
        word for word in words(names[0] if names else "") if len(word) > 2 and word.isalpha() and word not in GENERIC
    ]
    if len(names) != len(columns) or not telling or any(word in known for word in telling):
        return ""
    return (
        f"{comparison(names, labels, robot)} The columns were assigned to the joints by number; check that "
        "the log was recorded on this arm."
    )


def _stem(name: str) -> str:
    """Name in which `#` replaces each number."""
    return re.sub(r"\d+", "#", name)


def _remedy(
    columns: Mapping[str, Mapping[str, str]], log_format: LogFormat, robot: Robot, labels: Sequence[str]
) -> Remedy:
    """Remedy: give another description, lock joints that were not recorded, or name the columns by joint."""
    stated = columns["q"]
    missing = [label for label in labels if not any(same_joint(label, name) for name in stated)]
    locked = (
        f", lock joints that were not recorded ({' '.join(f'--lock {each}' for each in missing)})"
        if len(missing) < len(labels)
        else ""
    )
    if len(stated) != robot.n:
        pattern = setting("columns", {"q": ["…", "…"]})
        return Remedy(
            f"give the description of the recorded arm{locked}; or name the columns of the {robot.n} joints in the "
            f"order {', '.join(labels)}: ",
            pattern,
        )
    whole = {key: _in_order(found, stated) for key, found in columns.items()}
    named = naming(log_format, {key: found for key, found in whole.items() if found})
    order = f"; or, if they are the joints {', '.join(labels)} in this order, name them: "
    return Remedy(f"give the description of the recorded arm{locked}{order}", *named.parts)


def _in_order(found: Mapping[str, str], joints: Collection[str]) -> list[str]:
    """Columns of a quantity in the order of the joints; empty if the column of a joint is missing."""
    return [found[joint] for joint in joints] if all(joint in found for joint in joints) else []


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more
