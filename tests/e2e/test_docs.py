"""Every command and snippet of the tutorials works as it stands, in a folder that holds what the page says."""

from __future__ import annotations

import ast
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from paged import DOCS, blocks, commands, follow, mentioned, pages, understood

pytest.importorskip("mujoco")
pytest.importorskip("plotly")
pytest.importorskip("rosbags")

PAGES = pages()

LARGEST = 6_000_000
"""Bytes of the page of a run from five periods of 27 s at 8 kHz, as the demo's: what can still be mailed."""

AFTER = {"tutorials/ros_bag.md": "arm", "tutorials/payload.md": "arm"}
"""Pages that go on where another ended, with the folder that this one leaves."""


RUNS = ("bag", "from_bag")
"""Runs of the page on bags."""


CLEARLY, BY_CHANCE = 10.0, 5.0
"""Deviations that friction has changed by, fallen by a quarter, and that chance does not reach in 24 parameters."""


BOX = {
    "M": 1.2, "MX": 0.36, "MY": 0.0, "MZ": 0.06,
    "XX": 0.006, "XY": 0.0, "XZ": -0.018, "YY": 0.114, "YZ": 0.0, "ZZ": 0.111,
}  # fmt: skip
"""The box of the page on loads: 1.2 kg at (0.3, 0, 0.05) m, 0.003 kg·m² about each axis, in the forearm's frame."""


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of the first tutorial; to follow it is its test."""
    folder = tmp_path_factory.mktemp("arm")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert follow(PAGES["tutorials/own_arm.md"]) > 8
    return folder


def test_the_first_tutorial(arm: Path):
    assert (arm / "arm_identified.urdf").is_file() and (arm / "runs" / "python" / "estimate.json").is_file()
    for name in ("arm", "study"):
        assert (arm / "runs" / name / "report.html").is_file()
    assert (arm / "arm_identified.urdf").read_text() != (arm / "arm.urdf").read_text()


def test_the_first_tutorial_ends_in_a_model_that_is_right(arm: Path):
    """Its intervals hold the truth of the lab, and its error on training motion is that on unseen motion."""
    truth = json.loads((arm / "train" / "truth.json").read_text())["base_parameters"]
    estimate = json.loads((arm / "runs" / "arm" / "estimate.json").read_text())
    ends = [(truth.get(each["name"], 0.0), *each["interval95"]) for each in estimate["base_parameters"]]
    held = [low <= true <= high for true, low, high in ends]
    assert len(held) == 24 and sum(held) >= 21  # of 24 at 95 %, one draw in a hundred has more than three outside
    (unseen,) = json.loads((arm / "runs" / "arm" / "validation.json").read_text())["recordings"]
    ratio = np.linalg.norm(unseen["rms"]) / np.linalg.norm(estimate["residual"]["rms"])
    assert 0.7 < ratio < 1.5
    assert "period-found" in {each["code"] for each in estimate["warnings"]}


def test_recalibration_finds_the_friction_that_changed(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """The page says that the old model fails with exit code 1, and what has changed."""
    page = PAGES["tutorials/recalibration.md"]
    assert "armid validate runs/arm later/recording.csv  # exit code 1" in page
    shutil.copytree(arm, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    assert follow(page) >= 3
    out = capsys.readouterr().out
    assert out.count("verdict on held-out motion: fail") == 1 and out.count("verdict on held-out motion: pass") == 1
    table = out.split("changed beyond their 95 % intervals")[1].split("not changed")[0]
    rows = re.findall(r"│ (\w+) +│.*│ +(-?[\d.]+) │ +([\d.]+) │", table)
    listed = {name: abs(float(change)) / float(half) for name, change, half in rows}
    friction = {f"{name}_{j}" for name in ("FV", "FS") for j in (1, 2, 3)}
    assert min(listed[name] for name in friction) > CLEARLY
    assert max((by for name, by in listed.items() if name not in friction), default=0.0) < BY_CHANCE


@pytest.mark.parametrize("page", AFTER)
def test_tutorials_that_go_on(page: str, arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    shutil.copytree(arm, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    assert follow(PAGES[page]) >= 3
    if page == "tutorials/ros_bag.md":
        verdicts = [
            json.loads((tmp_path / "runs" / name / "validation.json").read_text())["verdict"] for name in RUNS
        ]
        assert verdicts == ["pass", "pass"]
    if page == "tutorials/payload.md":
        load = json.loads((tmp_path / "load" / "payload.json").read_text())["parameters"]
        held = [low <= BOX[each["name"]] <= high for each in load for low, high in [each["interval95"]]]
        assert len(held) == 10 and sum(held) >= 8  # of 10 at 95 %, one draw in eighty has more than two outside
        assert {each["status"] for each in load} == {"identified"}


def test_the_first_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(tmp_path)
    assert follow(PAGES["start.md"]) == 4
    out = capsys.readouterr().out
    assert "verdict on held-out motion: pass" in out and "torque that holds this pose" in out
    assert (tmp_path / "runs" / "demo" / "report.html").stat().st_size < LARGEST


@pytest.mark.long
def test_the_tutorial_of_the_iiwa(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    assert follow(PAGES["tutorials/iiwa.md"]) >= 6
    assert "rotor-inertia-missing" in capsys.readouterr().out
    assert (tmp_path / "iiwa_identified.urdf").is_file()


def intervals(folder: Path, kind: str) -> dict[str, tuple[float, float]]:
    """Ends of the intervals of a kind of value in the result of `armid servo`, by joint."""
    values = json.loads((folder / "servo.json").read_text())["values"]
    return {each["joint"]: (each["low"], each["high"]) for each in values if each["kind"] == kind}


def test_the_tutorial_of_the_leg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The page says that known gains make the intervals narrow, and that the truth is found."""
    monkeypatch.chdir(tmp_path)
    assert follow(PAGES["tutorials/stand_leg.md"]) == 5
    truth = json.loads((tmp_path / "stand" / "truth.json").read_text())
    known, unknown = (intervals(tmp_path / name, "rotor_inertia") for name in ("leg", "unknown"))
    for j, joint in enumerate(truth["joints"]):
        true = truth["parameters"][f"IA_{j + 1}"]
        assert unknown[joint][0] < true < unknown[joint][1]
        assert known[joint][1] / known[joint][0] < unknown[joint][1] / unknown[joint][0]
    (score,) = json.loads((tmp_path / "leg" / "servo.json").read_text())["validation"]["model"]["runs"]
    assert score < 0.3e-3  # the step of the encoder is 0.38 mrad


