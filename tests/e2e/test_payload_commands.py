"""`armid payload` and `armid recalibrate` as a user meets them, on a small simulated arm."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.estimation.update.payload import LOAD_NAMES
from armid.export.types import rpy_of
from armid.lab.inverse_dynamics_recording import record
from armid.maths.inertia import about_com, com_inertia_to_vector, transform
from armid.maths.rotations import rpy_rotation
from armid.measurement.recording import Recording
from armid.runs.payload import NOTHING
from armid.runs.run import load_run, only_drive_gains_failed, save_run
from armid.study.config import RecordingChoice, load_study
from armid.study.identify import identify
from armid.study.recordings.processed import process_each
from armid.study.recordings.reading import read_choice
from armid.study.score_recordings import score_recordings
from command_line import Armid, command_line
from controller_files import read_kuka, read_ur
from labs import (
    FRICTION,
    KNOWN_FRICTION,
    SENSORS,
    small_model,
    small_plan,
    small_truth,
    write_arm,
    write_recording,
    write_study,
)

GAIN = np.array([10.0, 12.0, 8.0])
CORRECTION = np.array([0.06, -0.05, 0.08])
LOAD = com_inertia_to_vector(0.8, np.array([0.05, 0.02, 0.1]), np.diag([0.004, 0.005, 0.003]))

WIDE = "the deviation of the drive gains, 10 %, widens the intervals ("

CURRENT = """columns = { effort = "i{}" }
drive_gain = [10.0, 12.0, 8.0]
drive_gain_deviation = 0.1"""


def recorded(
    seed: int, *, load: bool = False, link: int = 3, friction: float = 1.0, still: tuple[int, ...] = ()
) -> Recording:
    """The small arm, with a load on one of its links and so many times its friction; some joints may stand still."""
    model, theta = small_model(), small_truth()
    plan = small_plan(seed)
    a, b = np.array(plan.a), np.array(plan.b)
    a[list(still)] = b[list(still)] = 0.0
    if load:
        theta[model.inertial_columns.reshape(-1, 10)[link - 1]] += LOAD
    for k, parameter in enumerate(model.parameters):
        theta[k] *= friction if parameter.symbol in FRICTION else 1.0
    return record(model, theta, replace(plan, a=a, b=b), SENSORS, np.random.default_rng(seed), repetitions=2)[0]


def write_currents(recording: Recording, path: Path) -> Path:
    """With what the motors' currents would be, the gains not being what is said of them."""
    assert recording.time is not None and recording.effort is not None
    current = recording.effort / (GAIN * (1.0 + CORRECTION))
    columns = {"t": recording.time}
    for name, values in (("q", recording.q), ("i", current)):
        columns |= {f"{name}{j + 1}": values[:, j] for j in range(3)}
    np.savez(path, **columns)  # pyright: ignore[reportArgumentType]
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The arm, a run from torques, another from currents, and recordings with a load and with less friction."""
    folder = tmp_path_factory.mktemp("arm")
    write_arm(folder)
    write_recording(recorded(1), folder / "free.npz")
    write_recording(recorded(2, load=True), folder / "loaded.npz")
    write_recording(recorded(8), folder / "without.npz")
    write_recording(recorded(6, load=True, still=(0, 1)), folder / "turning.npz")
    write_recording(recorded(7, load=True, link=2), folder / "elsewhere.npz")
    write_recording(recorded(3, friction=0.6), folder / "warm.npz")
    write_recording(recorded(4, friction=0.6), folder / "later.npz")
    write_recording(recorded(5, load=True, friction=0.6), folder / "tool.npz")
    write_study(folder, KNOWN_FRICTION.format(log="free.npz"))
    currents = folder / "currents"
    currents.mkdir()
    write_arm(currents)
    write_currents(recorded(1), currents / "free.npz")
    write_currents(recorded(2, load=True), currents / "loaded.npz")
    write_currents(recorded(7, load=True, link=2), currents / "elsewhere.npz")
    write_study(currents, KNOWN_FRICTION.format(log="free.npz") + CURRENT)
    for place in (folder, currents):
        save_run(identify(load_study(place / "study.toml")), place / "run")
    return folder


@pytest.fixture
def armid(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, folder: Path) -> Armid:
    """Runs the command line in this process, with nobody watching."""
    return command_line(capfd, monkeypatch, folder)


def parameters(record: Any) -> dict[str, Any]:
    return {each["name"]: each for each in record["parameters"]}


def test_a_load_as_json(armid: Armid, tmp_path: Path):
    code, out, _ = armid("payload", "run", "loaded.npz", "--json", "--out", tmp_path / "load")
    assert code == 0
    record = json.loads(out)
    assert record == json.loads((tmp_path / "load" / "payload.json").read_text())
    assert record["robot"] == "small" and record["link"] == "link_3" and record["gains"] is None
    found = parameters(record)
    assert sorted(found) == sorted(LOAD_NAMES)
    for k, name in enumerate(LOAD_NAMES):
        each = found[name]
        assert each["status"] in ("identified", "prior-dominated", "not identifiable")
        assert each["value"] == pytest.approx(LOAD[k], abs=0.03)
    held = [low <= LOAD[k] <= high for k in range(10) for low, high in [found[LOAD_NAMES[k]]["interval95"]]]
    assert sum(held) >= 8  # of ten 95 % intervals
    assert found["M"]["status"] == "identified"
    assert found["M"]["value"] == record["mass"]["value"] == pytest.approx(LOAD[0], rel=0.02)
    np.testing.assert_allclose(record["com"]["value"], LOAD[1:4] / LOAD[0], atol=0.005)
    inertia = np.array(record["inertia_about_com"])
    assert np.linalg.eigvalsh(inertia)[0] >= 0.0
    ends = record["inertia_about_com_interval95"]
    assert all(ends[pair][0] <= inertia["xyz".index(pair[0]), "xyz".index(pair[1])] <= ends[pair][1] for pair in ends)
    assert sorted(ends) == ["xx", "xy", "xz", "yy", "yz", "zz"]
    assert [each["path"] for each in record["recordings"]] == [str((Path("loaded.npz")).absolute())]


def test_a_load_is_written_for_controllers(armid: Armid, tmp_path: Path):
    out = tmp_path / "load"
    code, text, err = armid(
        "payload", "run", "loaded.npz", "--to", "ur,kuka", "--to", "fanuc", "--out", out, "--json"
    )
    assert code == 0 and "was not tried" not in err
    record = json.loads(text)
    assert record == json.loads((out / "payload.json").read_text())
    assert list(record["controllers"]) == ["ur", "kuka", "fanuc"]
    found = parameters(record)
    values = np.array([found[name]["value"] for name in LOAD_NAMES])
    files = {path.name: path.read_text() for path in out.iterdir()}
    np.testing.assert_allclose(read_ur(files), values, atol=1e-12)  # the tip frame is the flange
    np.testing.assert_allclose(read_kuka(files), values, atol=1e-7)  # angles with nine digits
    numbers = {each["name"]: each for each in record["controllers"]["ur"]["numbers"]}
    assert numbers["m"]["interval95"] == record["mass"]["interval95"]
    for axis, ends in zip("xyz", record["com"]["interval95"], strict=True):
        assert numbers[f"CoG{axis}"]["interval95"] == pytest.approx(ends)
    for pair, ends in record["inertia_about_com_interval95"].items():
        assert numbers[f"I{pair}"]["interval95"] == pytest.approx(ends)
    held = [low <= x <= high for x, (low, high) in ((n["value"], n["interval95"]) for n in numbers.values())]
    assert all(held)


def test_a_stored_load_is_converted(armid: Armid, tmp_path: Path):
    at_once, later = tmp_path / "at_once", tmp_path / "later"
    armid("payload", "run", "loaded.npz", "--to", "abb,franka", "--out", at_once)
    code, _, err = armid("payload", at_once / "payload.json", "--to", "abb", "--mass", 3.0)
    assert code == 2 and "no effect when a stored payload.json is converted" in " ".join(err.split())
    code, out, _ = armid("payload", at_once / "payload.json", "--to", "abb,franka", "--out", later)
    assert code == 0 and "none of these forms was tried on a robot" in out
    for name in ("load_abb.mod", "franka/armid_set_load.hpp", "franka/endeffector-config.json"):
        assert (later / name).read_text() == (at_once / name).read_text()
    code, out, _ = armid("payload", at_once, "--to", "xarm", "--json")
    assert code == 0 and (at_once / "load_xarm.py").is_file()
    assert json.loads(out)["controllers"]["xarm"]["findings"][0]["code"] == "inertia-not-written"


FRAMES = """
  <link name="flange"/>
  <joint name="to_flange" type="fixed"><parent link="link_3"/><child link="flange"/>
    <origin xyz="0.01 0 0.05" rpy="0 0.5 0"/></joint>
  <link name="tool0"/>
  <joint name="to_tool0" type="fixed"><parent link="flange"/><child link="tool0"/>
    <origin xyz="0 0.02 0.1" rpy="0.3 0 1"/></joint>
