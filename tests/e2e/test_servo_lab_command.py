"""`armid simulate --servo`: files, identification of what it wrote, and comparison with the truth."""

from __future__ import annotations

import json

import numpy as np
import pytest

from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from armid.robot import load_robot
from command_line import Armid, command_line

pytest.importorskip("mujoco")

HOLD = 0.75
"""Least share of the 95 % intervals that hold the truth: they are lower limits (docs/servo.md)."""


@pytest.fixture
def armid(capfd, monkeypatch, tmp_path) -> Armid:
    return command_line(capfd, monkeypatch, tmp_path)


def truths(record, joints):
    """True values by kind and joint."""
    servo, names = record["servo"], record["parameters"]
    found = {}
    for j, joint in enumerate(joints):
        for kind in ("stiffness", "damping", "delay", "offset"):
            found[kind, joint] = servo[kind][j]
        found["rotor_inertia", joint] = names[f"IA_{j + 1}"]
        for kind in ("FV", "FS"):
            found[kind, joint] = names[f"{kind}_{j + 1}"]
    return found


@pytest.mark.parametrize(
    ("arm", "gains", "error", "relative"),
    [
        ("stand-leg", ("--stiffness", "25", "--damping", "0.8"), 0.2e-3, 0.15),
        pytest.param("hobby-arm", (), 0.8e-3, 0.25, marks=pytest.mark.long),
    ],
    ids=("leg", "hobby arm"),
)
def test_what_the_lab_writes_identifies_the_truth(armid, tmp_path, arm, gains, error, relative):
    """Errors on unseen motion are those of the encoder: its step is 0.38 or 1.53 mrad."""
    for seed, seconds, name in ((1, 20, "train"), (2, 10, "other")):
        done = armid("simulate", arm, "--servo", "--seconds", seconds, "--seed", seed, "--out", name, "--json")
        assert done.code == 0, done.err
    found = armid(
        "servo",
        f"train/{arm}.xml",
        "train/recording.csv",
        "--validate",
        "other/recording.csv",
        *gains,
        "--out",
        "result",
        "--json",
    )
    assert found.code == 0, found.err
    record, truth = found.json, json.loads((tmp_path / "train" / "truth.json").read_text())
    right = truths(truth, record["joints"])
    assert record["validation"]["model"]["total"] < error
    assert record["validation"]["command"]["total"] > 10.0 * error
    estimated = [each for each in record["values"] if each["origin"] == "identified"]
    holds = [each["low"] <= right[each["kind"], each["joint"]] <= each["high"] for each in estimated]
    assert len(estimated) > 3 * len(record["joints"]) and np.mean(holds) >= HOLD
    for each in estimated:
        if each["kind"] in ("stiffness", "rotor_inertia", "FS"):
            assert each["value"] == pytest.approx(right[each["kind"], each["joint"]], rel=relative)


def test_files_of_a_simulation(armid, tmp_path):
    done = armid("simulate", "hobby-arm", "--servo", "--seconds", 3, "--noise-free", "--out", "lab")
    assert done.code == 0 and "command minus position" in done.out
    assert {path.name for path in (tmp_path / "lab").iterdir()} == {
        "recording.csv",
        "truth.json",
        "hobby-arm.xml",
        "noise-free.npz",
    }
    again = armid("simulate", "lab/hobby-arm.xml", "--servo", "--seconds", 3, "--out", "again")
    assert again.code == 0
    logs = [(tmp_path / name / "recording.csv").read_bytes() for name in ("lab", "again")]
    assert logs[0] == logs[1]  # the description in the folder is that of the virtual arm


def test_a_data_set_of_lerobot_is_the_same_log(armid, tmp_path):
    for kind in ("csv", "lerobot"):
        done = armid("simulate", "hobby-arm", "--servo", "--seconds", 3, "--format", kind, "--out", kind)
        assert done.code == 0, done.err
    robot = load_robot(tmp_path / "csv" / "hobby-arm.xml")
    table = load_recording(tmp_path / "csv" / "recording.csv", LogFormat(), robot)
    episode = load_recording(tmp_path / "lerobot" / "recording", LogFormat(units="deg"), robot)
    assert episode.joint_names == robot.joint_names
    assert np.abs(np.deg2rad(episode.q) - table.q).max() < 1e-6  # single precision
    assert np.abs(np.deg2rad(episode.command) - table.command).max() < 1e-6


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("hobby-arm", "--servo", "--controller", "pid"), "exclude each other"),
        (("iiwa14-r820",), "PLAN is missing"),
        (("iiwa14-r820", "thesis-a1", "--format", "lerobot"), "format"),
        (("hobby-arm", "--servo", "thesis-a1"), "7 joints"),
        (("hobby-arm", "missing.csv", "--servo"), "missing.csv"),
    ],
)
def test_what_is_wrong_is_said(armid, tmp_path, arguments, word):
    done = armid("simulate", *arguments, "--out", "lab")
    assert done.code != 0 and word in done.err
    assert not (tmp_path / "lab").exists()
