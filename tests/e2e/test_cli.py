"""The command line as a user meets it: what it prints, writes, refuses, and how it ends."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from scipy.special import stdtrit

from armid.cli import main as cli
from armid.cli.console import print_findings, print_verdict, validation_table
from armid.cli.folder_overview import next_step
from armid.cli.parameter_tables import estimate_table, print_links
from armid.errors import Finding
from armid.estimation.catalogue import ESTIMATORS
from armid.excitation.fourier import save_plan
from armid.excitation.thesis_plans import builtin_plan
from armid.lab.inverse_dynamics_recording import Sensors, record, thesis_truth
from armid.measurement.processing.options import THESIS
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot import load_robot
from armid.runs.run import load_run
from armid.runs.validation_and_prediction import motion_of, predict
from armid.study.storage.records import BASE_PARAMETER_KEYS, ESTIMATE_KEYS
from armid.validation.prediction_interval import torque_band
from armid.validation.torque_validation import Score
from armid.validation.torque_validation import validate as judge
from command_line import Armid, Done, command_line, exit_code
from labs import (
    RUN_FILES,
    STUDY,
    small_folder,
    small_plan,
    small_recording,
    write_arm,
    write_recording,
    write_study,
)

HANGING = ("--gravity", "0", "0", "9.81")

COMMANDS = [str(command.callback.__name__) for command in cli.app.registered_commands if command.callback]


@pytest.fixture
def armid(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Armid:
    """Runs the command line in this process, in an empty folder, with nobody watching."""
    return command_line(capfd, monkeypatch, tmp_path)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small arm, two recordings and a study."""
    return small_folder(tmp_path_factory)