</robot>"""


def test_another_frame_of_the_description_is_the_flange(armid: Armid, folder: Path, tmp_path: Path):
    """By name and by numbers; the tip frame is another one."""
    arm = write_arm(tmp_path)
    arm.write_text(arm.read_text().replace("</robot>", FRAMES))
    study = KNOWN_FRICTION.format(log=folder / "free.npz")
    write_study(tmp_path, study.replace('description = "small.urdf"', 'description = "small.urdf"\ntip = "tool0"'))
    save_run(identify(load_study(tmp_path / "study.toml")), tmp_path / "run")
    code, out, _ = armid("payload", tmp_path / "run", folder / "loaded.npz", "--to", "ur", "--out", tmp_path)
    assert code == 0 and "frame tool0 of the description (the tip frame)" in out
    record = json.loads((tmp_path / "payload.json").read_text())
    assert (record["link"], record["frame"], record["tip"]["name"]) == ("link_3", "tool0", "tool0")

    def written() -> Any:
        return read_ur({"load_ur.script": (tmp_path / "load_ur.script").read_text()})

    found = parameters(record)
    np.testing.assert_allclose(written(), [found[name]["value"] for name in LOAD_NAMES], atol=1e-12)
    turn, place = rpy_rotation([0.0, 0.5, 0.0]), np.array([0.01, 0.0, 0.05])
    in_link = np.array([found[name]["in_link"] for name in LOAD_NAMES])
    at_flange = transform(in_link, turn.T, -turn.T @ place)
    code, out, _ = armid("payload", tmp_path, "--to", "ur", "--flange", "flange")
    assert code == 0 and "frame flange of the description" in out
    np.testing.assert_allclose(written(), at_flange, atol=1e-12)
    step = rpy_rotation([0.3, 0.0, 1.0]).T  # from tool0 back to the flange
    pose = ",".join(str(float(x)) for x in (*(step @ [0.0, -0.02, -0.1]), *rpy_of(step)))
    assert armid("payload", tmp_path, "--to", "ur", f"--flange={pose}").code == 0
    np.testing.assert_allclose(written(), at_flange, atol=1e-9)
    for name in ("gripper", "link_1"):
        code, _, err = armid("payload", tmp_path, "--to", "ur", "--flange", name)
        assert code == 2 and repr(name) in err


def test_controllers_that_cannot_be_written(armid: Armid, tmp_path: Path):
    code, _, err = armid("payload", "run", "loaded.npz", "--to", "kukka")
    assert code == 2 and "did you mean 'kuka'" in err
    code, _, err = armid("payload", "run", "loaded.npz", "--flange", "tool0")
    assert code == 2 and "no effect without --to" in err
    code, _, err = armid("payload", "run")
    assert code == 2 and "give recordings with the payload" in " ".join(err.split())
    code, _, err = armid("payload", "run", "--to", "ur")
    assert code == 2 and "cannot be read as a payload" in err
    code, _, err = armid("payload", "run", "elsewhere.npz", "--link", "link_2", "--to", "ur", "--out", tmp_path)
    assert code == 2 and "a load on the flange" in " ".join(err.split())
    assert [path.name for path in tmp_path.iterdir()] == ["payload.json"]  # the estimate is not lost


@pytest.mark.parametrize(
    ("recording", "code"), [("elsewhere.npz", "payload-misfit"), ("without.npz", "load-missing")]
)
def test_a_load_that_is_wrong_is_printed_but_not_written_for_controllers(
    armid: Armid, tmp_path: Path, recording: str, code: str
):
    exit_code, out, err = armid("payload", "run", recording, "--to", "ur,kuka", "--out", tmp_path)
    assert exit_code == 2 and "mass" in out
    assert f"not written for a controller because of the finding {code}" in " ".join(err.split())
    assert [path.name for path in tmp_path.iterdir()] == ["payload.json"]
    exit_code, out, err = armid("payload", "run", recording, "--to", "ur", "--json")
    assert exit_code == 2 and code in json.loads(out)["controllers_refused"] and code in err
    exit_code, _, err = armid("payload", tmp_path / "payload.json", "--to", "ur")
    assert exit_code == 2 and code in err and len(list(tmp_path.iterdir())) == 1


def test_a_load_on_the_screen_is_what_controllers_ask_for(armid: Armid):
    code, out, _ = armid("payload", "run", "loaded.npz")
    assert "the load is on the link link_3, which carries the tip frame" in out
    assert code == 0 and "with exact gains" not in out  # no gain is uncertain: there is one interval and not two
    mass, com, *moments = re.findall(r"│ (mass|centre of mass x|inertia [a-z ]+ I\w\w) +│ +([-\d.]+) │ (\S+) ", out)
    assert float(mass[1]) == pytest.approx(LOAD[0], rel=0.02) and mass[2] == "kg"
    assert float(com[1]) == pytest.approx(LOAD[1] / LOAD[0], abs=0.005) and com[2] == "m"
    truth = about_com(LOAD)[[4, 6, 9, 5, 7, 8]]
    assert [name[-2:] for name, _, _ in moments] == ["xx", "yy", "zz", "xy", "xz", "yz"]
    np.testing.assert_allclose([float(value) for _, value, _ in moments], truth, atol=0.03)


def test_one_joint_does_not_show_all_of_a_load_and_it_is_said(armid: Armid):
    code, out, err = armid("payload", "run", "turning.npz")
    assert code == 0
    assert "load-weakly-excited" in err and "(prior-dominated)" in err
    assert "centre of mass z" in out and "identified" in out


def test_a_load_on_another_link_is_told_with_the_link_to_name(armid: Armid):
    code, out, err = armid("payload", "run", "elsewhere.npz", "--json")
    assert code == 0
    record = json.loads(out)
    misfit = next(each for each in record["warnings"] if each["code"] == "payload-misfit")
    assert misfit["severity"] == "warning" and "link_3 does not explain the torque" in misfit["evidence"]
    assert "link_2 explains the torque" in misfit["remedy"] and "--link link_2" in misfit["remedy"]
    assert "joint_" in misfit["channel"] and "payload-misfit" in err
    new, alone = np.array(record["residual"]["new"]), np.array(record["residual"]["new_alone"])
    assert (new > 1.5 * alone).any()


def test_the_link_of_a_load_can_be_named(armid: Armid):
    code, out, err = armid("payload", "run", "elsewhere.npz", "--link", "link_2", "--json")
    assert code == 0 and "payload-misfit" not in err
    record = json.loads(out)
    assert record["link"] == record["frame"] == "link_2"
    # The mass of a load on link 2 causes no torque of its own, as the joint behind turns about a horizontal axis.
    seen = [k for k in range(10) if parameters(record)[LOAD_NAMES[k]]["status"] == "identified"]
    assert {LOAD_NAMES[k] for k in seen} >= {"MX", "MZ"}
    ends = [parameters(record)[LOAD_NAMES[k]]["interval95"] for k in seen]
    assert all(low <= LOAD[k] <= high for k, (low, high) in zip(seen, ends, strict=True))
    code, _, err = armid("payload", "run", "elsewhere.npz", "--link", "gripper")
    assert code == 2 and "'gripper'" in err and "link_1, link_2, link_3" in err


def test_a_sound_load_has_no_misfit(armid: Armid):
    for recording in ("loaded.npz", "tool.npz"):
        code, _, err = armid("payload", "run", recording)
        assert code == 0 and "payload-misfit" not in err


def test_kept_friction_that_has_changed_is_a_misfit_with_its_remedy(armid: Armid):
    code, _, err = armid("payload", "run", "tool.npz", "--same-friction")
    assert code == 0 and "payload-misfit" in err and "leave --same-friction out" in err


def test_gains_far_beyond_their_stated_deviation_are_told(armid: Armid):
    code, _, err = armid("payload", "currents/run", "currents/loaded.npz", "--mass", "0.8")
    assert code == 0 and "gain-beyond-deviation" not in err
    code, _, err = armid(
        "payload", "currents/run", "currents/loaded.npz", "--mass", "0.8", "--gain-deviation", "0.01"
    )
    assert code == 0 and "gain-beyond-deviation joint_" in err and "(stated 1%)" in err
    code, _, err = armid("payload", "currents/run", "currents/elsewhere.npz", "--mass", "0.8")
    assert code == 0 and "gain-beyond-deviation" in err and "(--mass, --link)" in err


def test_drive_gains_from_a_known_mass(armid: Armid):
    code, out, _ = armid("payload", "currents/run", "currents/loaded.npz", "--mass", "0.8", "--json")
    assert code == 0
    gains = json.loads(out)["gains"]
    assert [each["joint"] for each in gains] == ["joint_1", "joint_2", "joint_3"]
    for j, each in enumerate(gains):
        low, high = each["interval95"]
        assert low <= CORRECTION[j] <= high and high - low < 0.2
        assert each["given"] == GAIN[j]
        assert each["gain"] == pytest.approx(GAIN[j] * (1.0 + each["correction"]))
    code, out, _ = armid(
        "payload", "currents/run", "currents/loaded.npz", "--mass", "0.8", "--com", "0.05", "0.02", "0.1"
    )
    assert code == 0 and "Drive gains" in out and "known" in out
    words = " ".join(out.split())
    assert f"{WIDE}drive_gain_deviation, --gain-deviation)" in words
    assert "the drive gain of this joint keeps nearly its whole standard deviation" in words


def test_uncertain_gains_are_told_where_intervals_are(armid: Armid, tmp_path: Path):
    write_currents(recorded(8, friction=0.6), tmp_path / "warm.npz")
    for command in (
        ("identify", "currents/study.toml", "--no-report"),
        ("recalibrate", "currents/run", tmp_path / "warm.npz"),
    ):
        code, out, err = armid(*command, "--out", tmp_path / command[0])
        assert code == 0, err
        assert f"{WIDE}drive_gain_deviation)" in " ".join(out.split())
    out = armid("identify", "study.toml", "--no-report", "--out", tmp_path / "torques")[1]
    assert "intervals from" in out and "drive gains" not in out


def test_uncertain_gains_are_in_the_interval_of_the_mass(armid: Armid):
    masses = {}
    for deviation in ("0", "0.1"):
        command = ("payload", "currents/run", "currents/loaded.npz", "--gain-deviation", deviation, "--json")
        code, out, _ = armid(*command)
        assert code == 0
        masses[deviation] = json.loads(out)["mass"]
    assert "if gains are exact" in armid(*command[:-1])[1]
    low, high = masses["0.1"]["interval95"]
    assert low <= LOAD[0] <= high
    assert masses["0"]["interval95"] == masses["0"]["statistical95"]
    low, high = masses["0"]["interval95"]
    assert not low <= LOAD[0] <= high


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("payload", "run", "free.npz"), "the same data as run"),
        (("payload", "run", "loaded.npz", "loaded.npz"), "each of them once"),
        (("payload", "run", "loaded.npz", "--mass", "0.8"), "Drive gains cannot be estimated"),
        (("payload", "run", "loaded.npz", "--gain-deviation", "0.1"), "has no drive gains"),
        (("payload", "currents/run", "currents/loaded.npz", "--com", "0", "0", "0"), "without its mass"),
        (("payload", "currents/run", "currents/loaded.npz", "--mass", "-1"), "mass above 0"),
        (("payload", "currents/run", "loaded.npz"), "for effort"),
        (("payload", "run", "nowhere.npz"), "nowhere.npz"),
        (("payload", "loaded.npz", "loaded.npz"), "is not a run"),
        (("recalibrate", "run", "free.npz"), "the same data as run"),
        (("recalibrate", "run", "warm.npz", "--tool", "--all"), "--tool and --all"),
        (("recalibrate", "run", "warm.npz", "--out", "run"), "folder of the earlier run"),
        (
            ("recalibrate", "run", "warm.npz", "--validate", "warm.npz", "--out", "x"),
            "the same data are used for training",
        ),
        (
            ("recalibrate", "run", "warm.npz", "--validate", "later.npz", "--validate", "later.npz", "--out", "x"),
            "given twice for validation",
        ),
    ],
)
def test_bad_input_is_one_message(armid: Armid, folder: Path, arguments: tuple[str, ...], said: str):
    before = {path.name for path in folder.iterdir()}
    code, out, err = armid(*arguments)
    assert code == 2 and out == ""
    assert said in " ".join(err.split())
    assert {path.name for path in folder.iterdir()} == before


def test_an_arm_that_has_changed_is_told_how_to_recalibrate(armid: Armid):
    code, out, _ = armid("validate", "run", "warm.npz")
    assert code == 1 and "armid recalibrate run warm.npz" in " ".join(out.split())
    assert "recalibrate" not in armid("validate", "run", "warm.npz", "--json")[1]


def test_a_load_in_the_middle_of_an_arm_is_refused(armid: Armid, folder: Path, tmp_path: Path):
    text = (folder / "study.toml").read_text().replace('"small.urdf"', '"small.urdf"\ntip = "link_2"\nonly = ["*"]')
    (folder / "middle.toml").write_text(text)
    save_run(identify(load_study(folder / "middle.toml")), tmp_path / "middle")
    code, _, err = armid("payload", tmp_path / "middle", "loaded.npz")
    assert code == 2
    assert "not the last" in err and "joint_3" in err


def test_friction_is_recalibrated(armid: Armid, tmp_path: Path):
    out = tmp_path / "new"
    command = ("recalibrate", "run", "warm.npz", "--validate", "later.npz", "--out", out, "--json")
    code, text, _ = armid(*command)
    assert code == 0
    record = json.loads(text)
    assert record["run"] == str(out) and record["let_change"] == "friction"
    assert record["validation"]["verdict"] == "pass" and record["method"] == "wls, recalibrated"
    changes = {each["name"]: each for each in record["changes"]}
    for name, values in FRICTION.items():
        for j, value in enumerate(values):
            each = changes[f"{name}_{j + 1}"]
            assert each["beyond"] and each["ratio"] > 5.0
            assert each["after"] == pytest.approx(0.6 * value, rel=0.05)
            assert each["before"] == pytest.approx(value, rel=0.05)
    assert sum(each["beyond"] for each in record["changes"]) <= 6 + 2
    run, old = load_run(out), load_run("run")
    bound = next(each["bound"] for each in record["validation"]["checks"] if "training" in each["name"])
    read = [
        (choice := RecordingChoice(path), read_choice(choice, ".", run.robot)[0])
        for path in ("warm.npz", "later.npz")
    ]
    train, unseen = score_recordings(run.model, run.estimate, process_each(read, run.processing, run.robot))[0]
    # One number: the column on the screen, the record, and what the bound is made of.
    np.testing.assert_allclose(record["residual"]["rms"], train.rms, rtol=5e-3)
    assert bound == pytest.approx(max(3.0 * np.linalg.norm(train.rms), 0.02 * np.linalg.norm(unseen.spread)))
    assert set(old.trained_on) < set(run.trained_on) and len(run.trained_on) == 2
    code, text, _ = armid("validate", out, "later.npz", "--json")
    new_rms = json.loads(text)["recordings"][0]["rms"]
    _, text, _ = armid("validate", "run", "later.npz", "--json")
    assert code == 0
    assert np.linalg.norm(new_rms) < 0.2 * np.linalg.norm(json.loads(text)["recordings"][0]["rms"])
    assert armid("predict", out, "later.npz", "--out", tmp_path / "torque.csv")[0] == 0
    for seen in ("free.npz", "warm.npz"):
        assert armid("validate", out, seen)[0] == 2


@pytest.mark.parametrize("let_change", [(), ("--tool",), ("--all",)])
def test_screen_record_and_page_list_the_same_changes(armid: Armid, tmp_path: Path, let_change: tuple[str, ...]):
    command = ("recalibrate", "run", "warm.npz", "--out", tmp_path / "new", *let_change)
    _, screen, _ = armid(*command)
    on_screen = re.findall(r"^│ (\w+)\s+│", screen, re.MULTILINE)
    record = json.loads((tmp_path / "new" / "changes.json").read_text())
    assert set(on_screen) == {each["name"] for each in record["changes"] if each["beyond"]}
    armid("report", "run", tmp_path / "new", "--out", tmp_path / "change.html")
    page = (tmp_path / "change.html").read_text(encoding="utf-8")
    (on_page,) = re.findall(r'changed beyond their intervals; .*?<p class="names">(.*?)</p>', page, re.DOTALL)
    assert on_page.split(", ") == on_screen
    assert f"<b>{len(on_screen)} of {len(record['changes'])}</b>" in page
    assert "is taken from the recalibration" in page


def test_recalibration_shows_what_the_earlier_run_would_have_left(armid: Armid, tmp_path: Path):
    command = ("recalibrate", "run", "warm.npz", "--validate", "later.npz", "--out", tmp_path / "new")
    code, text, err = armid(*command)
    assert code == 0 and "earlier run" in text and "recalibration-worse" not in err
    _, text, _ = armid(*command, "--json")
    (before,) = json.loads(text)["rms_before"]
    _, text, _ = armid("validate", "run", "later.npz", "--json")
    np.testing.assert_allclose(before["rms"], json.loads(text)["recordings"][0]["rms"])


def test_a_recalibration_that_does_worse_is_told(armid: Armid, tmp_path: Path):
    # The friction of a warm arm, judged on the arm as it was cold.
    write_recording(recorded(7), tmp_path / "cold.npz")
    command = ("recalibrate", "run", "warm.npz", "--validate", tmp_path / "cold.npz", "--out", tmp_path / "new")
    _, _, err = armid(*command)
    assert "recalibration-worse" in err


def test_a_check_on_the_arm_as_it_was_is_told_to_be_one(armid: Armid, tmp_path: Path):
    """The new values are not what fails there: longer motion or the earlier run would be no cure."""
    write_recording(recorded(7), tmp_path / "cold.npz")
    command = ("recalibrate", "run", "warm.npz", "--validate", tmp_path / "cold.npz", "--out", tmp_path / "new")
    code, _, err = armid(*command)
    said = " ".join(err.split())
    assert code == 1 and "before the change" in said and "recording that was made after the change" in said
    assert "record longer" not in said and "keep the earlier run" not in said


def test_what_is_built_on_a_failed_run_says_so(armid: Armid, tmp_path: Path):
    failed = shutil.copytree("run", tmp_path / "failed")
    validation = json.loads((failed / "validation.json").read_text())
    (failed / "validation.json").write_text(json.dumps(validation | {"verdict": "fail"}))
    assert "earlier-run-failed" in armid("payload", failed, "loaded.npz")[2]
    assert "earlier-run-failed" in armid("recalibrate", failed, "warm.npz", "--out", tmp_path / "new")[2]
    assert "earlier-run-failed" not in armid("payload", "run", "loaded.npz")[2]


@pytest.mark.parametrize("code", ["current-without-gain", "motor-side", "torque-unit"])
@pytest.mark.parametrize(
    ("others", "severity"),
    [((), "info"), (("relative RMS of every joint below 1",), "warning")],
    ids=["gains", "more"],
)
def test_a_known_load_repairs_a_run_that_failed_for_its_gains_alone(
    armid: Armid, tmp_path: Path, code: str, others: tuple[str, ...], severity: str
):
    failed = shutil.copytree("currents/run", tmp_path / "failed")
    validation = json.loads((failed / "validation.json").read_text())
    names = (f"errors in the recordings ({code})", *others)
    checks = [{"name": name, "value": 1.0, "bound": 0.0, "ok": False} for name in names]
    (failed / "validation.json").write_text(json.dumps(validation | {"verdict": "fail", "checks": checks}))
    err = armid("payload", failed, "currents/loaded.npz", "--mass", "0.8")[2]
    assert f"{severity} earlier-run-failed" in err
    assert "warning earlier-run-failed" in armid("payload", failed, "currents/loaded.npz")[2]


@pytest.mark.parametrize(
    ("factor", "code"), [(0.1, "current-without-gain"), (0.02, "motor-side"), (50.0, "torque-unit")]
)
def test_a_run_with_other_gains_failed_for_them_alone_whatever_their_factor(
    folder: Path, tmp_path: Path, factor: float, code: str
):
    shutil.copytree(folder / "currents", tmp_path, dirs_exist_ok=True)
    text = (tmp_path / "study.toml").read_text().replace("_deviation = 0.1", "_deviation = 0.05")
    (tmp_path / "study.toml").write_text(text.replace("[10.0, 12.0, 8.0]", str((factor * GAIN).tolist())))
    run = load_run(save_run(identify(load_study(tmp_path / "study.toml")), tmp_path / "other"))
    (error,) = [each for each in run.estimate.findings if each.severity == "error"]
    assert error.code == code and only_drive_gains_failed(run)
    # The same code about positions in counts of encoders, for which no gain is the remedy.
    counts = replace(error, channel="q", remedy="convert the positions to radians")
    assert not only_drive_gains_failed(replace(run, estimate=replace(run.estimate, findings=(counts,))))


def test_noise_of_new_recordings_is_not_taken_for_a_change(armid: Armid, tmp_path: Path):
    """A log of a lower rate has more noise in the band, which no parameter takes away; a changed tool still shows."""
    warm, tool = recorded(5, friction=0.6), recorded(6, load=True)
    for name, log in (("noisy", warm), ("both", tool)):
        assert log.effort is not None
        noise = 1.5 * np.random.default_rng(1).normal(size=log.effort.shape)
        write_recording(replace(log, effort=log.effort + noise), tmp_path / f"{name}.npz")
    code, _, err = armid("recalibrate", "run", tmp_path / "noisy.npz", "--out", tmp_path / "a")
    assert code == 0 and "noisier-recordings" in err and "more-has-changed" not in err
    code, _, err = armid("recalibrate", "run", tmp_path / "both.npz", "--out", tmp_path / "b")
    assert code == 0 and "noisier-recordings" not in err and "more-has-changed" in err


def test_larger_errors_at_rest_are_not_taken_for_noise(armid: Armid, tmp_path: Path):
    """At rest the torque lies anywhere between the bounds of static friction; in motion the error is as before."""
    warm = recorded(5, friction=0.6)
    assert warm.effort is not None and warm.time is not None and warm.rate is None
    step, rest = float(np.median(np.diff(warm.time))), 400
    held = warm.effort[-1] + np.array([1.5, -2.0, 1.0])
    longer = replace(
        warm,
        time=np.concatenate([warm.time, warm.time[-1] + step * np.arange(1, rest + 1)]),
        q=np.concatenate([warm.q, np.repeat(warm.q[-1:], rest, axis=0)]),
        dq=None,
        effort=np.concatenate([warm.effort, np.repeat(held[None], rest, axis=0)]),
        valid=np.concatenate([warm.valid, np.repeat(warm.valid[-1:], rest, axis=0)]),
    )
    write_recording(longer, tmp_path / "resting.npz")
    code, _, err = armid("recalibrate", "run", tmp_path / "resting.npz", "--out", tmp_path / "a")
    told = " ".join(err.split())
    assert code == 0 and "noisier-recordings" in told and "slow, reverses or rests" in told
    noise = 1.5 * np.random.default_rng(1).normal(size=warm.effort.shape)
    write_recording(replace(warm, effort=warm.effort + noise), tmp_path / "noisy.npz")
    told = " ".join(armid("recalibrate", "run", tmp_path / "noisy.npz", "--out", tmp_path / "b")[2].split())
    assert "the check cannot tell which" in told and "reverses or rests" not in told


def test_a_recalibrated_run_with_validation_is_reported_and_exported(armid: Armid, tmp_path: Path):
    """The run has digests of all recordings of its study, so that each is found again."""
    out = tmp_path / "new"
    assert armid("recalibrate", "run", "warm.npz", "--validate", "later.npz", "--out", out)[0] == 0
    assert [each.role for each in load_run(out).estimate.made_from if each.role in ("train", "validate")] == [
        each["role"] for each in json.loads((out / "study.json").read_text())["recordings"]
    ]
    for command in (
        ("report", out, "--out", tmp_path / "page.html"),
        ("preview", out, "--out", tmp_path / "arm.html"),
    ):
        code, _, err = armid(*command)
        assert code == 0, err
    assert "Traceback" not in armid("export", out, "--to", "urdf", "--out", tmp_path / "new.urdf")[2]


def test_a_changed_tool_is_noticed_and_recalibrated(armid: Armid, tmp_path: Path):
    code, out, err = armid("recalibrate", "run", "tool.npz", "--out", tmp_path / "friction")
    assert code == 0 and "more-has-changed" in err and "--tool" in err
    code, out, err = armid("recalibrate", "run", "tool.npz", "--tool", "--out", tmp_path / "tool")
    assert code == 0 and "more-has-changed" not in err
    assert "changed beyond their 95 % intervals" in out and "FS_1" in out
    everything = armid("recalibrate", "run", "tool.npz", "--all", "--out", tmp_path / "all")
    assert everything[0] == 0
    known, alone = load_run(tmp_path / "tool").estimate.fit, load_run(tmp_path / "all").estimate.fit
    span = np.sqrt(np.diag(known.covariance) + np.diag(alone.covariance))
    assert (np.abs(known.values - alone.values) <= 5.0 * span).all()


def test_a_recalibrated_run_carries_a_load(armid: Armid, tmp_path: Path):
    assert armid("recalibrate", "run", "warm.npz", "--out", tmp_path / "new")[0] == 0
    code, out, _ = armid("payload", tmp_path / "new", "tool.npz", "--same-friction", "--json")
    assert code == 0
    low, high = json.loads(out)["mass"]["interval95"]
    assert low <= LOAD[0] <= high


def test_recalibration_writes_nothing_where_it_fails(armid: Armid, tmp_path: Path):
    damaged = shutil.copytree("run", tmp_path / "damaged")
    (damaged / "study.json").write_text("{}")
    code, _, err = armid("recalibrate", damaged, "warm.npz", "--out", tmp_path / "new")
    assert code == 2 and "study.json cannot be read as the study of a run" in " ".join(err.split())
    assert not (tmp_path / "new").exists()


def test_without_a_load_the_mass_is_bounded(folder: Path, armid: Armid):
    code, out, err = armid("payload", "run", "without.npz", "--json")
    answer = json.loads(out)
    assert code == 0 and "load-missing" in {each["code"] for each in answer["warnings"]}
    low, high = answer["mass"]["interval95"]
    assert low <= NOTHING and high < 0.1  # an eighth of the load of the other recordings
    assert f"below {high:.3g} kg" in err
