"""Columns that nothing was read from, and those among them that may hold the effort that a recording lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain

from armid.errors import Finding
from armid.measurement.columns.guesses import shortened
from armid.measurement.columns.names import split_unit, words
from armid.measurement.log_format import LogFormat
from armid.measurement.remedy import naming

__all__ = ["effort_possible"]

NAMED = 12
"""Columns named in a message."""


def effort_possible(
    names: Sequence[str], chosen: Mapping[str, Sequence[str]], reading: LogFormat, labels: Sequence[str]
) -> tuple[Finding, ...]:
    """Unread columns of a file without effort, and the remedy that names them as effort.

    Args:
        names: All columns.
        chosen: Columns by quantity.
        reading: How the file is read.
        labels: What the joints are called in the file.
    """
    if chosen["effort"] or "effort" in reading.columns or reading.preset is not None:
        return ()
    used = set(chain.from_iterable(chosen.values()))
    unread = [name for name in names if name not in used]
    if not unread:
        return ()
    listed = unread if len(unread) <= NAMED else [*unread[: NAMED - 1], f"… {unread[-1]}"]
    evidence = f"No column was taken as effort; not read: {', '.join(listed)}."
    sets = _sets(unread, labels, len(chosen["q"]))
    remedy = naming(reading, {"effort": sets[0]}, "if they hold torque or current") if sets else ""
    if len(sets) > 1:
        evidence += f" A column for each joint have {'; '.join(shortened(each) for each in sets)}."
    return (Finding("effort-possible", "info", "effort", evidence, remedy),)


def _sets(names: Sequence[str], labels: Sequence[str], count: int) -> list[tuple[str, ...]]:
    """Columns whose names differ in the joint alone, one for each of `count` channels."""
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
    return [_in_order(members, labels) for members in found.values() if len(members) == count > 0]


def _in_order(members: Mapping[str, str], labels: Sequence[str]) -> tuple[str, ...]:
    if all(each in labels for each in members):
        return tuple(members[label] for label in labels if label in members)
    return tuple(members[each] for each in sorted(members, key=lambda each: (len(each), each)))
