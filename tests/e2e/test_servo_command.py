"""`armid servo` from files to files."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.cli import main as cli
from armid.cli.folder_overview import next_step
from armid.export.formats import urdf
from armid.export.servos import deliver
from armid.export.servos.mjcf_actuators import servo_mjcf
from armid.export.types import Content
from armid.robot import load_robot
from armid.runs.servos.servo_recordings import read_servo_runs
from armid.runs.servos.stored_servo import load_servo, parameters_of_record
from armid.servo.parameters import ServoParameters
from armid.servo.score import closed_loop_error
from command_line import Armid, command_line
from reports import Page
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
    for name in ("one", "two", "other"):
        run = recorded(model, truth, rng, 12.0)
        with (folder / f"{name}.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["t", *(f"q{k}" for k in (1, 2, 3)), *(f"command{k}" for k in (1, 2, 3))])
            command = run.held(run.time)
            writer.writerows(np.column_stack([run.time, run.q, command]).tolist())
    return folder, truth


@pytest.fixture(scope="module")
def identified(files, tmp_path_factory):
    """Folder of a result, and what the command printed."""
    folder, _ = files
    out = tmp_path_factory.mktemp("identified") / "result"
    arguments = [folder / "arm.xml", folder / "one.csv", folder / "two.csv", "--validate", folder / "other.csv"]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), pytest.raises(SystemExit) as ended:
        cli.main(["servo", *map(str, arguments), "--out", str(out)])
    return out, printed.getvalue(), ended.value.code


def test_from_files_to_files(files, identified):
    _, truth = files
    out, printed, code = identified
    assert not code
    assert "closed-loop position error" in printed
    assert "command = position" in printed
    assert "MuJoCo" in printed
    record = json.loads((out / "servo.json").read_text())
    found = parameters_of_record(record)
    assert found.stiffness == pytest.approx(truth.stiffness, rel=0.4)
    scores = record["validation"]
    assert scores["model"]["total"] < 0.3 * scores["described"]["total"]
    origins = {each["origin"] for each in record["values"]}
    assert origins <= {"identified", "weakly identified", "prior-dominated", "not identifiable"}
    assert b"<actuator>" in (out / "model.xml").read_bytes()
    assert record["rollout_check"]["total"] < record["rollout_check"]["bound"]


def test_the_folder_is_read_as_it_was_written(identified):
    out, _, _ = identified
    found, record = load_servo(out), json.loads((out / "servo.json").read_text())
    assert found.errors.verdict == record["verdict"] == "pass"
    assert found.parameters.stiffness == pytest.approx(record["parameters"]["stiffness"], rel=1e-12)
    assert np.isinf(found.parameters.limit).all()  # null in the record
    assert [(each.kind, each.value) for each in found.values] == [(v["kind"], v["value"]) for v in record["values"]]
    runs, missing = read_servo_runs(found, "validate")
    assert not missing
    again = closed_loop_error(found.model, found.parameters, runs)
    assert again.joints == pytest.approx(record["validation"]["model"]["joints"], rel=1e-9)


def test_the_page_shows_errors_motion_and_parameters(identified, armid, tmp_path):
    out, _, _ = identified
    written = Page((out / "report.html").read_text())
    assert armid("report", out, "--out", tmp_path / "again.html").code == 0
    for page in (written, Page((tmp_path / "again.html").read_text())):
        tables = page.data["tables"]
        assert {"servo-errors", "servo-values", "provenance"} <= set(tables)
        heads = tables["servo-errors"]["csv"].splitlines()[0]
        assert "command = position [mrad]" in heads
        assert "description [mrad]" in heads
        assert {f"servo-{kind}-0-{j}" for kind in ("q", "error") for j in range(3)} == set(page.data["plots"])
        assert "The identified arm predicts validation motion better" in page.prose


def test_a_page_without_the_recordings_has_tables_only(identified, armid, tmp_path):
    out, _, _ = identified
    moved = tmp_path / "moved"
    shutil.copytree(out, moved)
    record = json.loads((moved / "servo.json").read_text())
    record["study"]["folder"] = str(tmp_path)
    for each in record["study"]["recordings"]:
        each["path"] = Path(each["path"]).name
    (moved / "servo.json").write_text(json.dumps(record))
    done = armid("report", moved)
    assert done.code == 0
    assert "recording-missing" in done.err
    page = Page((moved / "report.html").read_text())
    assert not page.data["plots"]
    assert "servo-errors" in page.data["tables"]


def test_another_recording_is_judged(files, identified, armid, tmp_path):
    folder, _ = files
    out, _, _ = identified
    done = armid("validate", out, folder / "other.csv", "--json", "--page", tmp_path / "other.html")
    record = json.loads((out / "servo.json").read_text())
    assert done.code == 0
    assert done.json["verdict"] == "pass"
    assert done.json["model"]["joints"] == pytest.approx(record["validation"]["model"]["joints"], rel=1e-9)
    assert "servo-q-0-0" in Page((tmp_path / "other.html").read_text()).data["plots"]
    refused = armid("validate", out, folder / "one.csv")
    assert refused.code == 2
    assert "was trained on the same data" in " ".join(refused.err.split())


@pytest.mark.parametrize("arguments", [("predict", "RUN", "one.csv"), ("export", "RUN", "--to", "c")])
def test_commands_for_torques_say_what_the_folder_is(files, identified, armid, arguments):
    folder, _ = files
    out, _, _ = identified
    given = [out if each == "RUN" else folder / each if each.endswith("csv") else each for each in arguments]
    done = armid(*given)
    assert done.code == 2
    assert "is a result of armid servo" in " ".join(done.err.split())


def test_a_preview_shows_the_arm_in_motion(identified, armid, tmp_path):
    out, _, _ = identified
    assert armid("preview", out, "--out", tmp_path / "preview.html").code == 0
    assert "other.csv" in (tmp_path / "preview.html").read_text()


def test_an_unknown_format_is_one_error(identified, armid, tmp_path):
    out, _, _ = identified
    other = tmp_path / "other"
    shutil.copytree(out, other)
    record = json.loads((other / "servo.json").read_text())
    (other / "servo.json").write_text(json.dumps({**record, "format": 1}))
    done = armid("report", other)
    assert done.code == 2
    assert "has format 1" in " ".join(done.err.split())


def test_a_folder_without_its_robot_is_one_error(identified, armid, tmp_path):
    out, _, _ = identified
    other = tmp_path / "other"
    shutil.copytree(out, other)
    (other / "robot.npz").unlink()
    done = armid("report", other)
    assert done.code == 2
    assert "robot.npz" in done.err


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda record: record.update(band=[0.1]), "for 3 joints"),
        (lambda record: record["training"].update(joints=[0.1]), "for 3 joints"),
        (lambda record: record["sha256"].update(recordings=[]), "0 digests"),
        (lambda record: record["values"][0].update(origin="guessed"), "is no origin"),
        (lambda record: record["sha256"].update(robot="0" * 64), "changed or damaged"),
        (lambda record: record.pop("longest_step"), "cannot be read"),
    ],
)
def test_a_damaged_record_is_one_error(identified, armid, tmp_path, change, text):
    out, _, _ = identified
    other = tmp_path / "other"
    shutil.copytree(out, other)
    record = json.loads((other / "servo.json").read_text())
    change(record)
    (other / "servo.json").write_text(json.dumps(record))
    done = armid("report", other)
    assert done.code == 2
    assert text in " ".join(done.err.split())


def test_the_overview_names_the_latest_servos(identified, tmp_path, monkeypatch):
    out, _, _ = identified
    shutil.copytree(out, tmp_path / "runs" / "hobby")
    assert "armid validate runs/hobby RECORDING" in next_step(tmp_path)


def test_parameters_by_the_names_of_simulators(identified):
    """Each program has the identified numbers, in its own names."""
    out, _, _ = identified
    found, record = load_servo(out).parameters, json.loads((out / "simulators.json").read_text())
    names = list(record["joints"])
    stiffness = dict(zip(names, found.stiffness.tolist(), strict=True))
    assert record["isaaclab"]["stiffness"] == pytest.approx(stiffness)
    assert {each["target_names_expr"][0]: each["stiffness"] for each in record["mjlab"]} == pytest.approx(stiffness)
    assert record["isaaclab"]["friction"] == record["isaaclab"]["dynamic_friction"]
    assert [each["armature"] for each in record["bam"].values()] == pytest.approx(found.rotor_inertia.tolist())
    total = [each["friction_viscous"] for each in record["bam"].values()]
    assert total == pytest.approx(list(record["isaaclab"]["viscous_friction"].values()))  # no damping was given


def test_a_urdf_is_edited(files, armid, tmp_path):
    """With limits in the description, the result has a URDF with bodies, friction and the limits of the servos."""
    folder, _ = files
    text = urdf_of(small_arm())
    (tmp_path / "arm.urdf").write_text(text)
    done = armid("servo", tmp_path / "arm.urdf", folder / "one.csv", "--stiffness", "17", "--out", tmp_path / "urdf")
    assert done.code == 0
    found, written = load_servo(tmp_path / "urdf"), load_robot(tmp_path / "urdf" / "model.urdf")
    assert written.inertial_vector == pytest.approx(found.parameters.inertial, rel=1e-9, abs=1e-12)
    viscous = [joint.drive.viscous for joint in written.joints]
    values = {each.joint: each.value for each in found.values if each.kind == "FV"}
    assert viscous == pytest.approx([values[j] for j in range(3)])
    assert [joint.effort_limit for joint in written.joints] == [5.0] * 3


def urdf_of(robot) -> str:
    """URDF of an arm whose joints have limits."""
    joints = [replace(joint, effort_limit=5.0) for joint in robot.joints]
    return urdf.write(Content(replace(robot, joints=joints), {})).data.decode()


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


def test_a_result_is_kept_if_a_further_file_fails(files, armid, tmp_path, monkeypatch):
    """The estimate is in its folder before the files for other programs are made."""
    folder, _ = files

    def failed(*_):
        raise MemoryError("as another library may")

    monkeypatch.setattr(deliver, "delivered", failed)
    done = armid("servo", folder / "arm.xml", folder / "one.csv", "--stiffness", "20", "--out", tmp_path / "kept")
    assert done.code
    found = load_servo(tmp_path / "kept")
    assert found.parameters.stiffness == pytest.approx(20.0)


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
