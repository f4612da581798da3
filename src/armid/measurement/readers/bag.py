"""ROS bags: ROS 1 `.bag`, ROS 2 `.db3` and `.mcap`, with `sensor_msgs/JointState` messages."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from armid.errors import MissingExtraError, RecordingError
from armid.measurement.reading import Reading
from armid.measurement.recording import Recording
from armid.values import Array

__all__ = ["EXTRA", "SUFFIXES", "read"]

SUFFIXES: tuple[str, ...] = (".bag", ".db3", ".mcap")
EXTRA = "io"

JOINT_STATE = "sensor_msgs/msg/JointState"


@dataclass(slots=True)
class _Publisher:
    """Messages that carry the same joints, in whatever order."""

    names: tuple[str, ...]
    stamps: list[int] = field(default_factory=list[int])
    position: list[Any] = field(default_factory=list[Any])
    velocity: list[Any] = field(default_factory=list[Any])
    effort: list[Any] = field(default_factory=list[Any])


def read(path: Path, reading: Reading) -> Recording:
    """Read joint states, matched by name. Times are the header stamps, in seconds since the first one.

    Args:
        path: One bag file.
        reading: `topic` chooses among several topics; the names in `joints` choose among several publishers.

    Raises:
        RecordingError: A damaged bag, no or several topics with joint states, or several publishers on the topic.
        MissingExtraError: rosbags is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingExtraError("rosbags", "Reading ROS bags", EXTRA) from error
    # ROS 2 bags of older distributions do not carry message definitions; JointState is the same in all of them.
    store = None if path.suffix == ".bag" else get_typestore(Stores.ROS2_JAZZY)
    publishers: dict[frozenset[str], _Publisher] = {}
    try:
        with AnyReader([path], default_typestore=store) as bag:
            topic = _topic([(c.topic, c.msgtype) for c in bag.connections], reading, path)
            wanted = [c for c in bag.connections if c.topic == topic]
            for connection, _, data in bag.messages(connections=wanted):
                _collect(publishers, bag.deserialize(data, connection.msgtype))
    except _faults() as error:
        raise RecordingError(
            f"{path} cannot be read as a bag ({error}).",
            remedy="copy the file again, or repair it (rosbag reindex, ros2 bag reindex).",
        ) from error
    return _recording(_chosen(publishers, reading, path, topic), reading, path)


def _faults() -> tuple[type[Exception], ...]:
    """What rosbags lets through from a damaged bag: its own errors, those of SQLite, and those of plain Python."""
    from rosbags import highlevel, rosbag1, rosbag2, serde, typesys

    own = (highlevel.AnyReaderError, rosbag1.ReaderError, rosbag2.ReaderError, serde.SerdeError, typesys.TypesysError)
    plain = (
        OSError,
        ValueError,
        LookupError,
        ArithmeticError,
        TypeError,
        AttributeError,
        AssertionError,
        MemoryError,
    )
    try:
        import apsw
    except ImportError:  # older versions of rosbags read `.db3` with sqlite3
        return (*own, *plain, struct.error, sqlite3.Error)
    return (*own, *plain, struct.error, apsw.Error)


def _topic(connections: Iterable[tuple[str, str]], reading: Reading, path: Path) -> str:
    """The topic to read."""
    topics = dict(connections)
    states = sorted(name for name, kind in topics.items() if kind == JOINT_STATE)
    if reading.topic is not None:
        if reading.topic in states:
            return reading.topic
        kind = topics.get(reading.topic)
        problem = f"holds {kind}, not joint states" if kind else "is not in the bag"
        raise RecordingError(f"{path}: topic {reading.topic} {problem}.", possible=", ".join(states) or "none")
    if len(states) == 1:
        return states[0]
    if not states:
        listed = ", ".join(f"{name} ({kind})" for name, kind in sorted(topics.items()))
        raise RecordingError(f"{path} has no topic of {JOINT_STATE}.", possible=listed or "the bag is empty")
    raise RecordingError(
        f"{path} has {len(states)} topics with joint states.",
        possible=", ".join(states),
        remedy=f'choose one: topic = "{states[0]}".',
    )


def _collect(publishers: dict[frozenset[str], _Publisher], message: Any) -> None:
    """Add one message to those with the same joints, its fields put in their order."""
    names = tuple(message.name)
    publisher = publishers.get(frozenset(names))
    if publisher is None:
        publisher = publishers[frozenset(names)] = _Publisher(names)
    order = None if names == publisher.names else [names.index(name) for name in publisher.names]
    stamp = message.header.stamp
    publisher.stamps.append(stamp.sec * 1_000_000_000 + stamp.nanosec)
    for values, target in (
        (message.position, publisher.position),
        (message.velocity, publisher.velocity),
        (message.effort, publisher.effort),
    ):
        target.append(values[order] if order is not None and len(values) == len(names) else values)


def _chosen(publishers: dict[frozenset[str], _Publisher], reading: Reading, path: Path, topic: str) -> _Publisher:
    """The publisher whose joints are meant."""
    filled = {names: p for names, p in publishers.items() if names}
    asked = {name for name, joint in reading.joint_map.items() if joint}
    fitting = [p for names, p in filled.items() if asked and asked <= names]
    if len(fitting) == 1:
        return fitting[0]
    if len(filled) == 1:
        return next(iter(filled.values()))
    if not filled:
        raise RecordingError(
            f"{path}: no message on {topic} names a joint.", remedy="record a topic whose publisher fills in `name`."
        )
    listed = "; ".join(f"{', '.join(p.names)} ({len(p.stamps)} messages)" for p in filled.values())
    raise RecordingError(
        f"{path}: {len(filled)} publishers share {topic}, each with other joints: {listed}.",
        remedy="name the joints of one in joints = { file name = robot joint }; if the arm's own joints are "
        "spread over several, record them on one topic.",
    )


def _recording(publisher: _Publisher, reading: Reading, path: Path) -> Recording:
    """Stack the messages."""
    stamps = np.array(publisher.stamps, dtype=np.int64)
    # A publisher that leaves the header empty has no clock; the time of reception is not taken for one.
    time = (stamps - stamps[0]) * 1e-9 if stamps.any() else None
    q = _stack(publisher.position, publisher, "position", path)
    if q is None:
        raise RecordingError(
            f"{path}: the joint states carry no positions.",
            remedy="record a topic whose publisher fills in `position`.",
        )
    return Recording(
        time=time,
        q=q,
        dq=_stack(publisher.velocity, publisher, "velocity", path),
        effort=_stack(publisher.effort, publisher, "effort", path),
        joint_names=publisher.names,
        rate=reading.rate,
        consecutive=reading.consecutive,
        source=str(path),
    )


def _stack(rows: Sequence[Any], publisher: _Publisher, name: str, path: Path) -> Array | None:
    """One field of all messages, shape (N, n); `None` where it is empty throughout."""
    n = len(publisher.names)
    lengths = {len(row) for row in rows}
    if lengths == {0}:
        return None
    if lengths == {n}:
        return np.array(rows, dtype=np.float64)
    first = next(i for i, row in enumerate(rows) if len(row) != n)
    raise RecordingError(
        f"{path}: message {first} has {len(rows[first])} values of {name} for {n} joints.",
        remedy="cut that part of the bag off; a field must be there in all messages or in none.",
    )
