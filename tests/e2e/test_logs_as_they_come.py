"""Logs as people have them, through the command line: folders of bags, names of columns, other files beside them."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from armid.cli.main import main
from armid.excitation.formats import FORMATS, SampledMotion
from armid.excitation.fourier import save_plan
from armid.measurement.recording import Recording
from armid.study.remedy_translation import as_option
from labs import small_model, small_plan, small_recording, write_arm, write_recording
from recordings import joint_state, write_bag_folder

pytest.importorskip("rosbags")

JOINTS = ("joint_1", "joint_2", "joint_3")


def called(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main([*map(str, arguments)])
    shown = capsys.readouterr()
    return int(end.value.code or 0), shown.out, shown.err


def as_bag(log: Recording, path: Path, extra: tuple[str, ...] = ("finger",)) -> Path:
    """The folder that a recorder of ROS 2 leaves, joints in another order and more of them."""
    assert log.time is not None and log.effort is not None
    more = np.full((log.samples, len(extra)), 0.01)
    q, tau = (np.column_stack([x[:, ::-1], more]) for x in (log.q, log.effort))
    at = 1_700_000_000_000_000_000 + np.round(1e9 * log.time).astype(np.int64)
    names = (*JOINTS[::-1], *extra)
    messages = [joint_state(t, names, x, None, y) for t, x, y in zip(at, q, tau, strict=True)]
    return write_bag_folder(path, messages)


def as_table(log: Recording, path: Path, q: str, tau: str, names: tuple[str, ...], unit: float = 1.0) -> Path:
    assert log.time is not None and log.effort is not None
    columns = {"t [ms]": 1e3 * log.time}
    columns |= {
        form.format(name): values[:, k]
        for form, values in ((q, log.q / unit), (tau, log.effort))
        for k, name in enumerate(names)
    }
    np.savetxt(
        path,
        np.column_stack(list(columns.values())),
        delimiter=";",
        header=";".join(columns),
        comments="",
        fmt="%.17g",
    )
    return path


def test_the_folder_of_a_bag_goes_from_the_doctor_to_a_verdict(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    arm = write_arm(tmp_path)
    train, check = as_bag(small_recording(1), tmp_path / "train"), as_bag(small_recording(2), tmp_path / "check")
    code, out, _ = called(capsys, "doctor", arm, train, "--json")
    found = {f["code"]: f for f in json.loads(out)["findings"]}
    assert code == 0 and "finger" in found["joints-extra"]["evidence"]
    run = tmp_path / "run"
    code, _, err = called(capsys, "identify", arm, train, "--validate", check, "--out", run, "--no-report")
    assert code == 0 and "finger" in err
    assert called(capsys, "validate", run, check)[0] == 0
    code, out, err = called(capsys, "validate", run, train)
    assert code == 2 and "trained on the same data" in " ".join(err.split())
    torque = tmp_path / "torque.csv"
    assert called(capsys, "predict", run, check, "--out", torque)[0] == 0 and torque.is_file()
    assert called(capsys, "report", run)[0] == 0  # finds the folders again by what they hold


def test_what_was_guessed_stands_in_the_run_and_others_are_guessed_anew(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    arm, degree = write_arm(tmp_path), np.pi / 180
    train = as_table(small_recording(1), tmp_path / "train.csv", "{} pos [deg]", "{} torque", JOINTS, degree)
    check = as_table(small_recording(2), tmp_path / "check.csv", "q_{}", "tau_meas_{}", ("0", "1", "2"))
    run = tmp_path / "run"
    code, _, err = called(capsys, "identify", arm, train, "--validate", check, "--out", run, "--no-report")
    assert code == 0 and "columns-guessed" in err and "armid doctor" in err
    first, second = json.loads((run / "study.json").read_text())["recordings"]
    assert first["reading"]["columns"]["q"] == [f"{name} pos [deg]" for name in JOINTS]
    assert first["reading"]["units"] == "deg" and "units" not in second["reading"]
    assert second["reading"]["columns"]["effort"] == ["tau_meas_0", "tau_meas_1", "tau_meas_2"]
    later = write_recording(small_recording(3), tmp_path / "later.csv")
    for path in (check, later):
        code, out, _ = called(capsys, "validate", run, path, "--json")
        assert code == 0 and json.loads(out)["verdict"] == "pass"


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    """A folder as `armid excite` leaves it, with a file for each controller."""
    folder = tmp_path / "plans"
    save_plan(small_plan(4), folder / "plan.json")
    for form in FORMATS.values():
        track = SampledMotion("small", JOINTS, (False,) * 3, small_plan(4).sample(form.RATE))
        if not form.problem(track):
            (folder / f"plan{form.SUFFIX}").write_bytes(form.write(track))
    return folder


def test_a_plan_is_taken_in_each_of_its_files(plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    pytest.importorskip("mujoco")
    arm, run = write_arm(tmp_path), tmp_path / "run"
    train = write_recording(small_recording(1), tmp_path / "train.csv")
    assert called(capsys, "identify", arm, train, "--out", run, "--no-report")[0] == 0
    files = (plan, plan / "plan.json", plan / "plan.csv", plan / "plan.mat", plan / "plan.trajectory.yaml")
    assert all(path.exists() for path in files)
    torques: list[np.ndarray] = []
    for path in files:
        code, _, err = called(capsys, "predict", run, path, "--plan-rate", "50", "--out", tmp_path / "torque.csv")
        assert code == 0, err
        rows = np.loadtxt(tmp_path / "torque.csv", delimiter=",", skiprows=1)
        torques.append(
            np.array([np.interp(np.arange(0.0, 7.9, 0.02), rows[:, 0], column) for column in rows[:, 1:].T])
        )
    for path, torque in zip(files[1:], torques[1:], strict=True):
        # Friction turns over within a hundredth of a second, where files have other rows.
        assert np.median(np.abs(torque - torques[0])) < 1e-2, path
    logs = [
        called(capsys, "simulate", arm, path, "--mode", "inverse-dynamics", "--json", "--out", tmp_path / "lab")[1]
        for path in files
    ]
    assert len({json.loads(log)["samples"] for log in logs}) == 1 and len(set(logs)) == 1


def test_a_plan_that_was_written_is_a_log_of_positions(
    plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    code, out, _ = called(capsys, "doctor", write_arm(tmp_path), plan / "plan.csv", "--json")
    found = {f["code"]: f for f in json.loads(out)["findings"]}
    assert code == 1 and "q_joint_1" in found["columns-guessed"]["evidence"]
    assert "The recording has no effort" in found["effort-missing"]["evidence"]
    code, _, err = called(capsys, "doctor", tmp_path / "small.urdf", plan)
    assert code == 2 and "the folder is a plan of armid excite" in err
    assert small_model().robot.joint_names == JOINTS


def test_what_the_page_on_bags_claims(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """The doctor's exit codes and findings on bags that lack something."""
    arm, log = write_arm(tmp_path), small_recording(1)
    assert log.time is not None and log.effort is not None
    at = 1_700_000_000_000_000_000 + np.round(1e9 * log.time).astype(np.int64)
    rows = list(zip(at, log.q, log.effort, strict=True))

    def found(bag: Path, *options: str) -> tuple[int, dict[str, str]]:
        code, out, _ = called(capsys, "doctor", arm, bag, "--json", *options)
        return code, {f["code"]: f["severity"] for f in json.loads(out)["findings"]}

    bag = write_bag_folder(
        tmp_path / "unstamped", [joint_state(t, JOINTS, q, None, y, stamped=False) for t, q, y in rows]
    )
    code, codes = found(bag)
    assert code == 0 and codes["clock-received"] == "warning"
    code, codes = found(bag, "--lock", "joint_3")
    assert codes["locked-joint"] == "warning"
    bag = write_bag_folder(tmp_path / "no_effort", [joint_state(t, JOINTS, q) for t, q, _ in rows])
    code, codes = found(bag)
    assert code == 1 and codes["effort-missing"] == "error"
    bag = write_bag_folder(tmp_path / "other", [joint_state(t, ("a", "b", "c"), q, None, y) for t, q, y in rows])
    code, _, err = called(capsys, "doctor", arm, bag)
    assert code == 2 and "a, b, c" in err and "joints = { name in the recording = robot joint }" in err


