"""`armid excite --servo`: files for programs and controllers, which the lab follows."""

from __future__ import annotations

import json

import numpy as np
import pytest

from armid.excitation.command_motion import load_commands
from armid.excitation.formats import ros2
from armid.lab.servos.virtual_arms import description_of
from command_line import Armid, command_line

LEG = description_of("stand-leg")
QUICK = ("--duration", 5, "--budget", 0.5)


@pytest.fixture
def armid(capfd, monkeypatch, tmp_path) -> Armid:
    return command_line(capfd, monkeypatch, tmp_path)


def test_all_files_hold_one_motion(armid, tmp_path):
    pq = pytest.importorskip("pyarrow.parquet")
    done = armid("excite", LEG, "--servo", *QUICK, "--limit", "knee.position=-2:-1", "--out", "plan")
    assert done.code == 0, done.err
    assert "expected standard deviations" in done.out and "lerobot" in done.out
    motion = load_commands(tmp_path / "plan" / "commands.csv")
    assert motion.rate == 50.0 and len(motion.command) == 250
    assert motion.command[:, 2].min() >= -2.0 and motion.command[:, 2].max() <= -1.0
    track = ros2.read((tmp_path / "plan" / "commands.trajectory.yaml").read_bytes())
    assert track.joints == ("abduction", "thigh", "knee")
    assert np.abs(track.motion.q - motion.command).max() < 1e-8
    table = pq.read_table(tmp_path / "plan" / "lerobot" / "data" / "chunk-000" / "file-000.parquet")
    actions = np.array(table["action"].to_pylist())
    assert np.abs(np.deg2rad(actions) - motion.command).max() < 1e-6
    info = json.loads((tmp_path / "plan" / "lerobot" / "meta" / "info.json").read_text())
    assert info["features"]["action"]["names"] == ["abduction.pos", "thigh.pos", "knee.pos"]
    record = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert set(record["expected_deviations"]) == {"stiffness", "rotor_inertia", "FV", "FS", "delay"}
    assert max(record["torque_share"]) <= 0.7


def test_the_lab_follows_the_plan(armid, tmp_path):
    pytest.importorskip("mujoco")
    gains = ("--stiffness", 25, "--damping", "0.8,0.8,0.8")
    done = armid("excite", LEG, "--servo", *QUICK, *gains, "--format-rate", 100, "--out", "plan", "--json")
    assert done.code == 0, done.err
    assert set(done.json["expected_deviations"]) == {"rotor_inertia", "FV", "FS", "delay"}
    lab = armid("simulate", "stand-leg", "plan", "--servo", "--rate", 100, "--out", "lab", "--json")
    assert lab.code == 0 and lab.json["samples"] == 500


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("--harmonics", 5), "--harmonics"),
        (("--limit", "hip.velocity=1"), "no joint"),
        (("--limit", "knee.jerk=1"), "no meaning"),
        (("--limit", "knee.position=1"), "no meaning"),
        (("--stiffness", "a"), "list of numbers"),
        (("--stiffness", "1,2"), "2 values"),
    ],
)
def test_what_is_wrong_is_said(armid, tmp_path, arguments, word):
    done = armid("excite", LEG, "--servo", *QUICK, *arguments, "--out", "plan")
    assert done.code != 0 and word in done.err
    assert not (tmp_path / "plan").exists()