@pytest.fixture(scope="module")
def run(small: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the small arm's study."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    assert exit_code("identify", small / "study.toml", "--out", folder) == 0
    return folder


@pytest.fixture(scope="module")
def iiwa(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The virtual iiwa, hanging, on both motions of the thesis at 200 Hz, in three formats."""
    folder = tmp_path_factory.mktemp("iiwa")
    robot = load_robot("iiwa14-r820", gravity=(0.0, 0.0, 9.81))
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb()))
    for seed, (plan, suffix) in enumerate((("thesis-a1", ".csv"), ("thesis-a2", ".npz"))):
        motion = builtin_plan(plan).stretched(27.0)
        rng = np.random.default_rng(seed)
        recording, _, _ = record(model, thesis_truth(model), motion, Sensors(rate=200.0), rng)
        write_recording(recording, folder / f"{plan}{suffix}")
        write_recording(recording, folder / f"{plan}.parquet")
    return folder


def keys_of(table: dict[str, Any], *names: str) -> None:
    """Each of these keys is there; more may stand beside them."""
    assert set(names) <= set(table)


def only_faster(err: str) -> bool:
    """Tell whether nothing was noticed but repetitions, and that the second run is faster than the training."""
    found = re.findall(r"^(?:info|warning|error) (\S+)", err, re.M)
    beyond = re.search(r"^warning speed-beyond \S*run2\.csv", err.replace("\n", ""))
    return beyond is not None and found.count("speed-beyond") == 1 and set(found) <= {"speed-beyond", "period-found"}


# base ----------------------------------------------------------------------------------------------------------


def test_base_prints_groupings_as_the_field_writes_them(armid: Armid):
    done = armid("base", "iiwa14-r820", *HANGING)
    assert (done.code, done.err) == (0, "")
    lines = done.out.splitlines()
    assert lines[0].startswith(
        "iiwa14-r820: 57 base parameters (43 inertial + 14 friction) of 84 standard parameters, 11 of them without "
    )
    assert "  ZZR_1 = ZZ_1 + YY_2" in lines
    assert "  MYR_2 = MY_2 + MZ_3 + 0.2045 M_3 + 0.42 (M_4 + M_5 + M_6 + M_7)" in lines
    # Under each joint's number and name its groupings, and in one line what stands for itself.
    assert [line for line in lines if line[0].isdigit()] == [f"{j} A{j}" for j in range(1, 8)]
    assert not any(re.search(r"(\w+) = \1$", line) for line in lines) and "  FV_1, FS_1" in lines
    alone = [name for line in lines if line.startswith("  ") and " = " not in line for name in line.split(", ")]
    assert len(alone) + len([line for line in lines if " = " in line]) == 57


def test_base_columns_say_what_removed_columns_depend_on(armid: Armid):
    plain = armid("base", "iiwa14-r820", *HANGING).out
    done = armid("base", "iiwa14-r820", *HANGING, "--columns")
    assert done.out.startswith(plain) and "MZ_3" in done.out.removeprefix(plain)


def test_base_json_holds_the_contract(armid: Armid):
    found = armid("base", "iiwa14-r820", *HANGING, "--json").json
    keys_of(found, "count", "zero_columns", "removed", "dependencies", "base")
    assert (found["count"], len(found["zero_columns"]), len(found["removed"])) == (57, 11, 27)
    assert set(found["zero_columns"]) <= set(found["removed"])
    assert found["dependencies"]["MZ_3"]["MY_2"] == 1.0
    for each in found["base"]:
        keys_of(each, "name", "unit", "grouping", "formula")
    by_name = {each["name"]: each for each in found["base"]}
    assert by_name["ZZR_1"]["grouping"] == {"ZZ_1": 1.0, "YY_2": 1.0}


def test_base_in_latex(armid: Armid):
    out = armid("base", "iiwa14-r820", "--style", "latex").out
    assert r"ZZR_{1}" in out.replace("{R}", "R") or r"_{1}" in out
    assert len([line for line in out.splitlines() if "=" in line]) == 57 and "base parameters of" not in out


def test_gravity_and_locked_joints_change_what_is_seen(armid: Armid):
    count = {
        case: armid("base", "iiwa14-r820", *case, "--json").json["count"]
        for case in ((), HANGING, ("--gravity", "3", "0", "-9"), ("--gravity", "0", "0", "0"), ("--lock", "A7=0.5"))
    }
    assert count[()] == count[HANGING] == 57  # a sign
    assert count["--gravity", "3", "0", "-9"] == 59  # a tilted base weighs the first link
    assert count["--gravity", "0", "0", "0"] < 57
    assert count["--lock", "A7=0.5"] == 57 - 9  # a link of a wrist has seven parameters, its joint two


def test_terms_are_chosen_by_name(armid: Armid):
    found = armid("base", "iiwa14-r820", "--terms", "rigid-body, offset", "--json").json
    names = {each["name"] for each in found["base"]}
    assert "FO_1" in names and not any(name.startswith("FV") for name in names)


# identify ------------------------------------------------------------------------------------------------------


def test_identify_a_study(armid: Armid, small: Path, tmp_path: Path):
    done = armid("identify", small / "study.toml")
    assert done.code == 0 and only_faster(done.err)
    assert {path.name for path in (tmp_path / "runs" / "small").iterdir()} == RUN_FILES | {"report.html"}
    run = Path("runs") / "small"
    assert done.out.startswith("small: verdict on held-out motion: pass (3 of 3 checks passed)\n")
    words = (
        "24 base parameters, 15 inertial + 9 friction, by wls",
        "validation",
        "cover-",
        f"open {run / 'report.html'}\n",
    )
    assert all(each in done.out for each in words)
    assert "FV_1" not in done.out and "\x1b" not in done.out  # parameters are folded
    # Numbers of parameters meet names of joints in the table that everybody sees.
    assert all(re.search(rf"{j} │ joint_{j} ", done.out) for j in (1, 2, 3))
    told, _, following = done.out.rpartition("next:\n")
    assert f"run written to {run}\n" in told
    for command in ("export", "validate", "preview"):
        assert f"armid {command} {run}" in following


def test_identify_prints_parameters_under_their_joints_when_asked(armid: Armid, small: Path):
    done = armid("identify", small / "study.toml", "--verbose", "--no-report")
    for words in ("24 base parameters (15 inertial + 9 friction), wls", "95 % interval", "N·m·s/rad", "│ 2 joint_2 "):
        assert words in done.out
    assert (
        done.out.index("│ 2 joint_2")
        < done.out.index("FV_2")
        < done.out.index("│ 3 joint_3")
        < done.out.index("FV_3")
    )
    assert "report.html" not in done.out.partition("run written")[2] and "armid report runs/small" in done.out


def test_identify_prints_the_bodies_of_the_links_or_what_gives_them(armid: Armid, small: Path):
    done = armid("identify", small / "study.toml", "--method", "physical", "--no-report", "--out", "run")
    table = done.out.partition("Bodies of the links")[2]
    for link, mass in (("link_1", 3.0), ("link_2", 2.0), ("link_3", 1.0)):
        new = re.search(rf"│ {link} +│ new │ +([\d.]+)", table)
        assert new and 0.5 * mass < float(new[1]) < 2.0 * mass
    assert "inertia about the centre of mass" in table and table.count("old │") == 3 * table.count("┃ link ")
    kept = json.loads(Path("run/estimate.json").read_text(encoding="utf-8"))["links"]
    assert [each["joint"] for each in kept] == ["joint_1", "joint_2", "joint_3"]
    keys_of(kept[0], "link", "description", "estimate", "interval95", "reasons")
    whole = json.loads(Path("run/estimate.json").read_text(encoding="utf-8"))
    assert whole.keys() == ESTIMATE_KEYS.keys()
    base, standard = whole["base_parameters"], {each["name"]: each["value"] for each in whole["parameters"]}
    assert all(each.keys() == BASE_PARAMETER_KEYS.keys() for each in base)
    for each in base:  # a physical estimate has both, so that each base parameter is the sum that is stated
        total = sum(factor * standard[name] for name, factor in each["grouping"].items())
        assert total == pytest.approx(each["value"], rel=1e-9, abs=1e-9)  # rounding of sums of ten terms
    plain = armid("identify", small / "study.toml", "--no-report")
    assert "Bodies of" not in plain.out and "--method physical" in " ".join(plain.out.split())


@pytest.mark.parametrize("options", [(), ("--no-report",), ("--terms", "auto"), ("--method", "physical")])
def test_each_offered_next_command_works(armid: Armid, small: Path, tmp_path: Path, options: tuple[str, ...]):
    write_recording(small_recording(4), Path("other.csv"))
    arm = (small / "small.urdf", small / "run1.csv", "--validate", small / "run2.csv")
    done = armid("identify", *arm, *options, "--out", Path("runs") / "a run")  # with a blank in its name
    assert done.code == 0
    offered = [line.split("   ")[0].strip() for line in done.out.rpartition("next:\n")[2].splitlines()]
    consistent = bool({"physical", "auto"} & set(options))  # selected friction is estimated with consistent bodies
    assert len(offered) >= 3 and ("--to urdf" in " ".join(offered)) == consistent
    for command in offered:
        program, *words = shlex.split(command)
        assert program == "armid"
        assert armid(*("other.csv" if word == "RECORDING" else word for word in words)).code == 0, command
    if not consistent:  # what the line says of the other format holds, too
        assert "(--to urdf): bodies nearest to the description" in done.out
        written = armid("export", Path("runs") / "a run", "--to", "urdf", "--out", "nearest.urdf")
        assert written.code == 0 and "nearest to the description" in " ".join(written.err.split())
    assert all(armid(*shlex.split(line)[1:]).code == 0 for line in _offered_in(tmp_path))


def _offered_in(folder: Path) -> list[str]:
    """Commands that `armid` alone offers in a folder, but for those that need a recording."""
    lines = next_step(folder).splitlines()
    return [line.split("   ")[0].strip() for line in lines if line.startswith("  armid") and "RECORDING" not in line]


def test_a_failed_run_offers_the_doctor_with_the_options_of_reading(armid: Armid, small: Path):
    write_recording(small_recording(1), Path("log.csv"), clock=False)
    options = ("--rate", "50", "--torque-sign", "-1", "--lock", "joint_3=0.25", "--no-report")
    done = armid("identify", small / "small.urdf", "log.csv", *options)
    (line,) = [line.strip() for line in done.out.splitlines() if line.startswith("  armid doctor")]
    words = shlex.split(line.split("   ")[0])
    assert done.code == 1 and words[-6:] == ["--lock", "joint_3=0.25", "--rate", "50", "--torque-sign", "-1"]
    assert armid(*words[1:]).code == 1  # it reads the log, and finds the fault


def test_each_validation_recording_is_named(armid: Armid, small: Path):
    write_recording(small_recording(4), Path("other.csv"))
    options = ("--validate", small / "run2.csv", "other.csv", "--no-report")
    done = armid("identify", small / "small.urdf", small / "run1.csv", *options)
    flat = " ".join(done.out.split())
    assert "valid. 1: run2.csv, valid. 2: other.csv" in flat
    assert "are of the 2 validation recordings, the worst value of each joint" in flat


def test_identify_compares_every_method(armid: Armid, small: Path, tmp_path: Path):
    plain = armid("identify", small / "study.toml", "--out", tmp_path / "plain")
    done = armid("identify", small / "study.toml", "--compare", "--out", tmp_path / "run")
    assert (done.code, done.err) == (plain.code, plain.err) and plain.code == 0 and only_faster(plain.err)
    assert {path.name for path in (tmp_path / "run").iterdir()} == RUN_FILES | {"report.html", "compare.json"}
    table = done.out.split("Methods: torque error of all joints together, RMS in N·m")[1]
    for name in ESTIMATORS:
        (row,) = re.findall(rf"│ {name} +│(.*)", table)
        train, unseen = row.split("│")[:2]
        assert 0.0 < float(train) < 0.2 and 0.0 < float(unseen) < 0.2
    # The comparison adds to the run and changes nothing in it.
    a, b = (json.loads((tmp_path / name / "estimate.json").read_text()) for name in ("plain", "run"))
    assert a["base_parameters"] == b["base_parameters"] and a["method"] == "wls"


def test_compare_json_stands_in_the_object_and_in_the_run(armid: Armid, small: Path, tmp_path: Path):
    done = armid(
        "identify", small / "study.toml", "--compare", "--method", "ridge", "--json", "--out", tmp_path / "run"
    )
    assert done.code == 0 and "info prior-weight The prior towards the description counts as" in done.err
    found = done.json["compare"]
    assert found == json.loads((tmp_path / "run" / "compare.json").read_text())
    keys_of(found, "joints", "unseen", "methods", "seconds")
    assert (done.json["method"], found["unseen"]) == ("ridge", "validation")
    for each in found["methods"]:
        keys_of(
            each, "name", "training_rms", "unseen_rms", "consistent", "distance", "smallest_eigenvalue", "seconds"
        )
        assert each["failure"] is None and len(each["training_rms"]) == 3
    by_name = {each["name"]: each for each in found["methods"]}
    assert by_name["physical"]["consistent"] and by_name["physical"]["smallest_eigenvalue"] > 0.0
    np.testing.assert_allclose(by_name["ridge"]["training_rms"], done.json["residual"]["rms"])


def test_identify_json_is_one_object_with_the_contract(armid: Armid, small: Path):
    done = armid("identify", small / "study.toml", "--json")
    assert done.code == 0 and only_faster(done.err)
    found = done.json
    keys_of(found, "robot", "method", "terms", "base_parameters", "parameters", "residual", "condition")
    keys_of(found, "scaled_condition", "samples", "covariance", "certificate", "seconds", "warnings", "run")
    for each in found["base_parameters"]:
        keys_of(each, "name", "value", "unit", "deviation", "relative_deviation_percent", "interval95", "formula")
        assert each["interval95"][0] < each["value"] < each["interval95"][1]
    for each in found["parameters"]:
        keys_of(each, "name", "value", "unit", "interval95", "status")
    joints = ["joint_1", "joint_2", "joint_3"]
    assert found["terms"][2] == {"name": "coulomb", "joints": joints, "shapes": {"width": 0.02}}
    assert len(found["residual"]["rms"]) == 3 and found["robot"] == "small"
    kept = json.loads((Path(found["run"]) / "estimate.json").read_text(encoding="utf-8"))
    assert kept == {name: value for name, value in found.items() if name not in ("run", "validation")}


def test_identify_leaves_the_validation_of_the_contract(armid: Armid, small: Path):
    found = armid("identify", small / "study.toml", "--json").json
    kept = json.loads((Path(found["run"]) / "validation.json").read_text(encoding="utf-8"))
    assert kept == found["validation"]
    keys_of(kept, "joints", "recordings", "verdict", "checks")
    (each,) = kept["recordings"]
    keys_of(each, "path", "sha256", "rms", "rms_raw", "relative", "peak", "coverage95", "prior_rms")
    assert all(len(each[name]) == 3 for name in ("rms", "rms_raw", "relative", "peak", "coverage95", "prior_rms"))
    for check in kept["checks"]:
        keys_of(check, "name", "value", "bound", "ok")
    assert (each["path"], kept["verdict"]) == ("run2.csv", "pass")


@pytest.mark.parametrize("suffixes", [(".csv", ".npz"), (".parquet", ".parquet")])
def test_identify_an_arm_and_recordings(armid: Armid, iiwa: Path, suffixes: tuple[str, str]):
    train, unseen = iiwa / f"thesis-a1{suffixes[0]}", iiwa / f"thesis-a2{suffixes[1]}"
    done = armid("identify", "iiwa14-r820", train, "--validate", unseen, *HANGING, "--json", "--out", "today")
    found = done.json
    assert (done.code, found["run"], len(found["base_parameters"])) == (0, "today", 64)
    values = {each["name"]: each["value"] for each in found["base_parameters"]}
    assert values["MYR_2"] == pytest.approx(3.9695, abs=0.05)
    assert values["FV_1"] == pytest.approx(28.404, rel=0.05)
    assert found["validation"]["verdict"] == "pass"


def test_several_recordings_validate_behind_one_option(armid: Armid, small: Path):
    write_recording(small_recording(3), Path("run3.csv"))
    done = armid(
        "identify", small / "small.urdf", small / "run1.csv", "--validate", small / "run2.csv", "run3.csv", "--json"
    )
    assert [Path(each["path"]).name for each in done.json["validation"]["recordings"]] == ["run2.csv", "run3.csv"]


def test_without_unseen_motion_left_out_parts_are_judged(armid: Armid, small: Path):
    done = armid("identify", small / "small.urdf", small / "run1.csv")
    assert done.code == 0 and "verdict on left-out parts of the training data: pass" in done.out
    words = " ".join(done.out.split())
    assert "--validate RECORDING" in words and "expected on another recording of such a motion: RMS error" in words


def test_options_of_reading_and_processing_arrive(armid: Armid, small: Path):
    log = small_recording(1)
    assert log.effort is not None
    turned = replace(log, q=np.degrees(log.q), effort=-log.effort)
    write_recording(turned, Path("run.csv"), clock=False)
    plain = armid("identify", small / "small.urdf", small / "run1.csv", "--cutoff", 4, "--json").json
    done = armid(
        "identify", small / "small.urdf", "run.csv", "--rate", 100, "--units", "deg", "--torque-sign", -1,
        "--period", 8, "--cutoff", 4, "--edges", "drop", "--method", "ols", "--terms", "rigid-body,viscous,coulomb",
        "--threads", 2, "--json", "--out", "here",
    )  # fmt: skip
    assert done.code == 0
    assert [each["name"] for each in done.json["terms"]] == ["rigid-body", "viscous", "coulomb"]
    kept = json.loads(Path("here/study.json").read_text())
    assert kept["processing"]["cutoff"] == 4.0 and done.json["method"] == "ols"
    value = {each["name"]: each["value"] for each in plain["base_parameters"]}
    found = {each["name"]: each["value"] for each in done.json["base_parameters"]}
    assert found["MZ_3"] == pytest.approx(value["MZ_3"], rel=0.01)
    assert found["FV_2"] == pytest.approx(value["FV_2"], rel=0.05)


def test_an_earlier_run_is_kept_unless_its_folder_is_named(armid: Armid, small: Path):
    command = ("identify", small / "small.urdf", small / "run1.csv", "--no-report")
    first = armid(*command)
    kept = Path("runs/small/estimate.json").read_bytes()
    second = armid(*command)
    assert f"run written to {Path('runs') / 'small'}\n" in first.out
    assert f"run written to {Path('runs') / 'small-2'}\n" in second.out
    assert Path("runs/small/estimate.json").read_bytes() == kept
    third = armid(*command, "--out", "runs/small")
    assert f"run written to {Path('runs') / 'small'}, replacing the earlier run there\n" in third.out


def test_the_preset_processes_and_estimates_as_the_thesis_does(armid: Armid, small: Path):
    done = armid("identify", small / "small.urdf", small / "run1.csv", "--preset", "thesis", "--period", 8, "--json")
    assert done.code == 1 and done.json["method"] == "ols"
    assert "one-sided-filter" in {each["code"] for each in done.json["warnings"]}  # why the verdict is `fail`
    assert [(each["name"], each["shapes"]) for each in done.json["terms"]] == [
        ("rigid-body", {}),
        ("viscous", {}),
        ("coulomb", {"width": 0.0}),
    ]
    kept = json.loads(Path("runs/small/study.json").read_text())["processing"]
    assert (kept["order"], kept["columns"], kept["average"]) == (THESIS.order, False, True)
    done = armid("identify", small / "small.urdf", small / "run1.csv", "--preset", "thesis", "--edges", "pad")
    kept = json.loads(Path("runs/small-2/study.json").read_text())["processing"]
    assert done.code == 1 and (kept["edges"], kept["average"]) == ("pad", False)


def test_what_the_command_line_says_of_a_study_holds(armid: Armid, small: Path):
    write_recording(small_recording(3), Path("run3.csv"))
    done = armid(
        "identify", small / "study.toml", "--terms", "rigid-body,viscous,coulomb", "--gravity", 0, 0, -9.8,
        "--validate", "run3.csv", "--json",
    )  # fmt: skip
    assert done.code == 0
    assert [each["name"] for each in done.json["terms"]] == ["rigid-body", "viscous", "coulomb"]
    assert [Path(each["path"]).name for each in done.json["validation"]["recordings"]] == ["run2.csv", "run3.csv"]
    assert json.loads(Path("runs/small/study.json").read_text())["robot"]["gravity"] == [0.0, 0.0, -9.8]


def test_friction_of_each_recording_has_rows_of_its_own(armid: Armid, small: Path):
    text = STUDY.replace('role = "validate"', "") + "[estimation]\nfriction_per_recording = true\n"
    for name in ("small.urdf", "run1.csv", "run2.csv"):
        shutil.copy(small / name, name)
    done = armid("identify", write_study(Path("."), text), "--verbose")
    assert done.code == 0 and "FV_1[1]" in done.out and "FS_3[2]" in done.out and "\\[" not in done.out


def test_a_failed_verdict_is_exit_code_1_and_the_run_is_there(armid: Armid, small: Path):
    log = small_recording(2)
    assert log.effort is not None
    write_recording(replace(log, effort=3.0 * log.effort), Path("heavy.csv"))
    done = armid("identify", small / "small.urdf", small / "run1.csv", "--validate", "heavy.csv")
    assert done.code == 1 and "verdict on held-out motion: fail" in done.out and "armid doctor" in done.out
    assert {path.name for path in Path("runs/small").iterdir()} == RUN_FILES | {"report.html"}
    found = armid("identify", small / "small.urdf", small / "run1.csv", "--validate", "heavy.csv", "--json")
    assert found.code == 1 and found.json["validation"]["verdict"] == "fail"


def test_findings_go_to_standard_error(armid: Armid, small: Path):
    log = small_recording(1)
    assert log.time is not None
    write_recording(replace(log, time=log.time + 2e-3 * np.sin(log.time)), Path("jittered.csv"))
    for more in ((), ("--json",)):
        done = armid("identify", small / "small.urdf", "jittered.csv", *more)
        assert done.code == 0 and "\ninfo clock-jitter " in done.err and "clock-jitter " not in done.out[:20]


def test_an_arm_with_an_unruly_name_writes_where_it_should(armid: Armid, small: Path, tmp_path: Path):
    text = (small / "small.urdf").read_text().replace('name="small"', 'name="../my arm"')
    Path("arm.urdf").write_text(text)
    done = armid("identify", "arm.urdf", small / "run1.csv")
    assert done.code == 0 and (tmp_path / "runs" / "my-arm" / "estimate.json").is_file()


# validate and predict --------------------------------------------------------------------------------------------


def test_validate_a_run(armid: Armid, run: Path, small: Path):
    done = armid("validate", run, small / "run2.csv")
    assert done.code == 0 and "validation" in done.out and "train " not in done.out
    assert only_faster(done.err)
    found = armid("validate", run, small / "run2.csv", "--json").json
    keys_of(found, "joints", "recordings", "verdict", "checks")
    kept = json.loads((run / "validation.json").read_text(encoding="utf-8"))
    assert found["recordings"][0]["rms"] == pytest.approx(kept["recordings"][0]["rms"], rel=1e-12)


def test_validate_with_another_sign_fails(armid: Armid, run: Path, small: Path):
    done = armid("validate", run, small / "run2.csv", "--torque-sign", -1)
    assert done.code == 1 and "fail" in done.out


def test_validate_refuses_what_trained_the_run(armid: Armid, run: Path, small: Path):
    copy = shutil.copy(small / "run1.csv", "copy.csv")
    assert_refused(armid("validate", run, copy), "trained on the same data", "was not used for training")


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_predict_along_a_plan(armid: Armid, run: Path, suffix: str):
    plan = small_plan(4)
    save_plan(plan, "plan.json")
    done = armid("predict", run, "plan.json", "--out", f"torque{suffix}", "--plan-rate", 50)
    assert (done.code, done.out) == (0, f"400 samples of 3 joints written to torque{suffix}\n")
    expected = predict(load_run(run), plan.sample(50.0))
    if suffix == ".csv":
        found = np.loadtxt("torque.csv", delimiter=",", skiprows=1)[:, 1:]
    else:
        with np.load("torque.npz") as archive:
            found = archive["torque"]
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_predict_with_its_band(armid: Armid, run: Path, small: Path, suffix: str):
    found = armid("predict", run, small / "run2.csv", "--band", "--out", f"torque{suffix}", "--json").json
    if suffix == ".csv":
        assert Path("torque.csv").read_text().startswith("t,tau1,tau2,tau3,band95_1,band95_2,band95_3\n")
        torque, band = np.split(np.loadtxt("torque.csv", delimiter=",", skiprows=1)[:, 1:], 2, axis=1)
    else:
        with np.load("torque.npz") as archive:
            torque, band = archive["torque"], archive["band95"]
    loaded = load_run(run)
    motion, _ = motion_of(loaded, str(small / "run2.csv"), rate=100.0, reading={})
    np.testing.assert_array_equal(torque, predict(loaded, motion))
    np.testing.assert_array_equal(band, torque_band(loaded.model, loaded.estimate, motion))
    np.testing.assert_allclose(found["band95"], np.median(band, axis=0))


def test_predict_along_a_recording(armid: Armid, run: Path, small: Path):
    found = armid("predict", run, small / "run2.csv", "--json").json
    assert found["samples"] == 1600 and found["path"] == "torque.csv"
    measured = small_recording(2).effort
    assert measured is not None
    torque = np.loadtxt("torque.csv", delimiter=",", skiprows=1)[:, 1:]
    inner = slice(100, -100)
    error = np.sqrt(np.mean((torque[inner] - measured[inner]) ** 2, axis=0))
    assert (error < 0.1).all()  # a fiftieth of the torque: the sensor's noise and what the filter rounds off


def test_predict_does_not_overwrite_the_motion(armid: Armid, run: Path, small: Path):
    shutil.copy(small / "run2.csv", "torque.csv")
    before = Path("torque.csv").read_bytes()
    assert_refused(armid("predict", run, "torque.csv"), "this file is the motion", "--out")
    assert Path("torque.csv").read_bytes() == before


# demo and bench --------------------------------------------------------------------------------------------------


@pytest.fixture
def slow_sensors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sensors of 400 Hz instead of 8 kHz: the same demo in a twentieth of the time."""
    monkeypatch.setattr("armid.study.demo.Sensors", lambda: Sensors(rate=400.0))


@pytest.mark.usefixtures("slow_sensors")
def test_demo(armid: Armid):
    done = armid("demo", "--json", "--seed", 3)
    found = done.json
    assert (done.code, found["run"], found["validation"]["verdict"]) == (0, str(Path("runs") / "demo"), "pass")
    keys_of(found, "base_parameters", "residual", "condition", "warnings", "truth")
    keys_of(found["truth"], "base_parameters", "relative_error", "torque_error")
    assert len(found["truth"]["base_parameters"]) == len(found["base_parameters"]) == 57
    assert found["truth"]["relative_error"] < 0.01
    shown = armid("demo", "--seed", 3, "--out", "there")
    assert shown.code == 0 and "error against the true values: base parameters" in shown.out
    told = {each["code"] for each in found["warnings"] if each["severity"] == "warning"}
    assert told == set(re.findall(r"^warning (\S+)", shown.err, re.MULTILINE))
    assert {path.name for path in Path("there").iterdir()} == RUN_FILES | {"report.html", "demo.json"}


@pytest.mark.usefixtures("slow_sensors")
def test_demo_as_the_thesis_does_it(armid: Armid):
    found = armid("demo", "--json", "--preset", "thesis").json
    assert found["method"] == "ols" and 0.04 < found["truth"]["relative_error"] < 0.06


# Bad input -------------------------------------------------------------------------------------------------------


def assert_refused(done: Done, problem: str, help: str = "") -> None:
    """Exit code 2 and one message on standard error, and nothing on standard output unless JSON is asked for."""
    err = " ".join(done.err.split())
    assert done.code == 2
    if done.out:
        assert set(done.json) == {"error", "possible", "remedy", "exit_code"} and done.json["exit_code"] == 2
        assert problem in f"{done.json['error']} {done.json['possible']} {done.json['remedy']}"
    assert err.startswith("error ") and err.count("error ") == 1
    assert problem in err and help in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("arguments", "problem", "help"),
    [
        (("base", "iwa14-r820"), "no robot description 'iwa14-r820'", "did you mean 'iiwa14-r820'?"),
        (("base", "iiwa14-r820", "--lock", "A9"), "has no joint 'A9' to lock", "A1, A2, A3, A4, A5, A6, A7"),
        (("base", "iiwa14-r820", "--lock", "A1=up"), "'up' is not a number", "--lock JOINT=VALUE"),
        (("base", "iiwa14-r820", "--terms", "magic"), "Unknown torque term 'magic'", "viscous"),
        (("base", "iiwa14-r820", "--terms", ","), "--terms is given without the name of a term", "rigid-body"),
        (("identify", "nowhere.toml"), "nowhere.toml cannot be read", "give the path of a study.toml"),
        (("identify", "{small}/run1.csv"), "not a study", "an arm followed by its recordings"),
        (("identify", "iiwa14-r820", "nowhere.csv"), "nowhere.csv does not exist", "check the path"),
        (("identify", "iiwa14-r820", "{small}/run1.csv"), "3 channels; iiwa14-r820 has 7 joints", "joints = ["),
        (("identify", "{small}/study.toml", "--rate", "3"), "but --rate was given", "[[recording]]"),
        (("identify", "{small}/study.toml", "--edges", "cut"), "edges = 'cut' is not known", "drop, periodic, pad"),
        (("identify", "{small}/study.toml", "--cutoff", "low"), "--cutoff low is not a frequency", "auto"),
        (("identify", "{small}/study.toml", "--method", "magic"), "Unknown estimation method 'magic'", "ols, wls"),
        (
            ("identify", "{small}/study.toml", "--validate", "{small}/run1.csv"),
            "contain the same data",
            "part = [0.0",
        ),
        (("identify", "{small}/study.toml", "--validate", "no.csv"), "no.csv does not exist", ""),
        (("identify", "{small}/study.toml", "--out", "{small}"), "is not a run of armid", "--out"),
        (("identify", "{small}/study.toml", "--out", "{small}/run1.csv/x"), "is a file", "--out"),
        (("identify", "{small}/small.urdf", "{small}/run1.csv", "--units", "grad"), "units = 'grad'", "rad, deg"),
        (("identify", "{small}/small.urdf", "{small}/run1.csv", "--torque-sign", "3"), "torque_sign = 3", "1, -1"),
        (("validate", "nowhere", "{small}/run2.csv"), "nowhere is not a run of armid", "armid identify"),
        (("validate", "{run}", "nowhere.csv"), "nowhere.csv does not exist", ""),
        (("predict", "{run}", "thesis-a1"), "thesis-a1 moves 7 joints, but small has 3", ""),
        (("predict", "{run}", "nowhere.json"), "nowhere.json cannot be read as a plan", ""),
        (("predict", "{run}", "{small}/run2.csv", "--out", "torque.xls"), "neither .csv nor .npz", "suffixes"),
        (("predict", "{run}", "{small}/run2.csv", "--out", "{small}/run1.csv/t.csv"), "could not be written", ""),
        (("demo", "--edges", "cut", "--preset", "thesis"), "edges = 'cut' is not known", "pad"),
    ],
)
def test_bad_input_is_one_message(
    armid: Armid, small: Path, run: Path, tmp_path: Path, arguments: tuple[str, ...], problem: str, help: str
):
    for more in ((), ("--json",)):
        done = armid(*(argument.format(small=small, run=run) for argument in arguments), *more)
        assert_refused(done, problem, help)
        assert bool(done.out) is bool(more)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [("identify",), ("nonsense",), ("base", "--nonsense"), ("base", "x", "--gravity", "1"), ("bench", "7")],
)
def test_a_wrong_command_line_is_exit_code_2(armid: Armid, arguments: tuple[str, ...]):
    done = armid(*arguments)
    assert (done.code, done.out) == (2, "") and done.err and "Traceback" not in done.err
    as_json = armid(*arguments, "--json")
    assert as_json.code == 2 and as_json.json.keys() == {"error", "possible", "remedy", "exit_code"}
    assert as_json.json["exit_code"] == 2 and "--help" in as_json.json["remedy"]
    assert as_json.json["error"].rstrip(".") in " ".join(as_json.err.replace("│", " ").split())


