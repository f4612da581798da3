"""Reader of ROS 1 and ROS 2 bags: joint states by joint name, at the times of their headers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import Finding, MissingExtraError, RecordingError, did_you_mean
from armid.measurement.bag_files import opened
from armid.measurement.held_command import last_command, with_held_command
from armid.measurement.joint_states import COMMAND, FIELDS, JointStates, Publisher, collect, joined, names_of
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot.robot import Robot

EXTRA = "io"

JOINT_STATE = "sensor_msgs/msg/JointState"

CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"

COMMANDED = ("command", "cmd", "desired", "target", "reference", "setpoint", "goal")
"""Words in the names of topics whose values are commanded and not measured."""

POINT = "trajectory_msgs/JointTrajectoryPoint"
DEFINITIONS = {
    "control_msgs/msg/InterfaceValue": "string[] interface_names\nfloat64[] values\n",
    "control_msgs/msg/DynamicJointState": "std_msgs/Header header\nstring[] joint_names\n"
    "control_msgs/InterfaceValue[] interface_values\n",
    CONTROLLER: "std_msgs/Header header\nstring[] joint_names\n"
    + "".join(f"{POINT} {name}\n" for name in ("reference", "feedback", "error", "output"))
    + "string[] multi_dof_joint_names\n"
    + "".join(
        f"trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_{name}\n"
        for name in ("reference", "feedback", "error", "output")
    ),
}
"""Definitions of the messages of ros2_control in ROS 2 Jazzy, for bags that do not contain them."""

Fields = tuple[Sequence[str], dict[str, Any]]


def read(path: Path, log_format: LogFormat, robot: Robot | None = None) -> Recording:
    """Reads joint states by joint name; the times are the header stamps in seconds since the first message.

    Args:
        path: One bag file, which may be compressed (.db3.zstd), or the folder of a bag.
        log_format: Log format. `topic` selects one of several topics; the names in `joints` select one of several
            publishers.
        robot: The arm; its joints select topic and publisher if the log format does not.

    Raises:
        RecordingError: The bag is damaged, no topic or several topics have the joints, or a joint is not published.
        MissingExtraError: rosbags is not installed.
    """
    try:
        from rosbags.highlevel import AnyReader
    except ImportError as error:
        raise MissingExtraError("rosbags", "Reading ROS bags", EXTRA) from error
    with opened(path) as paths:
        store = None if paths[0].suffix == ".bag" else _store()
        with AnyReader(paths, default_typestore=store) as bag:
            if store is not None:
                missing = {
                    name: each for name, each in store.fielddefs.items() if name not in bag.typestore.fielddefs
                }
                bag.typestore.register(missing)
            return _read_open(bag, log_format, robot, path)


def _read_open(bag: Any, log_format: LogFormat, robot: Robot | None, path: Path) -> Recording:
    """Reads the recording from an open bag."""
    names = {joint: name for name, joint in log_format.joint_map.items() if joint}
    wanted = tuple(names.values()) if robot is None else tuple(names.get(j, j) for j in robot.joint_names)
    spare = () if robot is None else tuple(names.get(held.name, held.name) for held in robot.held)
    published: dict[str, list[Publisher]] = {}
    kinds = {connection.topic: str(connection.msgtype) for connection in bag.connections}
    for candidates in _candidates(kinds, log_format, path):
        published |= {topic: _publishers(bag, topic, KINDS[kinds[topic]]) for topic in candidates}
        fitting = [topic for topic in candidates if robot and set(wanted) <= set(names_of(published[topic]))]
        if len(candidates) == 1 and (robot is None or fitting):
            states = joined(published[candidates[0]], wanted, spare, path, candidates[0])
            return _with_command(_recording(states, log_format), states, wanted, bag, kinds, candidates[0])
        measured = [topic for topic in fitting if not _is_commanded(topic)] or fitting
        if len(measured) == 1:
            states = joined(published[measured[0]], wanted, spare, path, measured[0])
            chosen = _topic_finding(measured[0], [t for t in candidates if t not in measured])
            return _with_command(_recording(states, log_format, chosen), states, wanted, bag, kinds, measured[0])
        if len(measured) > 1 or robot is None:
            raise _several(measured or candidates, path)
    if len(published) == 1:  # raises an error that names the missing joints
        topic, publishers = next(iter(published.items()))
        return _recording(joined(publishers, wanted, spare, path, topic), log_format)
    listed = "; ".join(f"{topic}: {', '.join(names_of(each)) or 'no joint'}" for topic, each in published.items())
    raise RecordingError(
        f"{path} has no topic that contains all joints of {robot.name if robot else 'the arm'} "
        f"({', '.join(wanted)}).",
        possible=listed,
        remedy="rename the joints with joints = { name in the recording = robot joint }, lock the joints that were "
        "not recorded, or publish all joints on one topic.",
    )


def _is_commanded(topic: str) -> bool:
    """Checks whether the name of a topic says that its values are commanded."""
    return any(word in topic.lower() for word in COMMANDED)


def _candidates(kinds: Mapping[str, str], log_format: LogFormat, path: Path) -> Iterable[list[str]]:
    """Groups of topics with joint states, one for each message type, or only the topic of the log format."""
    known = sorted(topic for topic, kind in kinds.items() if kind in KINDS)
    if log_format.topic is not None:
        if log_format.topic in known:
            return [[log_format.topic]]
        kind = kinds.get(log_format.topic)
        problem = f"contains {kind}, which is not a type of joint states" if kind else "is not in the bag"
        raise RecordingError(
            f"{path}: topic {log_format.topic} {problem}.",
            possible=", ".join(known) or "none",
            remedy=did_you_mean(log_format.topic, known) or "leave the key `topic` out, or name one of these topics.",
        )
    if not known:
        listed = ", ".join(f"{name} ({kind})" for name, kind in sorted(kinds.items()))
        raise RecordingError(
            f"{path} has no topic with messages of type {JOINT_STATE}.",
            possible=listed or "the bag is empty",
            remedy="record the topic /joint_states.",
        )
    grouped = ([topic for topic in known if kinds[topic] == kind] for kind in KINDS)
    return [topics for topics in grouped if topics]


def _publishers(bag: Any, topic: str, fields_of: Callable[[Any], Fields]) -> list[Publisher]:
    """Reads the messages of a topic and groups them by their joints."""
    found: dict[frozenset[str], Publisher] = {}
    wanted = [connection for connection in bag.connections if connection.topic == topic]
    for connection, received, data in bag.messages(connections=wanted):
        message = bag.deserialize(data, connection.msgtype)
        stamp = message.header.stamp
        names, values = fields_of(message)
        collect(found, names, (stamp.sec * 1_000_000_000 + stamp.nanosec, received), values)
    return list(found.values())


def _recording(states: JointStates, log_format: LogFormat, *findings: Finding) -> Recording:
    if "position" not in states.values:
        raise RecordingError(
            "The joint states have no positions.", remedy="record a topic whose publisher fills in `position`."
        )
    by_rate = not states.clocked and log_format.rate is not None  # more even than times of reception
    noticed = [finding for finding in states.findings if not by_rate or finding.code != "clock-received"]
    return Recording(
        time=None if by_rate else (states.time - states.time[0]) * 1e-9,
        q=states.values["position"],
        dq=states.values.get("velocity"),
        effort=states.values.get("effort"),
        command=states.values.get(COMMAND),
        joint_names=states.names,
        rate=log_format.rate,
        consecutive=log_format.consecutive,
        findings=(*findings, *noticed),
    )


def _with_command(
    recording: Recording, states: JointStates, wanted: Sequence[str], bag: Any, kinds: Mapping[str, str], topic: str
) -> Recording:
    """Adds the command of other topics to a recording that has none, if they command all wanted joints.

    The commands are the references of controllers or, without these, the positions on topics of joint states whose
    name says that they are commanded. Each sample has the last command at or before it.

    Args:
        recording: Recording of the joint states on `topic`.
        states: The joint states.
        wanted: Joints that must have a command; all joints if there are none.
        bag: The open bag.
        kinds: Type of the messages on each topic.
        topic: Topic of the joint states.
    """
    if recording.command is not None or recording.time is None:
        return recording
    others = sorted(other for other in kinds if other != topic)
    controllers = [other for other in others if kinds[other] == CONTROLLER]
    named = [other for other in others if kinds[other] == JOINT_STATE and _is_commanded(other)]
    for topics, key in ((controllers, COMMAND), (named, "position")):
        publishers = [each for other in topics for each in _publishers(bag, other, KINDS[kinds[other]])]
        found = {name: _command_of(name, publishers, key, states) for name in states.names}
        if not topics or any(found[name] is None for name in wanted or states.names):
            continue
        none = np.full(recording.samples, np.nan)
        command = np.column_stack([none if (each := found[name]) is None else each[0] for name in states.names])
        ages = np.column_stack([each[1] for each in found.values() if each is not None])
        before, oldest = ages.min(axis=1) < 0, 1e-9 * float(ages.max(initial=0))
        joined, finding = with_held_command(recording, command, before, oldest, ", ".join(topics))
        return replace(joined, findings=(*joined.findings, finding))
    return recording


def _command_of(
    name: str, publishers: Sequence[Publisher], key: str, states: JointStates
) -> tuple[Array, NDArray[np.int64]] | None:
    """Command of one joint at each sample (N,), and its age (N,) [ns], negative before the first command.

    The result is `None` if no publisher has a value of the joint.

    Args:
        name: Name of the joint.
        publishers: Publishers of commands.
        key: Key of the commanded positions in their messages.
        states: The joint states.
    """
    for publisher in publishers:
        rows = [k for k, row in enumerate(publisher.values[key]) if name in publisher.names and len(row)]
        if not rows:
            continue
        stamped = states.clocked and any(publisher.stamps)
        given = np.array(publisher.stamps if stamped else publisher.received, dtype=np.int64)[rows]
        order = np.argsort(given, kind="stable")
        place = publisher.names.index(name)
        values = np.array([publisher.values[key][rows[k]][place] for k in order], dtype=np.float64)
        last, _ = last_command(states.time, given[order])
        return values[last], states.time - given[order][last]
    return None


def _several(topics: Sequence[str], path: Path) -> RecordingError:
    return RecordingError(
        f"{path} has {len(topics)} topics with joint states.",
        possible=", ".join(topics),
        remedy=f'choose one: topic = "{topics[0]}".',
    )


def _topic_finding(topic: str, others: Sequence[str]) -> Finding:
    """Finding that one of several topics was chosen."""
    return Finding(
        "topic-chosen",
        "info",
        topic,
        f"The topic {topic} was chosen from several topics with joint states; not used: {', '.join(others)}.",
    )


def _joint_state(message: Any) -> Fields:
    return message.name, {name: getattr(message, name) for name in FIELDS}


def _dynamic_joint_state(message: Any) -> Fields:
    """Joint names and values (position, …) of a message with the interfaces of each joint; NaN for missing values."""
    of_joint = [dict(zip(each.interface_names, each.values, strict=True)) for each in message.interface_values]
    return message.joint_names, {
        name: np.array([float(each.get(name, np.nan)) for each in of_joint]) for name in FIELDS
    }


def _controller_state(message: Any) -> Fields:
    """Joint names, measured values and commanded positions in the message of a controller.

    The fields are `feedback` and `reference`, in older versions `actual` and `desired`.
    """
    point = getattr(message, "feedback", None) or message.actual
    points = [getattr(message, name, None) for name in ("reference", "desired")]
    command = next((each.positions for each in points if each is not None and len(each.positions)), ())
    values = {"position": point.positions, "velocity": point.velocities, "effort": point.effort, COMMAND: command}
    return message.joint_names, values


KINDS: Mapping[str, Callable[[Any], Fields]] = {
    JOINT_STATE: _joint_state,
    "control_msgs/msg/DynamicJointState": _dynamic_joint_state,
    CONTROLLER: _controller_state,
}
"""For each message type with joint states, in order of preference: function that returns joint names and values."""


@cache
def _store() -> Any:
    """Message definitions for bags that do not contain them, such as those of older ROS distributions."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store
