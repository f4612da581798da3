"""Joint states of one or several publishers on a topic, merged by joint name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding, RecordingError
from armid.maths.median import median
from armid.measurement.columns.joint_assignment import LISTED
from armid.measurement.columns.joint_name_comparison import comparison

FIELDS = ("position", "velocity", "effort")
"""Measured values of joints in messages."""

COMMAND = "command"
"""Key of the commanded positions, which only the messages of controllers have."""


@dataclass(slots=True)
class Publisher:
    """Messages with the same set of joints, which are assumed to come from one publisher.

    The order of the joints may differ between messages.

    Attributes:
        names: Names of the joints, in the order of the first message.
        stamps: Time in the header of each message [ns].
        received: Time at which the bag received each message [ns].
        values: For each key (position, velocity, effort, command), the values in each message, in the order of
            `names`.
    """

    names: tuple[str, ...]
    stamps: list[int] = field(default_factory=list[int])
    received: list[int] = field(default_factory=list[int])
    values: dict[str, list[Any]] = field(default_factory=lambda: {name: [] for name in (*FIELDS, COMMAND)})


@dataclass(frozen=True, eq=False, slots=True)
class JointStates:
    """States of n joints on one clock.

    Attributes:
        names: Names of the joints.
        time: Times of the states, from the stamps in the headers or from the reception, shape (N,) [ns].
        values: Position, velocity, effort and command, shape (N, n) each, if they were published.
        clocked: True if `time` contains the stamps in the headers, false if it contains times of reception.
        findings: Findings about the messages.
    """

    names: tuple[str, ...]
    time: NDArray[np.int64]
    values: Mapping[str, Array]
    clocked: bool = True
    findings: tuple[Finding, ...] = ()


def collect(
    publishers: dict[frozenset[str], Publisher], names: Sequence[str], at: tuple[int, int], values: Mapping[str, Any]
) -> None:
    """Adds a message to the messages with the same joints, with its values in the order of their joints.

    Args:
        publishers: Earlier messages, by the set of joints that they contain; changed in place.
        names: Joints of the message.
        at: Time stamp in the header and time of reception [ns].
        values: Values in the message, by key (position, velocity, effort and, if it is there, command).
    """
    names = tuple(names)
    publisher = publishers.get(frozenset(names))
    if publisher is None:
        publisher = publishers[frozenset(names)] = Publisher(names)
    order = None if names == publisher.names else [names.index(name) for name in publisher.names]
    publisher.stamps.append(at[0])
    publisher.received.append(at[1])
    for name, target in publisher.values.items():
        each = values.get(name, ())
        target.append(each[order] if order is not None and len(each) == len(names) else each)


def names_of(publishers: Iterable[Publisher]) -> tuple[str, ...]:
    """Names of the joints of all given publishers, without duplicates."""
    return tuple(dict.fromkeys(name for each in publishers for name in each.names))


def joined(
    publishers: Sequence[Publisher], wanted: Sequence[str], spare: Sequence[str], path: Path, topic: str
) -> JointStates:
    """Joint states of the wanted joints, at the times of the publisher with most of these joints.

    Args:
        publishers: Publishers of one topic.
        wanted: Joints that must be published. If no joint is wanted, there must be exactly one publisher.
        spare: Joints that are added if they are published. If another publisher has them, only their positions are
            read.
        path: The bag, for messages.
        topic: The topic, for messages.

    Raises:
        RecordingError: There are no joints, a wanted joint is missing, or there are several publishers and no joint
            is wanted.
    """
    filled = [each for each in publishers if each.names]
    if not filled:
        raise RecordingError(
            f"{path}: no message on {topic} names a joint.", remedy="record a topic whose publisher fills in `name`."
        )
    chosen = _chosen(filled, wanted, path, topic)
    clocked = all(any(each.stamps) for each in chosen)
    states = [_states(each, path, clocked=clocked) for each in chosen]
    first, *others = states
    findings = [] if clocked else [_received(states)]
    if others:
        first, merged = _merged(first, others, wanted)
        findings.append(merged)
    rest = [each for each in filled if each not in chosen]
    first = _with_spare(first, [_states(each, path, clocked=clocked) for each in rest], spare)
    unused = [name for name in names_of(rest) if name not in first.names]
    if unused:
        more = f" and {len(unused) - LISTED} more" if len(unused) > LISTED else ""
        left_out = f"Joints of other publishers on the topic are left out: {', '.join(unused[:LISTED])}{more}."
        findings.append(Finding("joints-extra", "info", "", left_out))
    return JointStates(first.names, first.time, first.values, clocked, tuple(findings))


def _chosen(filled: Sequence[Publisher], wanted: Sequence[str], path: Path, topic: str) -> list[Publisher]:
    """Chooses the publishers that have the wanted joints; the publisher of most of these joints comes first."""
    if not wanted:
        if len(filled) == 1:
            return list(filled)
        listed = "; ".join(f"{', '.join(each.names)} ({len(each.stamps)} messages)" for each in filled)
        raise RecordingError(
            f"{path}: {len(filled)} publishers on {topic} publish different joints: {listed}.",
            remedy="name the joints of one publisher in joints = { name in the recording = robot joint }, or read "
            "the bag together with a robot.",
        )
    needed = set(wanted)
    ranked = sorted(filled, key=lambda each: (-len(needed & set(each.names)), -len(each.stamps)))
    chosen: list[Publisher] = []
    for each in ranked:
        if needed & set(each.names):
            chosen.append(each)
            needed -= set(each.names)
    if needed:
        compared = "" if chosen else f" {comparison(names_of(filled), wanted, 'the description')}"
        raise RecordingError(
            f"{path}: no publisher on {topic} has the joints "
            f"{', '.join(name for name in wanted if name in needed)}.{compared}",
            possible=f"joints on this topic: {', '.join(names_of(filled))}",
            remedy=("" if chosen else "give the description of the recorded arm; or ")
            + "rename the joints with joints = { name in the recording = robot joint }, and lock the joints "
            "that were not recorded.",
        )
    return chosen


def _states(publisher: Publisher, path: Path, *, clocked: bool) -> JointStates:
    """Converts the messages of one publisher to arrays."""
    time = np.array(publisher.stamps if clocked else publisher.received, dtype=np.int64)
    stacked = {name: _stack(publisher.values[name], publisher.names, name, path) for name in (*FIELDS, COMMAND)}
    return JointStates(publisher.names, time, {name: each for name, each in stacked.items() if each is not None})


def _stack(rows: Sequence[Any], names: tuple[str, ...], name: str, path: Path) -> Array | None:
    """Values of one field in all messages, shape (N, n); `None` if the field is empty in all messages."""
    n = len(names)
    lengths = {len(row) for row in rows}
    if name == COMMAND and lengths == {0, n}:  # a controller has no reference before its first goal
        rows, lengths = [row if len(row) else np.full(n, np.nan) for row in rows], {n}
    if lengths == {0}:
        return None
    if lengths == {n}:
        stacked = np.array(rows, dtype=np.float64)
        return None if np.isnan(stacked).all() else stacked
    first = next(i for i, row in enumerate(rows) if len(row) != n)
    raise RecordingError(
        f"{path}: message {first} has {len(rows[first])} values of {name} for {n} joints.",
        remedy="remove this part of the bag; a field must have values for all joints in every message, or in no "
        "message.",
    )


def _received(states: Sequence[JointStates]) -> Finding:
    """Finding that messages have no time stamps, so that the times of reception are used as the clock."""
    step = np.diff(states[0].time) * 1e-6
    typical = float(median(step)) if step.size else 0.0
    spread = (
        f"; the steps are {step.min():.3g} to {step.max():.3g} ms, the median is {typical:.3g} ms"
        if step.size
        else ""
    )
    return Finding(
        "clock-received",
        "warning",
        "time",
        f"No message has a time stamp, so the times of reception are used{spread}.",
        "record again with a driver that fills in header.stamp, because times of reception contain the "
        "jitter of the network.",
    )


def _merged(first: JointStates, others: Sequence[JointStates], wanted: Sequence[str]) -> tuple[JointStates, Finding]:
    """Merges the wanted joints of several publishers, at the times of the first one within the common interval."""
    begin = max(each.time[0] for each in (first, *others))
    end = min(each.time[-1] for each in (first, *others))
    inside = (first.time >= begin) & (first.time <= end)
    if not inside.any():
        raise RecordingError(
            "The publishers of the arm's joints have no common interval of time.",
            remedy="record the messages of all publishers during the same motion.",
        )
    time, names = first.time[inside], list(first.names)
    values = {name: [each[inside]] for name, each in first.values.items()}
    farthest = 0.0
    for other in others:
        take = [k for k, name in enumerate(other.names) if name in wanted and name not in names]
        names += [other.names[k] for k in take]
        farthest = max(farthest, _farthest(time, other.time))
        for name in list(values):
            if name not in other.values:
                del values[name]  # what one of them does not publish is not there
            else:
                values[name].append(_at(time, other.time, other.values[name][:, take]))
    listed = "; ".join(f"{', '.join(each.names)} ({len(each.time)} messages)" for each in (first, *others))
    how = (
        "at the same times"
        if not farthest
        else f"interpolated at the times of the first publisher, over at most {farthest:.3g} ms"
    )
    finding = Finding(
        "joints-merged",
        "warning" if farthest else "info",
        "",
        f"The joints of several publishers were merged by name, {how}: {listed}.",
    )
    together = {name: np.hstack(each) for name, each in values.items()}
    return JointStates(tuple(names), time, together), finding


def _with_spare(first: JointStates, rest: Sequence[JointStates], spare: Sequence[str]) -> JointStates:
    """Adds the positions of the joints `spare` to the states `first`, if other publishers have them."""
    names, values = list(first.names), dict(first.values)
    for other in rest:
        take = [k for k, name in enumerate(other.names) if name in spare and name not in names]
        if not take or "position" not in other.values:
            continue
        names += [other.names[k] for k in take]
        there = _at(first.time, other.time, other.values["position"][:, take])
        for name in values:
            added = there if name == "position" else np.full_like(there, np.nan)
            values[name] = np.hstack([values[name], added])
    return JointStates(tuple(names), first.time, values)


def _at(time: NDArray[np.int64], known: NDArray[np.int64], values: Array) -> Array:
    """Interpolates values (M, n), given at the times `known` (M,), linearly at the times `time` (N,) [ns]."""
    if len(time) == len(known) and (time == known).all():
        return values
    # Relative to the first, or doubles would not hold the nanoseconds of an epoch.
    x, xp = (time - known[0]).astype(np.float64), (known - known[0]).astype(np.float64)
    return np.column_stack([np.interp(x, xp, column) for column in values.T])


def _farthest(time: NDArray[np.int64], known: NDArray[np.int64]) -> float:
    """Largest distance [ms] between one of the times `time` [ns] and the nearest of the times `known` [ns]."""
    after = np.clip(np.searchsorted(known, time), 1, max(len(known) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(known) - 1)
    return float(np.minimum(np.abs(known[after] - time), np.abs(time - known[before])).max(initial=0)) * 1e-6
