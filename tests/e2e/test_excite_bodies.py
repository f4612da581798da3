"""`armid excite` and the space that links take: checked unless left out, with one story in every account."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.cli.main import main
from armid.cli.motion import excite_request
from armid.excitation.collision.closest_approach import ClosestApproach
from armid.excitation.fourier import load_plan
from armid.robot import load_robot
from armid.robot.collision_body_names import BodyPair
from armid.robot.kinematics import forward_kinematics
from reports import Page

coal = pytest.importorskip("coal", reason="the package coal is not installed")
pytestmark = pytest.mark.collision

QUICK = ["--budget", "1", "--workers", "0", "--harmonics", "4", "--duration", "8", "--format", "csv"]

LIMIT = '<limit lower="-3" upper="3" velocity="2" effort="50"/>'
INERTIA = '<inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>'


def link(name: str, body: str = "", kind: str = "collision") -> str:
    """A link with a body."""
    shape = f'<{kind}><origin xyz="0 0 0.2"/><geometry>{body}</geometry></{kind}>' if body else ""
    return f'<link name="{name}">{INERTIA}{shape}</link>'


def joint(name: str, parent: str, child: str, z: float, axis: str = "0 1 0") -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 {z}"/><axis xyz="{axis}"/>{LIMIT}</joint>'
    )


def folding(kind: str = "collision", last: str = '<cylinder radius="0.04" length="0.3"/>') -> str:
    """Three links that stand on a floor and fold onto each other and onto their base."""
    rod = '<cylinder radius="0.05" length="0.3"/>'
    return (
        '<robot name="folding">'
        f'<link name="base"><{kind}><origin xyz="0 0 0.05"/>'
        f'<geometry><box size="0.3 0.3 0.1"/></geometry></{kind}></link>'
        + joint("lift", "base", "upper", 0.15)
        + link("upper", rod, kind)
        + joint("bend", "upper", "middle", 0.4)
        + link("middle", rod, kind)
        + joint("tilt", "middle", "hand", 0.4)
        + link("hand", last, kind)
        + "</robot>"
    )


def run(arguments, capsys) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as end:
        main([str(argument) for argument in arguments])
    said = capsys.readouterr()
    return int(end.value.code or 0), said.out, said.err


def prose(page: Path) -> str:
    """Return what a page says."""
    return Page(page.read_text(encoding="utf-8")).prose


def distances(page: Path) -> np.ndarray:
    """Least distances that a preview shows over time [m]."""
    record = Page(page.read_text(encoding="utf-8")).data["approach"]["distance"]
    return np.frombuffer(base64.b64decode(record["bdata"]), dtype=f"<{record['dtype']}")


@pytest.fixture
def arm(tmp_path) -> Path:
    path = tmp_path / "folding.urdf"
    path.write_text(folding())
    return path


def least(path: Path, plan: Path) -> tuple[float, float]:
    """Least distance of the base and the hand's cylinder, and height of the lowest link frame, by Coal alone."""
    robot, motion = load_robot(path), load_plan(plan).sample(250.0)
    R, p = forward_kinematics(robot, motion.q)
    box, rod = coal.Box(0.3, 0.3, 0.1), coal.Cylinder(0.04, 0.3)
    at = coal.Transform3s(np.eye(3), np.array([0.0, 0.0, 0.05]))
    request, found = coal.DistanceRequest(), []
    for turn, place in zip(R[:, 2], p[:, 2], strict=True):
        placed = coal.Transform3s(turn, place + turn @ [0.0, 0.0, 0.2])
        found.append(coal.distance(box, at, rod, placed, request, coal.DistanceResult()))
    return min(found), float(p[:, 1:, 2].min())


def test_bodies_keep_apart_by_default(arm, tmp_path, capsys):
    """From each other and from the floor that the arm stands on, in every account of the plan."""
    code, text, told = run(["excite", arm, *QUICK, "--out", tmp_path / "plan"], capsys)
    assert code == 0
    apart, lowest = least(arm, tmp_path / "plan" / "plan.json")
    assert apart > 0.02 - 1e-4 and lowest > 0.0
    report = json.loads((tmp_path / "plan" / "preflight.json").read_text())
    assert report["verdict"] == "pass" and report["collisions"] == "checked"
    pairs = {each["pair"] for each in report["approaches"]}
    assert {"hand - base", "middle - base", "hand - assumed floor"} <= pairs
    assert "floor-assumed" in {each["code"] for each in report["findings"]}
    assert (
        "✓ every limit holds (torque without friction and rotor inertia), and" in text and "bodies keep apart" in text
    )
    page = prose(tmp_path / "plan" / "preflight.html")
    assert "✓ every limit holds (torque without friction and rotor inertia), and" in page
    assert page.index("Motion") < page.index("Expected accuracy")
    assert "1 times" not in text and "with the ways" not in text and "…3.0000 rad" in text
    assert "change its height with --floor HEIGHT" in told
    assert "; change its height with --floor HEIGHT" in (tmp_path / "plan" / "preflight.txt").read_text()


