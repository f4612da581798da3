"""Reader of LeRobot data sets: one episode of a folder with `meta/info.json` and Parquet files in `data`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import MissingExtraError, RecordingError
from armid.input_boundary import read_json, within, within_unpacked
from armid.measurement.log_format import LogFormat
from armid.measurement.motor_calibration import in_angles
from armid.measurement.readers.parquet import numbers
from armid.measurement.recording import Recording
from armid.measurement.recording_paths import split_episode
from armid.robot.robot import Robot

EXTRA = "io"

INFO = Path("meta") / "info.json"

EPISODE, TIME = "episode_index", "timestamp"

COLUMNS = {"q": "observation.state", "command": "action"}
"""Columns with one list of numbers for each sample."""

POSITION = ".pos"
"""End of the name of a motor in the list of features."""

LISTED = 12
"""Largest number of episodes that are listed in a message."""


def read(path: Path, log_format: LogFormat, robot: Robot | None = None) -> Recording:
    """Reads one episode, `folder#3`; the number may be left out if there is only one.

    `observation.state` is the position and `action` the command, unless the log format names other columns, also for
    `dq` and `effort`. The names of the joints are those of the motors. The times are those of the data set, which are
    multiples of the frame time and not measured.

    Raises:
        RecordingError: The folder is damaged, the episode does not exist, or positions are normalised and no
            calibration is given.
        MissingExtraError: pyarrow is not installed.
    """
    folder, episode = split_episode(path)
    info = read_json(folder / INFO, "the description of a LeRobot data set", RecordingError)
    features: Any = info.get("features")
    if not isinstance(features, Mapping):
        raise RecordingError(f"{folder / INFO} has no table `features`.", remedy="copy the data set again.")
    wanted = {key: name for key, name in COLUMNS.items() if key == "q" or name in features}
    wanted |= {
        key: names[0]
        for key, names in log_format.columns.items()
        if key in ("q", "dq", "effort", "command") and names
    }
    wanted = {key: name for key, name in wanted.items() if log_format.columns.get(key) != ()}
    absent = [name for name in wanted.values() if name not in features]
    if absent:
        raise RecordingError(
            f"{folder} has no feature {absent[0]!r}.",
            possible=", ".join(features),
            remedy="name the features of q, dq, effort and command under `columns`.",
        )
    values = _episode(folder, episode, (TIME, *wanted.values()))
    found = {key: np.atleast_2d(values[name].T).T for key, name in wanted.items()}
    names = {key: _motors(features[name], found[key].shape[1]) for key, name in wanted.items()}
    for key in [key for key in found if key != "q"]:
        found[key] = _as_positions(found[key], names[key], names["q"], wanted[key], folder)
    converted = in_angles(found, names["q"], log_format, robot, folder)
    return Recording(
        time=values[TIME].reshape(-1),
        q=converted.values["q"],
        dq=converted.values.get("dq"),
        effort=converted.values.get("effort"),
        command=converted.values.get("command"),
        joint_names=names["q"],
        rate=log_format.rate,
        consecutive=log_format.consecutive,
        columns={key: (name,) for key, name in wanted.items()},
        guessed=converted.guessed,
        findings=converted.findings,
    )


def _episode(folder: Path, episode: int | None, names: Sequence[str]) -> dict[str, Array]:
    """Columns of one episode by name; episodes may continue in the next file.

    Raises:
        RecordingError: There are no data, or the episode does not exist or is not given.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingExtraError("pyarrow", "Reading LeRobot data sets", EXTRA) from error
    files = sorted((folder / "data").glob("*/*.parquet"))
    indices = {file: np.asarray(pq.read_table(file, columns=[EPISODE])[EPISODE].to_numpy()) for file in files}
    present = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *indices.values()])).tolist()
    if episode is None and len(present) == 1:
        (episode,) = present
    if episode not in present:
        more = f", … {present[-1]}" if len(present) > LISTED else ""
        problem = f"has {len(present)} episodes" if episode is None else f"has no episode {episode}"
        raise RecordingError(
            f"{folder} {problem}.",
            possible="episodes " + ", ".join(map(str, present[:LISTED])) + more if present else "none",
            remedy=f'name one episode for each recording, for instance path = "{folder.name}#{present[0]}".'
            if present
            else "copy the data set again, with the Parquet files in its folder `data`.",
        )
    inside = {file: each == episode for file, each in indices.items() if (each == episode).any()}
    within("samples", int(sum(mask.sum() for mask in inside.values())), str(folder), RecordingError)
    within_unpacked(sum(8.0 * len(names) * len(mask) for mask in inside.values()), folder, RecordingError)
    tables = [pq.read_table(file, columns=list(names)).filter(pa.array(mask)) for file, mask in inside.items()]
    return {name: np.concatenate([numbers(each[name], name, folder) for each in tables]) for name in names}


def _motors(feature: Any, count: int) -> tuple[str, ...]:
    """Names of the motors of a feature, without the ending `.pos`; empty if it does not name all motors."""
    names: Any = feature.get("names") if isinstance(feature, Mapping) else None
    if isinstance(names, Mapping):  # older data sets: {"motors": [...]}
        names = next(iter(names.values()), None)
    if not isinstance(names, list) or len(names) != count or not all(isinstance(name, str) for name in names):
        return ()
    plain = tuple(name.removesuffix(POSITION) for name in names)
    return plain if len(set(plain)) == count else ()


def _as_positions(values: Array, names: tuple[str, ...], motors: tuple[str, ...], column: str, folder: Path) -> Array:
    """Values of a feature in the order of the motors of the positions; NaN for motors that the feature lacks."""
    if names == motors:
        return values
    if not names or not motors:
        raise RecordingError(
            f"{folder}: {column} has {values.shape[1]} values, and it is not clear to which motors they belong.",
            remedy="give the names of the motors in meta/info.json, or leave it out with an empty name: columns = { "
            'command = "" }.',
        )
    none = np.full(len(values), np.nan)
    return np.column_stack([values[:, names.index(name)] if name in names else none for name in motors])
