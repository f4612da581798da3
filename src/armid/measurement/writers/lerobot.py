"""Writer of LeRobot data sets (version 3): actions and states in degrees, one episode for each recording."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import MissingExtraError, OutputError

EXTRA = "io"

DATA, INFO = "data/chunk-000/file-000.parquet", "meta/info.json"
"""Paths of the files of a data set."""


@dataclass(frozen=True, eq=False, slots=True)
class Episode:
    """Motion of one episode.

    Attributes:
        command: Commanded positions, shape (N, n) [rad].
        q: Measured positions, shape (N, n) [rad]; `None` for a motion that is still to be recorded.
    """

    command: Array
    q: Array | None = None


def lerobot_files(episodes: Sequence[Episode], joints: Sequence[str], rate: float, robot: str) -> dict[str, bytes]:
    """Files of a data set by relative path: angles in degrees, at equal times.

    Args:
        episodes: Motions; either all or none of them have measured positions.
        joints: Names of the joints, all of them revolute; the motors are named `joint.pos`.
        rate: Frames per second [Hz].
        robot: Name of the arm.

    Raises:
        OutputError: The frame rate is no whole number, which the format needs.
        MissingExtraError: pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingExtraError("pyarrow", "Writing LeRobot data sets", EXTRA) from error
    if abs(rate - round(rate)) > 1e-9:
        raise OutputError(
            f"A LeRobot data set has a whole number of frames per second; found {rate:g} Hz.",
            remedy="choose a whole rate, or another format.",
        )
    lengths = [len(each.command) for each in episodes]
    columns: dict[str, Any] = {}
    if all(each.q is not None for each in episodes):
        columns["observation.state"] = _lists([each.q for each in episodes if each.q is not None])
    columns["action"] = _lists([each.command for each in episodes])
    frames = np.concatenate([np.arange(length) for length in lengths])
    columns |= {
        "timestamp": pa.array((frames / rate).astype(np.float32)),
        "frame_index": pa.array(frames.astype(np.int64)),
        "episode_index": pa.array(np.repeat(np.arange(len(lengths)), lengths).astype(np.int64)),
        "index": pa.array(np.arange(sum(lengths), dtype=np.int64)),
        "task_index": pa.array(np.zeros(sum(lengths), dtype=np.int64)),
    }
    motors = [f"{name}.pos" for name in joints]
    features: dict[str, Any] = {
        name: {"dtype": "float32", "shape": [len(motors)], "names": motors}
        for name in ("observation.state", "action")
        if name in columns
    }
    features["timestamp"] = {"dtype": "float32", "shape": [1], "names": None}
    for name in ("frame_index", "episode_index", "index", "task_index"):
        features[name] = {"dtype": "int64", "shape": [1], "names": None}
    info = {
        "codebase_version": "v3.0",
        "robot_type": robot,
        "fps": round(rate),
        "total_episodes": len(lengths),
        "total_frames": sum(lengths),
        "total_tasks": 1,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }
    buffer = io.BytesIO()
    pq.write_table(pa.table(columns), buffer)
    return {DATA: buffer.getvalue(), INFO: (json.dumps(info, indent=2) + "\n").encode()}


def _lists(values: Sequence[Array]) -> Any:
    """Column of lists of degrees, in single precision as LeRobot stores them."""
    import pyarrow as pa

    table = np.degrees(np.concatenate(list(values))).astype(np.float32)
    return pa.FixedSizeListArray.from_arrays(pa.array(table.ravel()), table.shape[1])
