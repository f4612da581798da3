"""The lab on the command line: simulate, identify what it wrote, set the model free, compare with the truth."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.excitation.fourier import save_plan
from armid.measurement.readers import load_recording
from armid.measurement.writing import WRITERS
from command_line import Armid, command_line
from labs import write_arm
from plants import short_plan


@pytest.fixture
def armid(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Armid:
    write_arm(tmp_path)
    save_plan(short_plan(1), tmp_path / "train.json")
    save_plan(short_plan(2), tmp_path / "unseen.json")

    return command_line(capfd, monkeypatch, tmp_path)


LAB = """
lead_in = 1.0
physics_rate = 2000
repetitions = 2
[controller]
friction = 1.0
[sensing]
rate = 200
position = { noise = 1e-6 }
effort = { noise = 0.02 }
"""

EXACT = ("--terms", "rigid-body,viscous,coulomb")


def inside(estimate: dict[str, Any], truth: dict[str, Any]) -> float:
    """Share of the base parameters whose 95 % interval has the truth."""
    found = estimate["base_parameters"]
    assert {p["name"] for p in found} == set(truth["base_parameters"])
    hits = [p["interval95"][0] <= truth["base_parameters"][p["name"]] <= p["interval95"][1] for p in found]
    return float(np.mean(hits))


def distance(estimate: dict[str, Any], truth: dict[str, Any]) -> float:
    found = {p["name"]: p["value"] for p in estimate["base_parameters"]}
    right = np.array([truth["base_parameters"][name] for name in found])
    return float(np.linalg.norm(np.array(list(found.values())) - right) / np.linalg.norm(right))


@pytest.mark.parametrize("mode", ["inverse-dynamics", "closed-loop"])
def test_what_the_lab_writes_identifies_the_truth(armid, tmp_path: Path, mode: str):
    (tmp_path / "lab.toml").write_text(LAB)
    for seed, name in enumerate(("train", "unseen"), start=1):
        done = armid(
            "simulate", "small.urdf", f"{name}.json", "--options", "lab.toml", "--mode", mode, "--seed", seed,
            "--out", name, "--json",
        )  # fmt: skip
        assert done.code == 0, done.err
        said = json.loads(done.out)
        assert said["samples"] == 3200 and said["joints"] == ["joint_1", "joint_2", "joint_3"]
    found = armid(
        "identify", "small.urdf", "train/recording.csv", "--validate", "unseen/recording.csv", *EXACT,
        "--out", "run", "--json",
    )  # fmt: skip
    assert found.code == 0, found.err
    estimate, truth = json.loads(found.out), json.loads(Path("train/truth.json").read_text())
    assert inside(estimate, truth) >= 0.8  # 95 % are expected, of 18 parameters
    assert distance(estimate, truth) < 0.01
    assert estimate["validation"]["verdict"] == "pass"

    rolled = armid("validate", "run", "unseen/recording.csv", "--simulate", "--window", 0.3, "--json")
    assert rolled.code == 0, rolled.err
    motion = json.loads(rolled.out)["motion"]
    assert "windows of 0.3 s" in json.loads(rolled.out)["checks"][-1]["name"]
    (score,) = motion["recordings"]
    assert score["ran_away"] == score["not_positive_definite"] == 0
    assert not motion["closed_loop"] and score["windows"] > 30 and score["lost"] == 0
    assert max(score["rms"]) < 0.01 < min(score["travelled"])
    if mode == "closed-loop":
        under = armid(
            "validate", "run", "unseen/recording.csv", "--controller", "unseen/truth.json", "--window", 4, "--json"
        )
        (score,) = json.loads(under.out)["motion"]["recordings"]
        assert score["seconds"] == 4.0 and max(score["rms"]) < np.deg2rad(0.1)
        files = "--out", "motion.csv", "--page", "motion.html"
        table = armid("validate", "run", "unseen/recording.csv", "--controller", "unseen/truth.json", *files)
        assert "under the same controller" in table.out and "joint_3" in table.out
        assert "written to motion.csv" in table.out and "written to motion.html" in table.out
        assert_written()


def assert_written() -> None:
    """The file has recorded and simulated motion and torque of all windows; the page has the plots of each joint."""
    table = np.genfromtxt("motion.csv", delimiter=",", names=True)
    assert np.unique(table["recording"]).tolist() == [1.0] and table["window"].max() == 29.0
    for j in (1, 2, 3):
        assert np.abs(table[f"q_{j}"] - table[f"recorded_q_{j}"]).max() < np.deg2rad(1.0)
        difference = table[f"tau_{j}"] - table[f"recorded_tau_{j}"]
        assert 0.0 < difference.std() < 0.1 * table[f"recorded_tau_{j}"].std()
    page = Path("motion.html").read_text(encoding="utf-8")
    assert all(f'"rollout-{plot}-1-{j}"' in page for plot in ("q", "error", "torque") for j in range(3))
    assert "plus the feedback of the controller" in page


@pytest.mark.parametrize("suffix", WRITERS)
def test_every_format(armid, suffix: str):
    kind = suffix[1:]
    done = armid("simulate", "small.urdf", "train.json", "--mode", "inverse-dynamics", "--rate", 50, "--format", kind)
    assert done.code == 0 and "400 rows of 3 joints" in done.out
    folder = Path("runs/small-lab")
    truth = json.loads((folder / "truth.json").read_text())
    recording = load_recording(folder / f"recording{suffix}")
    assert recording.sha256 == truth["recording_sha256"] and recording.samples == 400


def test_effects_and_the_noise_free_truth(armid):
    done = armid(
        "simulate", "small.urdf", "train.json", "--effects", "rotor,stribeck,ripple", "--period", 2, "--rate", 100,
        "--controller", "pd-gravity", "--noise-free", "--out", "lab",
    )  # fmt: skip
    assert done.code == 0, done.err
    truth = json.loads(Path("lab/truth.json").read_text())
    assert truth["controller"]["kind"] == "pd-gravity" and min(truth["rotor"]) > 0.0
    assert truth["friction"]["stribeck"]["extra"] and truth["plan"]["period"] == pytest.approx(2.0)
    with np.load("lab/noise-free.npz") as archive:
        exact = archive["effort"]
    logged = load_recording("lab/recording.csv")
    assert exact.shape == (200, 3) and logged.effort is not None
    assert (logged.effort - exact).std() == pytest.approx(0.3, rel=0.1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--mode", "magic"), "Unknown mode 'magic'"),
        (("--controller", "magic"), "Unknown controller 'magic'"),
        (("--effects", "magic"), "Unknown effect 'magic'"),
        (("--format", "xls"), "'xls'"),
        (("--rate", "9000"), "8000"),
        (("--options", "nowhere.toml"), "nowhere.toml"),
        (("--lock", "joint_1"), "The plan moves 3 joints"),
    ],
)
def test_bad_input_is_one_message(armid, arguments: tuple[str, ...], message: str):
    done = armid("simulate", "small.urdf", "train.json", *arguments)
    assert done.code == 2 and message in done.err and not done.out and not Path("runs").exists()


def test_bad_input_of_a_roll_out_is_one_message(armid):
    armid("simulate", "small.urdf", "train.json", "--mode", "inverse-dynamics", "--rate", 100, "--out", "a")
    armid("simulate", "small.urdf", "unseen.json", "--mode", "inverse-dynamics", "--rate", 100, "--out", "b")
    assert armid("identify", "small.urdf", "a/recording.csv", *EXACT, "--out", "run").code == 0
    Path("gains.json").write_text('{"controller": {"proportional": [1], "derivative": [1]}}')
    for arguments, message in (
        (("--simulate", "--window", "100"), "The rollout needs a segment of 100 s"),
        (("--controller", "gains.json"), "gains for 1 joints"),
        (("--controller", "nowhere.json"), "nowhere.json"),
        (("--out", "motion.txt"), "neither .csv nor .npz"),
        (("--page", "gains.json"), "not an HTML page"),
    ):
        done = armid("validate", "run", "b/recording.csv", *arguments)
        assert done.code == 2 and message in done.err


def test_without_mujoco_the_extra_is_named(armid, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    done = armid("simulate", "small.urdf", "train.json")
    assert done.code == 2 and "armid[lab]" in done.err
