"""`armid servo` from files to files."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from armid.export.servos.mjcf_actuators import servo_mjcf
from armid.runs.servos.stored_servo import parameters_of_record
from armid.servo.parameters import ServoParameters
from command_line import Armid, command_line
from servo_labs import any_parameters, recorded, servo_model, small_arm

FIELDS = ("friction", "rotor_inertia", "stiffness", "offset", "delay")


@pytest.fixture
def armid(capfd, monkeypatch, tmp_path) -> Armid:
    return command_line(capfd, monkeypatch, tmp_path)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A description with servos of its own, three logs, and the true parameters."""
    folder, model, rng = tmp_path_factory.mktemp("servo"), servo_model(small_arm()), np.random.default_rng(5)
    truth = any_parameters(model, rng)
    described = ServoParameters(
        model.robot.inertial_vector,
        np.full(3, 0.01),
        np.full(6, 0.1),
        np.full(3, 17.0),
        np.zeros(3),
        np.full(3, np.inf),
        np.zeros(3),
        np.zeros(3),
    )
    (folder / "arm.xml").write_bytes(servo_mjcf(model, described))
    with pytest.MonkeyPatch.context() as patched:
        for name in ("one", "two", "other"):
            run = recorded(model, truth, rng, 12.0, patched)
            with (folder / f"{name}.csv").open("w", newline="") as file:
                writer = csv.writer(file)
                writer.writerow(["t", *(f"q{k}" for k in (1, 2, 3)), *(f"command{k}" for k in (1, 2, 3))])
                command = run.held(run.time)
                writer.writerows(np.column_stack([run.time, run.q, command]).tolist())
    return folder, truth


def test_from_files_to_files(files, armid, tmp_path):
    folder, truth = files
    out = tmp_path / "result"
    done = armid(
        "servo",
        folder / "arm.xml",
        folder / "one.csv",
        folder / "two.csv",
        "--validate",
        folder / "other.csv",
        "--out",
        out,
    )
    assert done.code == 0
    assert "closed-loop position error" in done.out
    assert "command = position" in done.out
    record = json.loads((out / "servo.json").read_text())
    found = parameters_of_record(record)
    assert found.stiffness == pytest.approx(truth.stiffness, rel=0.4)
    scores = record["validation"]
    assert scores["model"]["total"] < 0.3 * scores["described"]["total"]
    origins = {each["origin"] for each in record["values"]}
    assert origins <= {"identified", "weakly identified", "prior-dominated", "not identifiable"}
    assert b"<actuator>" in (out / "model.xml").read_bytes()


def test_the_written_model_is_a_description_again(files, armid, tmp_path):
    """With the result of a first identification as description, the error of the description is that of the model,
    but for offsets and delays."""
    folder, _ = files
    first = tmp_path / "first"
    armid("servo", folder / "arm.xml", folder / "one.csv", "--out", first)
    done = armid(
        "servo",
        first / "model.xml",
        folder / "two.csv",
        "--validate",
        folder / "other.csv",
        "--json",
        "--out",
        tmp_path / "second",
    )
    scores = done.json["validation"]
    assert done.code == 0
    assert scores["described"]["total"] < scores["command"]["total"]
    assert scores["model"]["total"] < scores["described"]["total"]


def test_stated_gains_of_a_study(files, armid, tmp_path):
    folder, truth = files
    gains = ", ".join(f"{x:.6f}" for x in truth.stiffness)
    (folder / "study.toml").write_text(
        '[robot]\ndescription = "arm.xml"\n[[recording]]\npath = "one.csv"\n'
        f"[servo]\nstiffness = [{gains}]\ndelay = 0.01\n"
    )
    done = armid("servo", folder / "study.toml", "--json", "--out", tmp_path / "stated")
    assert done.code == 0
    stiffness = [each for each in done.json["values"] if each["kind"] == "stiffness"]
    assert {each["origin"] for each in stiffness} == {"given"}
    assert [each["value"] for each in stiffness] == pytest.approx(list(truth.stiffness), rel=1e-6)


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (["--stiffness", "20,15"], "has 2 values, but"),
        (["--stiffness", "hard"], "is not a list of numbers"),
        (["--stiffness", "-3"], "must be above 0"),
        (["--columns", "command="], "has no commanded positions"),
    ],
)
def test_wrong_input_is_one_error(files, armid, tmp_path, more, text):
    folder, _ = files
    done = armid("servo", folder / "arm.xml", folder / "one.csv", *more, "--out", tmp_path / "none")
    assert done.code == 2
    assert text in " ".join(done.err.split())
    assert not (tmp_path / "none").exists()


def test_options_of_a_log_beside_a_study_are_refused(files, armid):
    folder, _ = files
    (folder / "plain.toml").write_text('[robot]\ndescription = "arm.xml"\n[[recording]]\npath = "one.csv"\n')
    done = armid("servo", folder / "plain.toml", "--rate", "50")
    assert done.code == 2
    assert "defines the log format of its recordings" in done.err


def test_an_unknown_term_is_refused(files, armid):
    folder, _ = files
    (folder / "terms.toml").write_text(
        '[robot]\ndescription = "arm.xml"\n[[recording]]\npath = "one.csv"\n[servo]\nterms = ["coulom"]\n'
    )
    done = armid("servo", folder / "terms.toml")
    assert done.code == 2
    assert "coulomb" in done.err


def test_an_arm_alone_is_no_study(files, armid):
    folder, _ = files
    done = armid("servo", folder / "arm.xml")
    assert done.code == 2
    assert "no recordings are given" in done.err
