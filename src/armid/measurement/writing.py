"""Writers of recordings, in formats and with column names that `load_recording` can read."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from armid.atomic_file import replace_file
from armid.checked_array import Array
from armid.errors import MissingExtraError, OutputError
from armid.measurement.readers.bag import CONTROLLER, DEFINITIONS, JOINT_STATE
from armid.measurement.recording import Recording
from armid.output.scratch import scratch_folder

EXTRA = "io"

PATTERNS = (("q", "q{}"), ("dq", "dq{}"), ("ddq", "ddq{}"), ("effort", "tau{}"), ("command", "command{}"))

EPOCH = 1_600_000_000
"""Time stamp in a bag of a sample at time 0 [s]; it is not zero, because a stamp of zero means that there is no
clock."""

FIRST_DEFINITION = "std_msgs/Header header\nstring[] joint_names\n" + "".join(
    f"trajectory_msgs/JointTrajectoryPoint {name}\n" for name in ("desired", "actual", "error")
)
"""Definition of the message of a controller in ROS 1."""

FLOAT = "%.17g"
"""Format of numbers in text tables, with full precision, so that every bit is reproduced."""


def save_recording(recording: Recording, path: Path | str) -> Path:
    """Writes a recording in the format of the suffix; the file is written completely or not at all.

    Args:
        recording: The recording; its mask is not written.
        path: Path of the file; its suffix must be a key of `WRITERS`.

    Raises:
        OutputError: The suffix is unknown, or the file cannot be written.
        MissingExtraError: The format needs a package that is not installed.
    """
    path = Path(path)
    if path.suffix.lower() not in WRITERS:
        raise OutputError(
            f"No format is known for the suffix of {path}, so the recording cannot be written.",
            possible=", ".join(WRITERS),
            remedy="give the file one of these suffixes.",
        )
    return replace_file(path, recording_bytes(recording, path.suffix.lower()))


def recording_bytes(recording: Recording, suffix: str) -> bytes:
    """Content of a file with a recording in the format of a suffix, a key of `WRITERS`.

    Raises:
        MissingExtraError: The format needs a package that is not installed.
    """
    return WRITERS[suffix](recording)


def _columns(recording: Recording) -> dict[str, Array]:
    """Columns of a recording by name: the time, and one column for each channel of each quantity."""
    columns = {} if recording.time is None else {"t": recording.time}
    for name, pattern in PATTERNS:
        values = getattr(recording, name)
        if values is not None:
            columns |= {pattern.format(j + 1): values[:, j] for j in range(recording.n)}
    return columns


def _matrices(recording: Recording) -> dict[str, Array]:
    """Matrices of a recording, by the usual names of the quantities in MATLAB."""
    names = {"t": recording.time, "q": recording.q, "dq": recording.dq, "ddq": recording.ddq, "tau": recording.effort}
    names["command"] = recording.command
    return {name: values for name, values in names.items() if values is not None}


def _csv(recording: Recording) -> bytes:
    columns, text = _columns(recording), io.StringIO()
    table = np.column_stack(list(columns.values()))
    np.savetxt(text, table, delimiter=",", header=",".join(columns), comments="", fmt=FLOAT)
    return text.getvalue().encode()


def _npz(recording: Recording) -> bytes:
    buffer = io.BytesIO()
    names = {"joint_names": np.array(recording.joint_names)} if recording.joint_names else {}
    np.savez(buffer, **_matrices(recording), **names)  # pyright: ignore[reportArgumentType]
    return buffer.getvalue()


def _mat(recording: Recording) -> bytes:
    from scipy.io import savemat

    buffer = io.BytesIO()
    names = np.array(recording.joint_names, dtype=object)
    content: dict[str, object] = dict(_matrices(recording))
    savemat(buffer, content | ({"joint_names": names} if recording.joint_names else {}))
    return buffer.getvalue()


def _parquet(recording: Recording) -> bytes:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingExtraError("pyarrow", "Writing Parquet", EXTRA) from error
    buffer = io.BytesIO()
    pq.write_table(pa.table(_columns(recording)), buffer)
    return buffer.getvalue()


def _bag(recording: Recording, suffix: str) -> bytes:
    """Bag of joint states: `.bag` of ROS 1, `.db3` or `.mcap` of ROS 2.

    The messages are `sensor_msgs/JointState` on `/joint_states` or, if there is a command,
    `control_msgs/JointTrajectoryControllerState` on `/controller_state`, whose definition is written into the bag.
    """
    try:
        from rosbags.rosbag1 import Writer as FirstWriter
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as error:
        raise MissingExtraError("rosbags", "Writing ROS bags", EXTRA) from error
    first = suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.ROS2_JAZZY)
    serialize = store.serialize_ros1 if first else store.serialize_cdr
    topic, kind = ("/joint_states", JOINT_STATE) if recording.command is None else ("/controller_state", CONTROLLER)
    if kind == CONTROLLER:
        store.register(get_types_from_msg(FIRST_DEFINITION if first else DEFINITIONS[kind], kind))
    with scratch_folder() as folder:
        path = folder / f"bag{suffix if first else ''}"
        if first:
            made = FirstWriter(path)
        else:
            plugin = StoragePlugin.MCAP if suffix == ".mcap" else StoragePlugin.SQLITE3
            made = Writer(path, version=9, storage_plugin=plugin)
        with made as writer:
            connection = writer.add_connection(topic, kind, typestore=store)
            for at, message in _messages(recording, store.types, first):
                writer.write(connection, at, bytes(serialize(message, kind)))
        return (path if first else next(path.glob(f"*{suffix}"))).read_bytes()


def _messages(recording: Recording, types: Mapping[str, Any], first: bool) -> Iterator[tuple[int, Any]]:
    """Yields time of reception [ns] and message for each row of a recording.

    Only messages of ROS 1 (`first`) are numbered in their headers.
    """
    header, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    empty = np.zeros((recording.samples, 0))
    velocity = empty if recording.dq is None else recording.dq
    effort = empty if recording.effort is None else recording.effort
    clock = np.arange(recording.samples) / (recording.rate or 1.0) if recording.time is None else recording.time
    received = EPOCH * 10**9 + np.round((clock - min(0.0, clock.min(initial=0.0))) * 1e9).astype(np.int64)
    names = list(recording.channels)
    for k, at in enumerate(received.tolist()):
        stamped = 0 if recording.time is None else at
        counted = {"seq": k} if first else {}
        head = header(stamp=stamp(sec=stamped // 10**9, nanosec=stamped % 10**9), frame_id="", **counted)
        values = recording.q[k], velocity[k], effort[k]
        if recording.command is None:
            state = types[JOINT_STATE](head, names, *values)
        else:
            state = _controller_state(types, head, names, recording.command[k], values, first)
        yield at, state


def _controller_state(
    types: Mapping[str, Any],
    header: Any,
    names: list[str],
    command: Array,
    measured: tuple[Array, Array, Array],
    first: bool,
) -> Any:
    """Message of a controller with a commanded position and measured position, velocity and effort."""
    at_once = types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
    none = np.zeros(0)

    def point(position: Array, velocity: Array, effort: Array) -> Any:
        return types["trajectory_msgs/msg/JointTrajectoryPoint"](position, velocity, none, effort, at_once)

    points = [point(command, none, none), point(*measured), point(none, none, none)]
    if first:
        return types[CONTROLLER](header, names, *points)
    other = types["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"]([], [], [], at_once)
    return types[CONTROLLER](header, names, *points, points[-1], [], other, other, other, other)


WRITERS: Mapping[str, Callable[[Recording], bytes]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".npz": _npz,
    ".mat": _mat,
    ".bag": partial(_bag, suffix=".bag"),
    ".db3": partial(_bag, suffix=".db3"),
    ".mcap": partial(_bag, suffix=".mcap"),
}
"""For each suffix of a file that can be written, the function that creates the content of the file."""
