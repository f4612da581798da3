"""Data sets of LeRobot, written here from the ticks of encoders, and read back as angles."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from armid.errors import RecordingError
from armid.hashes import sha256_of_file
from armid.measurement.convention_conversion import read_recording
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording
from armid.measurement.recording_paths import recording_exists, sha256_of_recording
from armid.robot.robot import Frame, Held, Joint, Link, Robot

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

MOTORS = ("shoulder_pan", "elbow_flex", "gripper")
RANGES = {"shoulder_pan": (900, 3100, 0), "elbow_flex": (850, 3080, 1), "gripper": (2030, 3500, 0)}
"""Smallest and largest tick and drive mode of each motor."""

TURN = 4096
FPS = 30
LENGTHS = (40, 55, 25)
"""Frames of the episodes; the second one continues in the next file."""

SINGLE = 2e-6
"""Relative rounding of single precision, in which the values are stored, over a range of 200 normalised units."""

rng = np.random.default_rng(2)
LOW, HIGH = (np.array([RANGES[name][k] for name in MOTORS]) for k in (0, 1))
TICKS = rng.integers(LOW, HIGH + 1, size=(sum(LENGTHS), 3))
ASKED = rng.integers(LOW, HIGH + 1, size=(sum(LENGTHS), 3))
EPISODES = np.repeat(np.arange(len(LENGTHS)), LENGTHS)
FRAMES = np.concatenate([np.arange(length) for length in LENGTHS])


def angles(ticks: NDArray[Any]) -> NDArray[np.float64]:
    """Angle of the encoder about the middle of the range [rad]."""
    return (ticks - (LOW + HIGH) / 2) * 2 * np.pi / TURN


def shares(ticks: NDArray[Any]) -> NDArray[np.float64]:
    """From 0 to 1 over the range, turned by the drive mode."""
    share = (ticks - LOW) / (HIGH - LOW)
    return np.where([RANGES[name][2] == 1 for name in MOTORS], 1.0 - share, share)


def normalised(ticks: NDArray[Any]) -> NDArray[np.float64]:
    """From -100 to 100, the gripper from 0 to 100."""
    return np.column_stack([200.0 * shares(ticks)[:, :2] - 100.0, 100.0 * shares(ticks)[:, 2]])


def in_degrees(ticks: NDArray[Any]) -> NDArray[np.float64]:
    """Degrees about the middle, the gripper from 0 to 100."""
    return np.column_stack([np.degrees(angles(ticks))[:, :2], 100.0 * shares(ticks)[:, 2]])


def write(
    folder: Path,
    state: NDArray[np.float64],
    action: NDArray[np.float64],
    names: Any = tuple(f"{name}.pos" for name in MOTORS),
    order: tuple[int, ...] = (0, 1, 2),
) -> Path:
    """A data set of two files; the names of the actions are those of the states in another order."""
    action_names = [names[k] for k in order] if isinstance(names, tuple) else names
    vector = {"dtype": "float32", "shape": [3]}
    features = {
        "observation.state": {**vector, "names": list(names) if isinstance(names, tuple) else names},
        "action": {**vector, "names": action_names},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    }
    (folder / "meta").mkdir(parents=True)
    info = {"codebase_version": "v3.0", "robot_type": "so_follower", "fps": FPS, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    columns = {
        "observation.state": list(state.astype(np.float32)),
        "action": list(action[:, list(order)].astype(np.float32)),
        "timestamp": (FRAMES / FPS).astype(np.float32),
        "episode_index": EPISODES,
    }
    (folder / "data" / "chunk-000").mkdir(parents=True)
    for k, rows in enumerate((slice(0, 70), slice(70, None))):
        table = pa.table({name: values[rows] for name, values in columns.items()})
        pq.write_table(table, folder / "data" / "chunk-000" / f"file-{k:03d}.parquet")
    return folder


def write_calibration(path: Path, without: str = "") -> Path:
    motors = {
        name: {"id": k + 1, "drive_mode": mode, "homing_offset": 17, "range_min": low, "range_max": high}
        for k, (name, (low, high, mode)) in enumerate(RANGES.items())
        if name != without
    }
    path.write_text(json.dumps(motors))
    return path


def arm(names: tuple[str, ...] = MOTORS, held: tuple[Held, ...] = ()) -> Robot:
    axis, limits = np.array([0.0, 0.0, 1.0]), np.array([-np.inf, np.inf])
    joints = [Joint(name, "revolute", k - 1, axis, np.eye(4), limits) for k, name in enumerate(names)]
    links, tip = tuple(Link(name) for name in names), Frame("tip", len(names) - 1, np.eye(4))
    return Robot("arm", tuple(joints), links, tip, held=held)


def assert_episode(found: Recording, k: int, motors: int = 3) -> None:
    rows = EPISODES == k
    assert found.time is not None and found.command is not None
    np.testing.assert_allclose(found.time, FRAMES[rows] / FPS, rtol=SINGLE)
    np.testing.assert_allclose(found.q, angles(TICKS[rows])[:, :motors], atol=SINGLE)
    np.testing.assert_allclose(found.command, angles(ASKED[rows])[:, :motors], atol=SINGLE)


@pytest.mark.parametrize("k", range(len(LENGTHS)))
@pytest.mark.parametrize("place", ["data set", "above", "absolute"])
def test_normalised_values_are_angles_by_the_calibration(place: str, k: int, tmp_path: Path):
    folder = write(tmp_path / "logs" / "pick", normalised(TICKS), normalised(ASKED), order=(2, 0, 1))
    calibration = write_calibration((folder if place == "data set" else tmp_path) / "follower.json")
    form = LogFormat(calibration=str(calibration) if place == "absolute" else calibration.name)
    found = load_recording(f"{folder}#{k}", form)
    assert found.joint_names == MOTORS and found.source == f"{folder}#{k}"
    assert_episode(found, k)


@pytest.mark.parametrize("stated", [True, False])
def test_degrees_need_a_calibration_for_the_gripper_alone(stated: bool, tmp_path: Path):
    """They are recognised by a value above 100 where the unit is not stated."""
    ticks, asked = TICKS.copy(), ASKED
    ticks[:, 0] += 1500 if not stated else 0
    folder = write(tmp_path / "pick", in_degrees(ticks), in_degrees(asked))
    write_calibration(tmp_path / "follower.json")
    units = {"units": "deg"} if stated else {}
    robot = arm(MOTORS[:2], (Held("gripper", 0.0, "rad", 2),))
    without = read_recording(f"{folder}#1", robot, LogFormat(spikes="keep", **units))
    np.testing.assert_allclose(without.q, angles(ticks[EPISODES == 1])[:, :2], atol=SINGLE)
    np.testing.assert_allclose(without.command, angles(asked[EPISODES == 1])[:, :2], atol=SINGLE)  # pyright: ignore
    assert any(f.code == "units-guessed" for f in without.findings) != stated
    with pytest.raises(RecordingError, match="'gripper' is normalised from 0 to 100"):
        read_recording(f"{folder}#1", arm(), LogFormat(**units))
    if stated:
        form = LogFormat(units="deg", calibration="follower.json", spikes="keep")
        assert_episode(read_recording(f"{folder}#1", arm(), form), 1)


def test_radians_are_read_as_they_are(tmp_path: Path):
    folder = write(tmp_path / "pick", angles(TICKS), angles(ASKED), names=None)
    found = load_recording(f"{folder}#0", LogFormat(units="rad"))
    assert_episode(found, 0)
    assert found.joint_names == ()


def test_values_of_an_unknown_unit_are_refused_with_the_keys_that_decide(tmp_path: Path):
    folder = write(tmp_path / "pick", normalised(TICKS), normalised(ASKED))
    with pytest.raises(RecordingError, match="whether they are degrees or normalised") as caught:
        load_recording(f"{folder}#0")
    assert 'units = "deg"' in caught.value.possible and "calibration" in caught.value.possible


def test_an_episode_must_be_named_and_exist(tmp_path: Path):
    folder = write(tmp_path / "pick", angles(TICKS), angles(ASKED))
    form = LogFormat(units="rad")
    with pytest.raises(RecordingError, match="has 3 episodes") as caught:
        load_recording(folder, form)
    assert "episodes 0, 1, 2" in caught.value.possible and "pick#0" in str(caught.value.remedy)
    with pytest.raises(RecordingError, match="has no episode 7"):
        load_recording(f"{folder}#7", form)
    assert recording_exists(Path(f"{folder}#1")) and not recording_exists(tmp_path / "none#1")
    digests = [sha256_of_recording(Path(f"{folder}#{k}")) for k in range(3)]
    assert len({*digests, sha256_of_file(folder / "meta" / "info.json")}) == 4
    assert load_recording(f"{folder}#1", form).sha256 == digests[1]
    table = pq.read_table(folder / "data" / "chunk-000" / "file-001.parquet")
    (folder / "data" / "chunk-000" / "file-000.parquet").unlink()
    last = table.filter(pa.array(np.asarray(table["episode_index"]) == 2))
    pq.write_table(last, folder / "data" / "chunk-000" / "file-001.parquet")
    assert_episode(load_recording(folder, form), 2)  # the only one that is left


@pytest.mark.parametrize(
    ("without", "name", "words"),
    [("elbow_flex", "follower.json", "no range of the motor 'elbow_flex'"), ("", "other.json", "was not found")],
)
def test_a_calibration_that_does_not_fit_is_refused(without: str, name: str, words: str, tmp_path: Path):
    folder = write(tmp_path / "pick", normalised(TICKS), normalised(ASKED))
    write_calibration(tmp_path / "follower.json", without)
    with pytest.raises(RecordingError, match=words):
        load_recording(f"{folder}#0", LogFormat(calibration=name))


@pytest.mark.parametrize("names", [None, ["motors"], ["a", "b"]])
def test_actions_of_other_motors_need_names(names: Any, tmp_path: Path):
    """Without names, states and actions of the same number belong together."""
    folder = write(tmp_path / "pick", angles(TICKS), angles(ASKED), names=names)
    assert_episode(load_recording(f"{folder}#0", LogFormat(units="rad")), 0)
    info = json.loads((folder / "meta" / "info.json").read_text())
    info["features"]["action"]["names"] = ["x", "y", "z"]
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    with pytest.raises(RecordingError, match="action has 3 values, and it is not clear"):
        load_recording(f"{folder}#0", LogFormat(units="rad"))


@pytest.mark.parametrize("content", ["{", "[]", "{}", '{"features": {}}'])
def test_a_damaged_description_is_refused(content: str, tmp_path: Path):
    folder = write(tmp_path / "pick", angles(TICKS), angles(ASKED))
    (folder / "meta" / "info.json").write_text(content)
    with pytest.raises(RecordingError):
        load_recording(f"{folder}#0", LogFormat(units="rad"))


def test_lists_in_a_plain_table_are_matrices(tmp_path: Path):
    path = tmp_path / "run.parquet"
    pq.write_table(
        pa.table({"t": FRAMES[:40] / FPS, "q": list(angles(TICKS[:40])), "action": list(ASKED[:40] / 1e3)}), path
    )
    found = load_recording(path)
    np.testing.assert_array_equal(found.q, angles(TICKS[:40]))
    np.testing.assert_array_equal(found.command, ASKED[:40] / 1e3)  # pyright: ignore[reportArgumentType]
    pq.write_table(pa.table({"t": [0.0, 0.1], "q": [[1.0, 2.0], [1.0]]}), path)
    with pytest.raises(RecordingError, match="lists in 'q' have different lengths: 2, 1"):
        load_recording(path)
