"""Published recordings with a command and without torque."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from armid.measurement.convention_conversion import read_recording
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from armid.robot import load_robot

pytestmark = pytest.mark.real

SO101 = (
    "chirp_sweep",
    "custom_motion",
    "hold_under_gravity",
    "large_amplitude",
    "lissajous_pattern",
    "multisine",
    "trapezoidal_profile",
    "workspace_sweep",
)

ERROR = 0.1
"""RMS difference of command and position [rad] that the servos of the SO-101 stay below in all motions. A command in
another unit, of another joint or of another time differs by more in the fast motions."""

SAME = {"time": 0.0, "q": 0.0, "dq": 0.0, "command": 0.0}
"""Both readers convert the same decimal numbers."""


def test_a_folder_of_sage_is_its_converted_table(shared_data: Path):
    """Another program has converted the same folder to a table."""
    data = shared_data / "so101_sage"
    folder, table = load_recording(data / "raw" / "custom_motion"), load_recording(data / "custom_motion.parquet")
    for name, tolerance in SAME.items():
        np.testing.assert_allclose(getattr(folder, name), getattr(table, name), rtol=0.0, atol=tolerance)
    assert folder.joint_names == ("Rotation", "Pitch", "Elbow", "Wrist_Pitch", "Wrist_Roll", "Jaw")
    assert folder.effort is None


@pytest.mark.parametrize("name", SO101)
def test_so101(name: str, shared_data: Path):
    robot = load_robot(shared_data / "so101_sage" / "so101_new_calib.urdf")
    recording = read_recording(shared_data / "so101_sage" / f"{name}.parquet", robot)
    assert recording.command is not None and recording.effort is None and recording.valid.all()
    rows = json.loads((shared_data / "so101_sage" / f"{name}.json").read_text())["rows"]
    assert recording.samples == rows
    assert np.sqrt(np.mean((recording.command - recording.q) ** 2, axis=0)).max() < ERROR


def test_go2(shared_data: Path):
    robot = load_robot(shared_data / "go2_stand" / "go2.xml", lock={"base_joint_0": 0.0})
    recording = read_recording(shared_data / "go2_stand" / "first70.parquet", robot, LogFormat())
    assert recording.command is not None and recording.effort is None
    assert np.sqrt(np.mean((recording.command - recording.q) ** 2, axis=0)).max() < 2 * ERROR
