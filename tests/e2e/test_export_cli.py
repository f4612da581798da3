"""`armid export` from a study to a file that says what was identified."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from armid.robot import load_robot
from command_line import exit_code as armid
from exports import WITNESSES
from labs import STUDY, URDF, write_recordings, write_study


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small arm, and a run by each of two methods; `light` has the smallest bodies."""
    folder = tmp_path_factory.mktemp("small")
    write_recordings(folder)
    light = 'method = "physical"\nphysical = { prior = "mass" }'
    for name, how in {"physical": 'method = "physical"', "light": light, "wls": 'method = "wls"'}.items():
        study = write_study(folder, f"{STUDY}\n[estimation]\n{how}\n")
        assert armid("identify", study, "--out", folder / name, "--no-report") == 0
    return folder


def test_a_urdf_is_edited_checked_and_predicts_unseen_motion(small: Path, capsys: pytest.CaptureFixture[str]):
    capsys.readouterr()
    assert armid("export", small / "physical", "--to", "urdf", "--out", small / "found.urdf", "--json") == 0
    record = json.loads(capsys.readouterr().out)
    assert record["file"] == str(small / "found.urdf") and record["edited"] == str(small / "small.urdf")
    assert record["sha256"] == [hashlib.sha256((small / "found.urdf").read_bytes()).hexdigest()]
    assert record["side"] == str(small / "found.urdf.armid.json") and record["standard_parameters"] == "estimated"
    assert all(check["ok"] for check in record["checks"])
    names = {check["name"] for check in record["checks"]}
    for program in WITNESSES:
        assert {f"rigid-body torque in {program}", f"viscous of joint_2 in {program}"} <= names
    (unseen,) = record["unseen"]
    stored = json.loads((small / "physical" / "validation.json").read_text())["recordings"][0]["rms"]
    assert unseen["rms_file"] == pytest.approx(stored, rel=1e-9) and unseen["rms_estimate"] == pytest.approx(stored)
    assert (small / "small.urdf").read_text() == URDF


def test_it_says_what_it_did(small: Path, capsys: pytest.CaptureFixture[str]):
    assert armid("export", small / "wls", "--to", "mjcf") == 0
    out, err = capsys.readouterr()
    path = small / "wls" / "small.xml"
    assert out.startswith(f"{path} written (a new file); {path}.armid.json contains the whole model")
    assert "torque on" in out and "bodies-chosen" in err and "no-place" in err
    assert load_robot(path).joint_names == ("joint_1", "joint_2", "joint_3")


def test_bodies_are_near_the_description_unless_the_smallest_were_asked_for(small: Path):
    """The first link's mass makes no torque; the URDF says 3 kg."""
    masses = {}
    for run, options in (("physical", ()), ("light", ()), ("light", ("--nearest",))):
        out = small / f"{run}{len(options)}.urdf"
        assert armid("export", small / run, "--to", "urdf", "--out", out, *options) == 0
        inertial = load_robot(out).inertial_vector
        assert inertial is not None
        masses[run, len(options)] = inertial[0, 0]
    assert masses["light", 0] < 0.1 and masses["light", 1] > 1.0
    assert 2.0 < masses["physical", 0] < 4.0


def test_recordings_that_are_gone_are_told(small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    moved = (small / "run2.csv").rename(tmp_path / "run2.csv")
    try:
        assert armid("export", small / "physical", "--to", "sdf", "--json") == 0
        record = json.loads(capsys.readouterr().out)
        assert record["unseen"] == [] and "unseen-missing" in {f["code"] for f in record["findings"]}
        assert armid("export", small / "physical", "--to", "sdf", "--data", tmp_path, "--json") == 0
        assert len(json.loads(capsys.readouterr().out)["unseen"]) == 1
    finally:
        moved.rename(small / "run2.csv")


def test_a_macro_for_ros(small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    capsys.readouterr()
    assert armid("export", small / "physical", "--to", "xacro", "--out", tmp_path, "--json") == 0
    record = json.loads(capsys.readouterr().out)
    assert record["files"] == [str(tmp_path / "small.urdf.xacro")] and record["format"] == "xacro"
    assert {f"rigid-body torque in {each}" for each in WITNESSES} <= {check["name"] for check in record["checks"]}
    assert len(record["unseen"]) == 1
    assert armid("export", small / "physical", "--to", "xacro") == 0
    assert "small.urdf.xacro written" in capsys.readouterr().out
    assert armid("export", small / "physical", "--to", "ur-description") == 2
    assert "shoulder_link" in " ".join(capsys.readouterr().err.split())


def test_bad_input(small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert armid("export", tmp_path, "--to", "urdf") == 2
    assert "is not a run of armid" in capsys.readouterr().err
    assert armid("export", small / "physical", "--to", "step") == 2
    assert "Unknown format 'step'" in capsys.readouterr().err
    assert armid("export", small / "physical", "--to", "urdf", "--out", small / "small.urdf") == 2
    assert "this file is the description" in " ".join(capsys.readouterr().err.split())
    assert armid("export", small / "physical", "--to", "urdf", "--out", "/proc/none/x.urdf") == 2
    assert "could not be written" in capsys.readouterr().err
