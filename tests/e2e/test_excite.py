"""`armid excite` from the command line, with searches of a second: what it writes, and what it refuses."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.cli.main import _join_numbers, main
from armid.excitation.formats import FORMATS
from armid.excitation.fourier import load_plan
from armid.output.locks import sweep
from armid.robot import load_robot
from armid.robot.kinematics import forward_kinematics
from armid.runs.run import load_run
from armid.study.plans.plan_reading import read_whole_plan
from labs import write_recordings, write_study
from paged import blocks, pages
from pendulums import ARM

QUICK = ["--budget", "1", "--workers", "0", "--harmonics", "4", "--duration", "8"]


def run(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        main(["excite", *map(str, arguments)])
    assert end.value.code == 0
    return capsys.readouterr()


def stopped(arguments, capsys) -> str:
    with pytest.raises(SystemExit) as end:
        main(["excite", *map(str, arguments)])
    assert end.value.code == 2
    return capsys.readouterr().err


@pytest.fixture
def small(tmp_path):
    path = tmp_path / "pendulum.toml"
    path.write_text(ARM)
    return path


def test_what_is_written(small, tmp_path, capsys):
    out = tmp_path / "plan"
    said = json.loads(
        run([small, *QUICK, "--out", out, "--json", "--begin", "0.1,0.2", "--acceleration", 3], capsys).out
    )
    plan = json.loads((out / "plan.json").read_text())
    for key in ("robot", "base_frequency", "offset", "a", "b", "criterion", "condition", "log_det", "seconds"):
        assert said[key] == plan[key]
    assert np.shape(plan["a"]) == np.shape(plan["b"]) == (2, 4)
    assert {"position", "velocity", "acceleration"} == set(plan["limits"])
    for limit in plan["limits"].values():
        assert abs(limit["value"]) <= abs(limit["bound"]) and limit["joint"] in ("first", "second")
    written = {path.name for path in out.iterdir()}
    for stem in ("plan", "rehearsal"):
        assert {f"{stem}{FORMATS[name].SUFFIX}" for name in ("csv", "ros2", "mat")} <= written
    assert not any("fri" in name or name.endswith(".script") for name in written)
    assert {"plan.json", "preflight.json", "preflight.txt"} <= written
    series = load_plan(out / "plan.json")
    start = series.at([0.0])
    assert np.abs(start.dq).max() < 1e-12 and np.abs(start.ddq).max() < 1e-12
    motion = series.sample(1000.0)
    assert (np.abs(motion.dq) <= [1.0, 2.0]).all() and (np.abs(motion.ddq) <= 3.0).all()
    table = FORMATS["csv"].read((out / "plan.csv").read_bytes())
    assert table.motion.q[0] == pytest.approx([0.1, 0.2])
    slow = FORMATS["csv"].read((out / "rehearsal.csv").read_bytes())
    assert np.abs(slow.motion.dq).max() == pytest.approx(0.2 * np.abs(table.motion.dq).max(), rel=1e-3)
    report = json.loads((out / "preflight.json").read_text())
    assert all(entry["certified_share"] <= 1.0 for entry in report["limits"])
    assert all(entry["deviation"] > 0.0 for entry in report["base_parameters"])
    assert "collisions not checked: the description has no shapes of bodies" in (out / "preflight.txt").read_text()


def test_the_page_of_a_plan_folds_what_is_long_and_names_joints(small, tmp_path, capsys):
    pytest.importorskip("plotly")
    run([small, *QUICK, "--out", tmp_path / "plan"], capsys)
    html = (tmp_path / "plan" / "preflight.html").read_text(encoding="utf-8")
    assert "Pre-flight check" in html and "efore the flight" not in html
    series, folded = (part.split("</details>")[0] for part in html.split('<details class="fold"')[1:3])
    assert 'id="table-series"' in series and all(f">{name}</th>" in series for name in ("q₀", "a₁", "b₁"))
    assert 'id="table-expected-parameters"' in folded and "Predicted standard deviation" in folded
    assert folded.index("joint 1 · first") < folded.index("FV_1") < folded.index("joint 2 · second")


PAGE = Path(__file__).parents[2] / "docs" / "excitation.md"


def test_the_page_tells_every_key_of_a_plan(small, tmp_path, capsys):
    """Of a series and of poses, no more and no fewer; the example on the page is a plan at rest where it begins."""
    page = PAGE.read_text(encoding="utf-8").split("## plan.json")[1].split("\n## ")[0]
    tables = [re.findall(r"^\| (`[^|]*`) \|", part, re.MULTILINE) for part in page.split("Poses and sweeps")]
    series, moves = ({key for cell in table for key in re.findall(r"`(\w+)`", cell)} for table in tables)
    run([small, *QUICK, "--out", tmp_path / "series"], capsys)
    run([small, "--experiment", "sweeps", "--out", tmp_path / "moves"], capsys)
    written = [json.loads((tmp_path / name / "plan.json").read_text()) for name in ("series", "moves")]
    assert series == set(written[0])
    assert moves | {"robot"} == set(written[1])
    assert written[0]["joints"] == written[1]["joints"] == ["first", "second"]
    example = tmp_path / "example.json"
    example.write_text(re.findall(r"```json\n(.*?)```", page, re.DOTALL)[0])
    plan, around = read_whole_plan(str(example))
    begin = plan.at([0.0])
    assert not around and np.abs(begin.dq).max() < 1e-15 and np.abs(begin.ddq).max() < 1e-15
    needed = {key: json.loads(example.read_text())[key] for key in ("robot", "base_frequency", "offset", "a", "b")}
    example.write_text(json.dumps(needed))
    assert read_whole_plan(str(example))[0].repetitions == 1


def test_the_python_of_the_page(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = [block.text for block in blocks(pages()["excitation.md"]) if block.language == "python"]
    names: dict[str, Any] = {}
    for text in done:
        exec(text, names)
    assert done and names["motion"].samples == 1000
    assert names["slow"].period == pytest.approx(27.0)
    assert (names["series"].a == names["designed"].plan.excitation.a).all()


@pytest.mark.collision
def test_collisions_and_a_second_plan_after_the_first(tmp_path, capsys):
    first, second = tmp_path / "first", tmp_path / "second"
    common = ["ur5e", *QUICK, "--duration", 4, "--floor", 0, "--noise", 0.5, "--format", "urscript"]
    text = run([*common, "--out", first], capsys).out
    assert "closest approaches" in text and "link_3 - floor" not in text.split("closest")[0]
    series, robot = load_plan(first / "plan.json"), load_robot("ur5e")
    _, places = forward_kinematics(robot, series.sample(100.0).q)
    assert places[:, 2:, 2].min() > 0.02
    run([*common, "--after", first / "plan.json", "--out", second], capsys)
    alone, both = (
        np.array([p["deviation"] for p in json.loads((each / "preflight.json").read_text())["base_parameters"]])
        for each in (first, second)
    )
    assert (both < alone).all()


@pytest.fixture(scope="module")
def identified(tmp_path_factory) -> Path:
    """A run of the small arm, with the arm beside it."""
    folder = tmp_path_factory.mktemp("identified")
    write_recordings(folder)
    with pytest.raises(SystemExit) as end:
        main(["identify", str(write_study(folder)), "--out", str(folder / "run")])
    assert not end.value.code
    return folder


def test_a_plan_after_a_run(identified, tmp_path, capsys):
    """It aims at the worst relative deviation, and knows what the run knows."""
    common = [identified / "small.urdf", *QUICK, "--noise", 0.5]
    run([*common, "--out", tmp_path / "first"], capsys)
    run([*common, "--after", identified / "run", "--out", tmp_path / "second"], capsys)
    run([*common, "--after", identified / "run", "--criterion", "a-optimal", "--out", tmp_path / "third"], capsys)
    plans = [json.loads((tmp_path / name / "plan.json").read_text()) for name in ("first", "second", "third")]
    assert [plan["criterion"] for plan in plans] == ["d-optimal", "worst", "a-optimal"]
    told = [{finding["code"] for finding in plan["findings"]} for plan in plans]
    assert "torque-nominal" in told[0] and "torque-nominal" not in told[1] and "torque-estimated" in told[1]
    alone, after = (
        np.array([p["deviation"] for p in json.loads((each / "preflight.json").read_text())["base_parameters"]])
        for each in (tmp_path / "first", tmp_path / "second")
    )
    assert np.sqrt(np.mean(after**2)) < np.sqrt(np.mean(alone**2))


def test_a_plan_after_a_run_has_its_terms_and_its_noise(identified, tmp_path, capsys):
    """So the predicted deviations are smaller than those of the run alone."""
    fit = load_run(identified / "run").estimate.fit
    run([identified / "small.urdf", *QUICK, "--after", identified / "run", "--out", tmp_path / "plan"], capsys)
    assert json.loads((tmp_path / "plan" / "plan.json").read_text())["noise"] == fit.noise.tolist()
    expected = json.loads((tmp_path / "plan" / "preflight.json").read_text())["base_parameters"]
    assert [each["name"] for each in expected] == list(fit.names)
    assert (np.array([each["deviation"] for each in expected]) < fit.deviation).all()


def test_a_plan_after_a_run_has_the_torque_that_the_run_predicts(identified, tmp_path, capsys):
    """Also where the design itself has fewer terms than the run."""
    plan = tmp_path / "plan"
    common = [identified / "small.urdf", *QUICK, "--terms", "rigid-body,viscous", "--after", identified / "run"]
    run([*common, "--out", plan], capsys)
    margins = json.loads((plan / "preflight.json").read_text())["limits"]
    stated = [each["value"] for each in margins if each["limit"] == "torque"]
    motion = tmp_path / "torque.csv"
    call = ["predict", identified / "run", plan / "plan.json", "--plan-rate", 1000, "--out", motion]
    with pytest.raises(SystemExit) as end:
        main(list(map(str, call)))
    assert not end.value.code
    predicted = np.abs(np.loadtxt(motion, delimiter=",", skiprows=1)[:, 1:]).max(axis=0)
    assert stated == pytest.approx(predicted.tolist(), rel=1e-9)  # rounding


def test_poses_need_a_run_of_the_arm_for_its_torque(identified, small, tmp_path, capsys):
    poses = ["--experiment", "poses", "--poses", 3, "--after", identified / "run", "--out", tmp_path / "poses"]
    run([identified / "small.urdf", *poses], capsys)
    assert "with the same direction of gravity" in stopped([small, *poses], capsys)


def test_a_run_about_another_arm_is_refused(identified, small, tmp_path, capsys):
    error = stopped([small, *QUICK, "--after", identified / "run", "--out", tmp_path / "none"], capsys)
    assert "has none of the base parameters of pendulum" in error and not (tmp_path / "none").exists()
    assert "--terms rigid-body,viscous,coulomb" in error


def test_the_same_seed_gives_the_same_problem_to_other_options(small, tmp_path, capsys):
    """Thesis limits, free start, prediction and envelope go through, each inside what it names."""
    for k, more in enumerate((
        ["--limits", "thesis-literal", "--criterion", "condition"],
        ["--free-start", "--free-centre", "--jerk", 9],
        ["--criterion", "prediction", "--predict", tmp_path / "0" / "plan.json"],
        ["--envelope", f"{tmp_path / '0' / 'plan.json'}@16"],
        ["--tip-box", "-1", "-1", "-1", "1", "1", "2"],
    )):  # fmt: skip
        run([small, *QUICK, "--out", tmp_path / str(k), "--format", "csv", *more], capsys)
    first, inside = (load_plan(tmp_path / name / "plan.json") for name in "03")
    for key in ("dq", "ddq"):
        widest = np.abs(getattr(first.stretched(16.0).sample(1000.0), key)).max(axis=0)
        assert (np.abs(getattr(inside.sample(1000.0), key)).max(axis=0) <= widest * (1.0 + 1e-9)).all()
    free = load_plan(tmp_path / "1" / "plan.json").at([0.0])
    assert np.abs(free.q).max() > 1e-3 and np.abs(free.dq).max() < 1e-12


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--budget", "0"], "budget"),
        (["--harmonics", "1"], "cannot start and end at rest"),
        (["--duration", "0"], "duration of a period must be positive"),
        (["--experiment", "dance"], "Unknown kind of motion 'dance'"),
        (["--criterion", "best"], "no criterion 'best'"),
        (["--criterion", "prediction"], "needs at least one motion"),
        (["--limits", "soft"], "Unknown kind of limits"),
        (["--limit", "first.velocity=fast"], "not a limit"),
        (["--limit", "third.velocity=1"], "no joint 'third'"),
        (["--limit", "first.position=1:-1"], "are reversed or equal"),
        (["--start", "0,2"], "outside the limits -1.5 to 1.5"),
        (["--start", "0"], "needs 2 finite numbers"),
        (["--start", "0,x"], "not a list of numbers"),
        (["--collision"], "contains no shapes of the links"),
        (["--tip-box", "1", "1", "1", "0", "0", "0"], "the box is empty"),
        (["--noise", "0"], "must be positive"),
        (["--format", "gcode"], "Unknown format 'gcode'"),
        (["--after", "nowhere"], "nowhere"),
        (["--envelope", "thesis-a1@27"], "moves 7 joints"),
        (["--envelope", "thesis-a1@soon"], "not a duration"),
        (["--torque-margin", "1.5"], ""),
        (["--environment", "nowhere.toml"], "cannot be read as an environment"),
        (["--duration", "nan"], "duration of a period must be positive"),
        (["--limit", "first.velocity=-1"], "velocity limit of first must be positive"),
        (["--limit", "first.position=0.2:0.4", "--start", "0,0"], "outside the limits 0.2 to 0.4"),
    ],
)
def test_what_is_refused(small, tmp_path, capsys, arguments, message):
    if arguments[0] == "--torque-margin":
        small.write_text(ARM.replace("velocity = 1.0", "velocity = 1.0\neffort = 5.0"))
        arguments, message = [*arguments, "--terms", "offset"], "has no masses"
        assert message in run([small, *QUICK, "--out", tmp_path / "plan", *arguments], capsys).err
        return
    said = " ".join(stopped([small, *QUICK, "--out", tmp_path / "plan", *arguments], capsys).split())
    assert message in said
    assert not (tmp_path / "plan").exists()


@pytest.mark.collision
@pytest.mark.parametrize("kind", ["poses", "sweeps"])
def test_poses_and_sweeps(kind, tmp_path, capsys):
    out = tmp_path / kind
    more = ["--poses", 5, "--rest", 0.5, "--collision"] if kind == "poses" else []
    more += ["--format", "csv", "--format", "urscript", "--format-rate", 20]
    found = json.loads(run(["ur5e", "--experiment", kind, "--out", out, "--json", *more], capsys).out)
    kinds = [stretch["kind"] for stretch in found["stretches"]]
    assert kinds.count("rest") == (5 if kind == "poses" else 0)
    track = FORMATS["csv"].read((out / "plan.csv").read_bytes())
    assert track.motion.time[-1] == pytest.approx(found["duration"], abs=0.05)
    assert (out / "rehearsal.script").is_file() and (out / "plan.json").is_file()
    checked = json.loads((out / "preflight.json").read_text())
    assert found["verdict"] == checked["verdict"] == "pass"
    assert {each["limit"] for each in checked["limits"]} == {"position", "velocity", "torque"}
    assert max(each["certified_share"] for each in checked["limits"]) < 1.0
    assert checked["approaches"] and all(each["distance"] >= each["asked"] - 1e-6 for each in checked["approaches"])
    text = (out / "preflight.txt").read_text()
    assert text.startswith("✓ every limit holds (torque without friction and rotor inertia), and checked bodies keep")
    assert "info floor-assumed" in text
    assert (out / "preflight.html").is_file() and "condition" not in checked


def test_sweeps_that_need_more_torque_than_the_joints_have_fail(tmp_path, capsys):
    """They end with exit code 1, and no motion is written for a controller."""
    out = tmp_path / "sweeps"
    weak = ["--limit", "shoulder_lift_joint.effort=60", "--start", "0,-0.1,0,0,0,0", "--no-collision"]
    call = ["excite", "ur5e", "--experiment", "sweeps", "--format", "csv", "--no-report", "--out", str(out), *weak]
    with pytest.raises(SystemExit) as ended:
        main(call)
    assert ended.value.code == 1 and "torque of shoulder_lift_joint is exceeded" in capsys.readouterr().err
    assert not (out / "plan.csv").exists() and (out / "preflight.txt").is_file()


def test_missing_limits_are_asked_for_by_name(small, tmp_path, capsys):
    small.write_text(ARM.replace("velocity = 2.0\n", ""))
    assert "second.velocity" in stopped([small, *QUICK, "--out", tmp_path / "plan"], capsys)
    run([small, *QUICK, "--out", tmp_path / "plan", "--limit", "second.velocity=1.5"], capsys)
    assert json.loads((tmp_path / "plan" / "plan.json").read_text())["limits"]["velocity"]["bound"] <= 1.5


def test_an_unknown_link_of_a_tool_is_refused(tmp_path, capsys):
    cell = tmp_path / "cell.toml"
    cell.write_text('[[sphere]]\nlink = "hand"\nradius = 0.1\nxyz = [0, 0, 0]\n')
    said = stopped(["ur5e", *QUICK, "--environment", cell, "--out", tmp_path / "plan"], capsys)
    assert "has no link 'hand', so no link can carry this body" in " ".join(said.split()) and "link_6" in said
    assert not (tmp_path / "plan").exists()


def test_accelerations_without_a_limit_are_said_everywhere_and_once(small, tmp_path, capsys):
    shown = run([small, *QUICK, "--out", tmp_path / "free"], capsys)
    line, peak = "Acceleration is not limited, because no limit is given; the plan reaches first ", None
    for text in (shown.out + shown.err, (tmp_path / "free" / "preflight.txt").read_text()):
        text = " ".join(text.split())
        assert text.count(line) == 1 and text.count("collisions not checked") <= 2
        peak = float(text.partition(line)[2].split()[0])
    motion = load_plan(tmp_path / "free" / "plan.json").sample(1000.0)
    assert peak == pytest.approx(np.abs(motion.ddq[:, 0]).max(), rel=0.02)
    record = json.loads((tmp_path / "free" / "preflight.json").read_text())
    assert [f["code"] for f in record["findings"]].count("acceleration-unlimited") == 1
    assert line in (tmp_path / "free" / "preflight.html").read_text()
    each = [" ".join((f["evidence"], f["remedy"])) for f in record["findings"]]
    screen = " ".join((shown.out + shown.err).split())
    assert all(screen.count(" ".join(f["evidence"].split())) == 1 for f in record["findings"]), each
    some = run([small, *QUICK, "--out", tmp_path / "some", "--limit", "first.acceleration=3"], capsys)
    assert "the plan reaches second " in " ".join(some.err.split())
    all_ = run([small, *QUICK, "--out", tmp_path / "all", "--acceleration", 3], capsys)
    assert "Acceleration is not limited" not in all_.out + all_.err


def test_a_search_that_time_cut_short_says_so(tmp_path, capsys):
    """No machine completes a descent in ten milliseconds."""
    asked = ["panda", "--budget", "0.01", "--workers", "0", "--no-collision", "--duration", "10", "--no-report"]
    shown = run([*asked, "--out", tmp_path / "plan"], capsys)
    assert "before the first local search was completed" in " ".join(shown.err.split()) and "--budget 60" in shown.err
    assert "search-unsettled" in (tmp_path / "plan" / "preflight.json").read_text()
    assert "--budget 60" in (tmp_path / "plan" / "preflight.txt").read_text()


WEIGHTLESS = """<robot name="weightless"><link name="base"/>
<joint name="first" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="5"/></joint>
<link name="a"><inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
<joint name="second" type="revolute"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/><origin xyz="0 0 0.3"/>
<limit lower="-1" upper="1" velocity="1" effort="5"/></joint>
<link name="b"><inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
</robot>"""


def test_an_arm_of_no_mass_is_planned_and_said_to_have_none(tmp_path, capsys):
    path = tmp_path / "weightless.urdf"
    path.write_text(WEIGHTLESS)
    said = " ".join(run([path, *QUICK, "--out", tmp_path / "plan"], capsys).err.split())
    assert "torque is not checked and not limited, because the description of" in said and "has no masses" in said
    assert "torque" not in json.loads((tmp_path / "plan" / "plan.json").read_text())["limits"]


@pytest.mark.parametrize("signal", ["kill", "terminate"])
def test_a_killed_search_leaves_nothing(small, tmp_path, signal):
    """Whatever moment it dies in before it is done, there is no folder and no part of one after the next command."""
    out = tmp_path / "plans" / "first"
    out.parent.mkdir()
    command = [sys.executable, "-c", "from armid.cli.main import main; main()", "excite", str(small), *QUICK]
    search = subprocess.Popen(
        [*command, "--budget", "120", "--out", str(out)], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
    )
    time.sleep(5.0)
    getattr(search, signal)()
    assert search.wait(60) != 0
    assert all(path.name.startswith(".") for path in out.parent.iterdir())
    sweep(out.parent)
    assert list(out.parent.iterdir()) == []


def test_a_folder_that_is_no_plan_is_left_alone(small, tmp_path, capsys):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("mine")
    assert "is not a plan of armid" in " ".join(stopped([small, *QUICK, "--out", tmp_path / "mine"], capsys).split())


def test_numbers_with_blanks():
    assert _join_numbers(["excite", "ur5e", "--start", "0", "-1.5", "1e-3", "--json"]) == [
        "excite", "ur5e", "--start=0,-1.5,1e-3", "--json",
    ]  # fmt: skip
    assert _join_numbers(["--start", "0,1", "--gravity", "0", "0", "9.81"])[-4:] == ["--gravity", "0", "0", "9.81"]


def test_in_a_process_of_its_own(small, tmp_path):
    """Workers are forked where BLAS has one thread, and nothing is left of them."""
    command = [sys.executable, "-c", "from armid.cli.main import main; main()", "excite", str(small)]
    done = subprocess.run(
        [*command, "--budget", "1", "--harmonics", "4", "--duration", "8", "--out", str(tmp_path / "p"), "--json"],
        capture_output=True, text=True, check=True, timeout=100,
    )  # fmt: skip
    assert json.loads(done.stdout)["descents"] > 0
    assert Path(json.loads(done.stdout)["folder"]).is_dir()
