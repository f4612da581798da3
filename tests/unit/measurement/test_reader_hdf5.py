"""HDF5: an episode as ALOHA writes it, and matrices of any names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording
from armid.robot.robot import Frame, Joint, Link, Robot

h5py = pytest.importorskip("h5py")

N, MOTORS = 120, 14
rng = np.random.default_rng(5)
QPOS, QVEL, ACTION, EFFORT = (x.astype(np.float32) for x in rng.normal(size=(4, N, MOTORS)).cumsum(axis=1))

RATE = 50.0


def write(path: Path) -> Path:
    with h5py.File(path, "w") as file:
        file.attrs["sim"] = False
        file["action"] = ACTION
        file["observations/qpos"] = QPOS
        file["observations/qvel"] = QVEL
        file["observations/effort"] = EFFORT
        file["observations/images/top"] = np.zeros((N, 4, 4, 3), dtype=np.uint8)
    return path


def assert_episode(found: Recording) -> None:
    for name, truth in (("q", QPOS), ("dq", QVEL), ("command", ACTION)):
        np.testing.assert_array_equal(getattr(found, name), truth.astype(np.float64))


@pytest.mark.parametrize("suffix", [".hdf5", ".h5"])
def test_an_episode_of_aloha(suffix: str, tmp_path: Path):
    path = write(tmp_path / f"episode_0{suffix}")
    found = load_recording(path, LogFormat(rate=RATE))
    assert_episode(found)
    assert found.effort is None and found.time is None and found.rate == RATE and found.n == MOTORS
    named = load_recording(path, LogFormat(rate=RATE, columns={"effort": "observations/effort", "dq": ""}))
    np.testing.assert_array_equal(named.effort, EFFORT)  # pyright: ignore[reportArgumentType]
    assert named.dq is None and named.command is not None


def test_one_arm_of_two_is_chosen_by_its_channels_and_needs_a_rate(tmp_path: Path):
    names = ("waist", "shoulder", "elbow")
    axis, limits = np.array([0.0, 0.0, 1.0]), np.array([-np.inf, np.inf])
    joints = [Joint(name, "revolute", k - 1, axis, np.eye(4), limits) for k, name in enumerate(names)]
    robot = Robot("arm", tuple(joints), tuple(Link(name) for name in names), Frame("tip", 2, np.eye(4)))
    path = write(tmp_path / "episode_0.hdf5")
    form = LogFormat(rate=RATE, joints=[""] * 7 + list(names) + [""] * 4, spikes="keep", consecutive=True)
    found = to_robot_convention(load_recording(path, form, robot), form, robot).recording
    assert found.command is not None
    np.testing.assert_allclose(np.unwrap(found.q, axis=0), np.unwrap(QPOS[:, 7:10].astype(np.float64), axis=0))
    with pytest.raises(RecordingError, match="rate"):
        to_robot_convention(load_recording(path, robot=robot), LogFormat(joints=form.joints), robot)


def test_other_data_sets_are_columns_by_their_paths(tmp_path: Path):
    path = tmp_path / "run.hdf5"
    with h5py.File(path, "w") as file:
        file["log/t"] = np.arange(N) / RATE
        file["log/state"] = QPOS
        file["log/target"] = ACTION
    columns = {"time": "log/t", "q": "log/state", "command": "log/target"}
    found = load_recording(path, LogFormat(columns=columns))
    np.testing.assert_array_equal(found.q, QPOS)
    np.testing.assert_array_equal(found.command, ACTION)  # pyright: ignore[reportArgumentType]
    np.testing.assert_array_equal(found.time, np.arange(N) / RATE)  # pyright: ignore[reportArgumentType]
    with pytest.raises(RecordingError, match="log/none") as caught:
        load_recording(path, LogFormat(columns={**columns, "q": "log/none"}))
    assert "log/state" in caught.value.possible