@pytest.mark.long
def test_the_tutorial_of_the_hobby_arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("pyarrow")
    monkeypatch.chdir(tmp_path)
    assert follow(PAGES["tutorials/hobby_arm.md"]) == 5
    truth = json.loads((tmp_path / "pick" / "truth.json").read_text())
    stiffness = intervals(tmp_path / "hobby", "stiffness")
    held = [
        low < true < high for true, (low, high) in zip(truth["servo"]["stiffness"], stiffness.values(), strict=True)
    ]
    assert sum(held) >= 5  # of 6 at 95 %
    width = {joint: high / low for joint, (low, high) in stiffness.items()}
    assert min(width["roll"], width["grip"]) > max(width["lift"], width["elbow"])
    assert (tmp_path / "plan" / "lerobot" / "meta" / "info.json").is_file()


@pytest.mark.parametrize("page", [*PAGES, "README.md"])
def test_commands_and_snippets_of_every_page_are_understood(page: str):
    """Reference pages show commands for files that only the reader has: these parse, and so does their Python."""
    text = PAGES[page] if page in PAGES else (DOCS.parent / page).read_text(encoding="utf-8")
    for command in mentioned(text):
        understood(command)
    for block in blocks(text):
        if block.language == "python":
            ast.parse(block.text)


def test_reference_pages_mention_commands():
    assert sum(len(mentioned(text)) for text in PAGES.values()) > 60


def test_what_is_not_run_says_so():
    """Commands of tutorials are armid's own, or stand below a line that says that nobody runs them."""
    strange = [
        command
        for page, text in PAGES.items()
        for block in blocks(text)
        if block.run and block.language == "bash"
        for command in commands(block.text)
        if not command.startswith("armid ")
    ]
    assert strange == []