def test_the_preview_and_the_report_say_the_same_distance(arm, tmp_path, capsys):
    """The page beside the plan, the page made of it later, and the report."""
    run(["excite", arm, *QUICK, "--out", tmp_path / "plan"], capsys)
    report = json.loads((tmp_path / "plan" / "preflight.json").read_text())
    nearest = min(each["distance"] for each in report["approaches"])
    run(["preview", arm, tmp_path / "plan", "--out", tmp_path / "again.html"], capsys)
    for page in (tmp_path / "plan" / "preview.html", tmp_path / "again.html"):
        seen = distances(page)
        # Moments of the page lie 13 ms apart; where bodies are nearest they hardly move.
        assert seen.min() == pytest.approx(nearest, abs=2e-3)


def test_what_is_left_out_is_called_unchecked_everywhere(arm, tmp_path, capsys):
    folder = tmp_path / "plan"
    code, text, err = run(["excite", arm, *QUICK, "--no-collision", "--out", folder], capsys)
    assert code == 0
    limits = "every limit holds (torque without friction and rotor inertia)"
    said = f"{limits}; collisions not checked: the check was left out (--no-collision)"
    report = json.loads((folder / "preflight.json").read_text())
    assert (report["verdict"], report["said"]) == ("not checked", said)
    for account in (text, (folder / "preflight.txt").read_text(), prose(folder / "preflight.html")):
        assert said in account and "✓" not in account
    assert said[1:] in prose(folder / "preview.html")
    assert "collisions were not checked" in " ".join(err.split())
    assert json.loads((folder / "plan.json").read_text())["verdict"] == "not checked"


def test_looks_stand_in_where_there_are_no_collision_bodies(tmp_path, capsys):
    path = tmp_path / "folding.urdf"
    path.write_text(folding("visual"))
    code, _, err = run(["excite", path, *QUICK, "--no-report", "--out", tmp_path / "plan"], capsys)
    assert code == 0 and "bodies-from-visuals" in err
    assert least(path, tmp_path / "plan" / "plan.json")[0] > 0.02 - 1e-4


@pytest.mark.parametrize("asked", [[], ["--collision"], ["--floor", "0"]])
def test_meshes_that_are_not_there_are_an_error(asked, tmp_path, capsys):
    path = tmp_path / "folding.urdf"
    path.write_text(folding(last='<mesh filename="package://folding/hand.stl"/>'))
    code, _, err = run(["excite", path, *QUICK, *asked, "--out", tmp_path / "plan"], capsys)
    said = " ".join(err.split())
    assert code == 2 and not (tmp_path / "plan").exists()
    assert "hand" in said and "--package NAME=DIR" in said and "--no-collision" in said
    code, _, _ = run(["excite", path, *QUICK, "--no-collision", "--out", tmp_path / "plan"], capsys)
    assert code == 0


def test_a_plan_that_touches_is_no_plan(arm, tmp_path, capsys, monkeypatch):
    """Red in every account, no motion for a controller, and an exit code that says so."""
    design = excite_request.design_plan

    def touching(*arguments, **options):
        made = design(*arguments, **options)
        report = replace(made.preflight, approaches=(ClosestApproach(BodyPair("base", "hand"), -0.006, 2.2, 0.02),))
        return replace(made, preflight=report)

    monkeypatch.setattr(excite_request, "design_plan", touching)
    folder = tmp_path / "plan"
    code, text, err = run(["excite", arm, *QUICK, "--out", folder], capsys)
    said = "the distance of base - hand is -6 mm at 2.20 s, less than the required 20 mm"
    assert code == 1 and said in " ".join(err.split())
    page = prose(folder / "preflight.html")
    for account in (text, (folder / "preflight.txt").read_text(), page, prose(folder / "preview.html")):
        assert said in account.replace("The distance", "the distance") and "✓" not in account
    assert json.loads((folder / "preflight.json").read_text())["verdict"] == "fail"
    assert not list(folder.glob("*.csv"))