def test_options_hold_for_recordings_to_check_on_and_it_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    arm, degree = write_arm(tmp_path), np.pi / 180
    train = as_table(small_recording(1), tmp_path / "train.csv", "q{}", "tau{}", ("1", "2", "3"), degree)
    check = as_table(small_recording(2), tmp_path / "check.csv", "{} pos", "{} torque", JOINTS, degree)
    run = tmp_path / "run"
    plain = ("identify", arm, train, "--validate", check, "--out", run, "--no-report")
    code, _, err = called(capsys, *plain, "--units", "deg")
    assert code == 0 and 'units = "deg" applies to the training recordings and also to check.csv' in " ".join(
        err.split()
    )
    assert called(capsys, "validate", run, check)[0] == 0
    code, _, err = called(capsys, "identify", arm, train, "--out", run, "--no-report", "--units", "deg")
    assert "reading-shared" not in err


def test_the_hint_has_the_options_that_read_the_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    arm, clock = write_arm(tmp_path), "Stempel 1"
    train, check = (
        as_table(small_recording(k), tmp_path / f"{k}.csv", "q{}", "tau{}", ("1", "2", "3")) for k in (1, 2)
    )
    for path in (train, check):
        path.write_text(path.read_text().replace("t [ms]", clock, 1))
    asked = ("identify", arm, train, "--validate", check, "--no-report", "--out", tmp_path / "run")
    code, _, err = called(capsys, *asked)
    hint = " ".join(err.split()).partition("hint: ")[2]
    options = shlex.split(hint.partition("; in a study")[0])
    assert code == 2 and options == ["--columns", f"time={clock}", "--time-unit", "0.001"]
    assert 'columns = { time = "Stempel 1" }' in hint  # the words of a study come after
    code, out, _ = called(capsys, "doctor", arm, train)
    assert code == 1 and shlex.join(options[:2]) in " ".join(re.sub("[│┃]", " ", out).split())
    assert called(capsys, *asked, *options)[0] == 0
    assert called(capsys, "doctor", arm, train, *options)[0] == 0
    # A run keeps the unit; another log of it may have its clock under another name.
    check.write_text(check.read_text().replace(clock, "Marke", 1))
    assert called(capsys, "validate", tmp_path / "run", check)[0] == 2
    assert called(capsys, "validate", tmp_path / "run", check, "--columns", "time=Marke")[0] == 0


