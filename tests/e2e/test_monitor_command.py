"""`armid monitor` as it is typed: alarms, files, code, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from armid.lab.pushes import Push
from armid.runs.run import Run
from command_line import Armid, command_line
from labs import write_recording
from watched import moved, small_run

PUSH = Push(joint=1, torque=6.0, start=5.0, seconds=0.3)


@pytest.fixture
def armid(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Armid:
    return command_line(capfd, monkeypatch, tmp_path)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return small_run(tmp_path_factory.mktemp("monitored"))


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """A log with a push, and one without."""
    folder = tmp_path_factory.mktemp("logs")
    free = write_recording(moved(20, 5), folder / "reference.npz")
    return str(write_recording(moved(31, 1, PUSH), folder / "pushed.npz")), str(free)


def test_a_push_is_told_and_written(armid: Armid, run: Run, logs: tuple[str, str], tmp_path: Path):
    out, code = tmp_path / "external.csv", tmp_path / "code"
    told = armid("monitor", run.folder, logs[0], "--false-alarms", 60, "--out", out, "--code", code)
    assert told.code == 0 and "no safety function" in told.out and "joint_2" in told.out
    assert "rate-not-promised" in told.err
    assert out.read_text().startswith("t,tau_ext1") and (code / "small_monitor.c").is_file()
    record = armid("monitor", run.folder, logs[0], "--reference", logs[1], "--observer", "residual", "--json").json
    assert record["observer"] == "residual" and record["unseen"]["source"] == "reference"
    alarms = record["recordings"][0]["alarms"]
    assert any(each["joint"] == "joint_2" and abs(each["start"] - PUSH.start) < 0.1 for each in alarms)
    page = tmp_path / "alarms.html"
    armid("monitor", run.folder, logs[0], "--false-alarms", 60, "--out", tmp_path / "alarms.json", "--page", page)
    assert json.loads((tmp_path / "alarms.json").read_text())["false_alarms_per_hour"] == 60.0
    html = page.read_text(encoding="utf-8")
    assert "no safety function" in html and "This rate is extrapolated" in html and "rate-not-promised" in html
    assert all(f'"external-{j}"' in html for j in range(3)) and 'id="table-alarms"' in html


def test_help_says_what_it_is_not(armid: Armid):
    assert "no safety function" in " ".join(armid("monitor", "--help").out.split())


def test_wrong_requests_are_refused(armid: Armid, run: Run, logs: tuple[str, str], tmp_path: Path):
    for more, words in (
        (["--observer", "kalman"], "Unknown observer"),
        (["--false-alarms", "-1"], "must be positive"),
        (["--out", str(tmp_path / "alarms.txt")], "suffix"),
        (["--reference", logs[0]], "new recording"),
        (["--page", logs[0]], "not an HTML page"),
    ):
        refused = armid("monitor", run.folder, logs[0], *more)
        assert refused.code == 2 and words in " ".join(refused.err.split())