def test_data_that_do_not_determine_the_parameters_are_refused(armid: Armid, small: Path):
    """The last joint stands still all along."""
    log = small_recording(1)
    q = log.q.copy()
    q[:, 2] = 0.5
    write_recording(replace(log, q=q), Path("still.csv"))
    done = armid("identify", small / "small.urdf", "still.csv")
    assert_refused(done, "they do not determine", "moves the joints")
    assert "FV_3, FS_3" in done.err and not Path("runs").exists()


def test_one_sample_is_refused(armid: Armid, small: Path):
    Path("one.csv").write_text("t,q1,q2,q3,tau1,tau2,tau3\n0,1,2,3,4,5,6\n")
    assert_refused(armid("identify", small / "small.urdf", "one.csv"), "one.csv")


def test_ctrl_c_leaves_nothing_behind(armid: Armid, small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def stopped(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    for where in (
        "armid.study.prepare.build_problem",
        "armid.study.identify.validate",
        "armid.runs.run.replace_file",
    ):
        with monkeypatch.context() as patch:
            patch.setattr(where, stopped)
            done = armid("identify", small / "study.toml", "--out", "run")
        assert (done.code, done.out, done.err) == (130, "", "interrupted; nothing was written\n"), where
        assert list(tmp_path.iterdir()) == []


# How it looks ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(armid: Armid, command: str):
    for flag in ("--help", "-h"):
        done = armid(command, flag)
        assert (done.code, done.err) == (0, "")
        assert "Example" in done.out and f"armid {command}" in done.out
        assert not re.search(r"[a-z] [.,] ", done.out)  # a unit in brackets would be taken for markup


def test_help_lists_every_command(armid: Armid):
    done = armid("--help")
    assert done.code == 0 and {"base", "identify", "validate", "predict", "demo", "bench"} <= set(COMMANDS)
    for command in COMMANDS:
        assert f" {command} " in done.out
    bare = armid()
    assert bare.code == 0 and "armid demo" in bare.out and "armid --help" in bare.out


def test_tables_fit_a_narrow_terminal(run: Path):
    loaded = load_run(run)
    screen = StringIO()
    console = Console(file=screen, width=80, highlight=False)
    console.print(estimate_table(loaded.estimate, loaded.robot.joint_names))
    print_links(console, loaded.links)
    for count in (1, 2, 9):
        scores = [Score("unseen.csv", "", *(np.array([12.3456, 0.1, 1.0]),) * 6) for _ in range(count)]
        judged = judge(loaded.robot.joint_names, scores, loaded.estimate)
        console.print(validation_table(judged, scores[:1], ["N·m"] * 3))
        print_verdict(console, judged)
    text = screen.getvalue()
    assert "…" not in text.replace(" … ", "")  # between the ends of intervals, and nowhere cut off
    assert all(text.count(word) >= 3 for word in ("valid", "URDF", "torque", "peak", "cover-")) and "runs" in text


def test_values_are_shown_as_finely_as_they_are_known(armid: Armid, run: Path, small: Path):
    """Two digits of the interval's half width, three decimals at least."""
    out = armid("identify", small / "study.toml", "--verbose").out
    cells = [[cell.strip() for cell in line.split("│")[1:-1]] for line in out.splitlines() if line.startswith("│")]
    rows = {row[0]: row for row in cells}
    estimate = load_run(run).estimate
    for k, name in enumerate(estimate.fit.names):
        _, value, _, relative, interval = rows[name]
        decimals = len(value.split(".")[1])
        low, high = estimate.intervals[k]
        digits = 0.5 * (high - low) * 10.0**decimals
        assert 9.4 <= digits < 100 or (decimals == 3 and digits >= 10), name
        assert float(value) == round(float(estimate.fit.values[k]), decimals)
        assert [float(end) for end in interval.split(" … ")] == [round(low, decimals), round(high, decimals)]
        percent = 50.0 * (high - low) / stdtrit(estimate.fit.freedom[k], 0.975) / abs(estimate.fit.values[k])
        shown = relative.rstrip("* ")
        assert percent >= 1000.0 if shown == "> 999" else float(shown) == pytest.approx(percent, abs=0.00501), name
        assert relative.endswith("*") == bool(estimate.fit.poorly_identified[k])


def test_the_command_line_starts_without_heavy_packages():
    script = "import armid.cli.main, sys; print(*sorted({'numpy', 'scipy', 'rich', 'pinocchio'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


# As a program ----------------------------------------------------------------------------------------------------


def program(*arguments: object, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from armid.cli.main import main; main()", *map(str, arguments)]
    clean = {name: value for name, value in os.environ.items() if name not in ("FORCE_COLOR", "COLUMNS")}
    return subprocess.run(
        command, capture_output=True, encoding="utf-8", cwd=cwd, env=clean | environment, timeout=120, check=False
    )


def test_in_a_pipe_there_are_neither_colours_nor_bars(small: Path, tmp_path: Path):
    done = program("identify", small / "study.toml", cwd=tmp_path)
    assert done.returncode == 0 and only_faster(done.stderr)
    assert "\x1b" not in done.stdout + done.stderr and "\r" not in done.stdout and "run written to" in done.stdout


@pytest.mark.parametrize(("columns", "width"), [("60", 60), ("200", 200), ("wide", 120)])
def test_the_width_that_is_asked_for_holds_in_a_pipe(small: Path, tmp_path: Path, columns: str, width: int):
    done = program("doctor", small / "study.toml", cwd=tmp_path, COLUMNS=columns)
    long = program("identify", tmp_path / ("nowhere" * 40), cwd=tmp_path, COLUMNS=columns).stderr
    assert max(map(len, done.stdout.splitlines())) <= width
    assert max(map(len, long.splitlines())) in range(width - 12, width + 1)


def test_the_program_ends_with_the_code_of_its_verdict_or_error(run: Path, small: Path, tmp_path: Path):
    assert program("validate", run, small / "run2.csv", "--json", cwd=tmp_path).returncode == 0
    assert program("validate", run, small / "run2.csv", "--torque-sign", -1, cwd=tmp_path).returncode == 1
    done = program("validate", run, "nowhere.csv", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "") and done.stderr.startswith("error nowhere.csv does not exist.")


def test_a_terminal_without_greek_letters_is_no_reason_to_fail(run: Path, small: Path, tmp_path: Path):
    done = program("identify", small / "study.toml", cwd=tmp_path, PYTHONIOENCODING="ascii")
    assert done.returncode == 0 and "run written to" in done.stdout


def test_the_arm_of_a_study_may_be_anywhere(small: Path, tmp_path: Path):
    """A study beside its data, called from another folder by a relative path."""
    write_arm(tmp_path)
    done = program("identify", os.path.relpath(small / "study.toml", tmp_path), "--json", cwd=tmp_path)
    assert done.returncode == 0 and json.loads(done.stdout)["validation"]["verdict"] == "pass"


def test_findings_are_told_once_and_the_worst_first_and_shapes_to_who_plans(capsys: pytest.CaptureFixture[str]):
    note = Finding("clock-gap", "info", "", "a gap")
    found = [note, Finding("mesh-missing", "warning", "", "no mesh"), note, Finding("degrees", "error", "", "far")]
    print_findings(found)
    assert [line.split()[1] for line in capsys.readouterr().err.splitlines()] == ["degrees", "clock-gap"]
    print_findings(found, shapes=True)
    assert [line.split()[1] for line in capsys.readouterr().err.splitlines()] == [
        "degrees",
        "mesh-missing",
        "clock-gap",
    ]