@pytest.mark.parametrize("named", ['q="pos,1", "pos,2","pos,3"', 'q="pos,{}"'])
def test_names_with_commas_are_quoted(tmp_path: Path, capsys: pytest.CaptureFixture[str], named: str):
    arm = write_arm(tmp_path)
    path = as_table(small_recording(1), tmp_path / "log.csv", "pos,{}", "Last,{}", ("1", "2", "3"))
    code, out, _ = called(capsys, "doctor", arm, path, "--columns", named, "--json")
    (lacking,) = (f for f in json.loads(out)["findings"] if f["severity"] == "error")
    assert code == 1 and lacking["code"] == "effort-missing"
    option = as_option(lacking["remedy"])
    assert option is not None and '"Last,{}"' in option
    assert called(capsys, "doctor", arm, path, *shlex.split(option))[0] == 0
    code, _, err = called(capsys, "doctor", arm, path, "--columns", 'q="pos,1","pos,2')
    assert code == 2 and "double quotes" in err


def test_options_beside_a_study_are_refused_by_the_doctor(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    study = tmp_path / "study.toml"
    study.write_text('[robot]\ndescription = "panda"\n[[recording]]\npath = "a.csv"\n')
    code, _, err = called(capsys, "doctor", study, "--rate", "50")
    assert code == 2 and "options are only possible with an arm and recordings" in " ".join(err.split())
    code, _, err = called(capsys, "identify", study, "--columns", "q1")
    assert code == 2 and "--columns q1 does not begin with a quantity" in err