@pytest.mark.parametrize("asked", [["--floor", "0"], ["--environment", "cell.toml"]])
def test_what_contradicts_itself_is_refused(asked, arm, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cell.toml").write_text("[[sphere]]\nradius = 0.1\nxyz = [1, 0, 0]\n")
    code, _, err = run(["excite", arm, *QUICK, "--no-collision", *asked, "--out", "plan"], capsys)
    assert code == 2 and "--no-collision contradicts" in err


def test_the_floor_is_where_the_arm_stands_and_nowhere_else(arm, tmp_path, capsys):
    """Moved, left out, and not assumed where the arm hangs."""

    def told(*more) -> dict[str, str]:
        run(["excite", arm, *QUICK, "--no-report", "--out", tmp_path / "plan", *more], capsys)
        findings = json.loads((tmp_path / "plan" / "plan.json").read_text())["findings"]
        return {each["code"]: each["evidence"] for each in findings}

    def pairs() -> set[str]:
        report = json.loads((tmp_path / "plan" / "preflight.json").read_text())
        return {each["pair"].split(" - ")[1] for each in report["approaches"]}

    assert "--no-floor" in told("--no-floor")["floor-left-out"]
    assert not {"floor", "assumed floor"} & pairs()
    assert not {"floor-left-out", "floor-assumed"} & set(told("--floor", "-1.5"))
    assert "floor" in pairs()
    assert "gravity" in told("--gravity", "0", "0", "9.81")["floor-left-out"]
    arm.write_text(
        folding().replace('<origin xyz="0 0 0.05"/><geometry><box', '<origin xyz="0 0 -0.5"/><geometry><box')
    )
    assert "fixed to the base is at -550 mm" in told()["floor-left-out"]


def test_a_start_pose_that_the_joints_can_hold_is_found(tmp_path, capsys):
    """Without bodies, too: in the middle of its range gravity asks for more torque than the first joint has."""
    weak = '<limit lower="0.2" upper="2.7" velocity="2" effort="8"/>'
    text = re.sub("<collision>.*?</collision>", "", folding()).replace(LIMIT, weak, 1)
    path = tmp_path / "weak.urdf"
    path.write_text(text)
    code, _, err = run(["excite", path, *QUICK, "--no-report", "--out", tmp_path / "plan"], capsys)
    assert code == 0, err
    plan = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert "start-chosen" in {each["code"] for each in plan["findings"]}


def test_a_start_of_another_length_names_the_joints_in_order(arm, tmp_path, capsys):
    code, _, err = run(["excite", arm, *QUICK, "--start", "0,1", "--out", tmp_path / "plan"], capsys)
    assert code == 2 and "lift, bend, tilt" in err


def test_a_preview_without_its_meshes_shows_the_axes_and_says_so(tmp_path, capsys):
    path = tmp_path / "folding.urdf"
    path.write_text(folding(last='<mesh filename="package://folding/hand.stl"/>'))
    code, _, _ = run(["preview", path, "--out", tmp_path / "page.html"], capsys)
    assert code == 0
    said = prose(tmp_path / "page.html")
    assert "Parts of the arm are missing" in said and "package://folding/hand.stl" in said
    assert "Collisions are not checked" in said
    page = Page((tmp_path / "page.html").read_text(encoding="utf-8"))
    (axes,) = [found for _, found in page.elements if found.get("data-layer") == "skeleton"]
    assert "checked" in axes


def test_looks_whose_meshes_are_not_there_are_bodies_too(tmp_path, capsys):
    """A description that has nothing but them is not one without bodies."""
    path = tmp_path / "folding.urdf"
    rod = '<cylinder radius="0.05" length="0.3"/>'
    mesh = '<mesh filename="package://folding/rod.stl"/>'
    path.write_text(folding("visual", mesh).replace(rod, mesh).replace('<box size="0.3 0.3 0.1"/>', mesh))
    code, _, err = run(["excite", path, *QUICK, "--out", tmp_path / "plan"], capsys)
    assert code == 2 and "4 visual meshes are missing" in " ".join(err.split())


def test_sweeps_go_as_far_as_bodies_let_them(arm, tmp_path, capsys):
    """By default; and what was left out is called so."""
    sweeps = ["excite", arm, "--experiment", "sweeps", "--no-report", "--format", "csv"]
    code, _, err = run([*sweeps, "--out", tmp_path / "kept"], capsys)
    assert code == 0 and "not checked" not in err
    code, _, err = run([*sweeps, "--no-collision", "--out", tmp_path / "free"], capsys)
    assert code == 0 and "collisions were not checked: the check was left out (--no-collision)" in " ".join(
        err.split()
    )
    kept, free = (np.array(json.loads((tmp_path / k / "plan.json").read_text())["poses"]) for k in ("kept", "free"))
    assert np.ptp(kept[:, 1]) < np.ptp(free[:, 1])  # the elbow folds onto the upper arm
