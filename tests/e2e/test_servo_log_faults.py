"""`armid doctor` and `armid servo` say what is wrong with the commands of a log."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from command_line import Armid, command_line

pytest.importorskip("mujoco")


@pytest.fixture
def armid(capfd, monkeypatch, tmp_path) -> Armid:
    return command_line(capfd, monkeypatch, tmp_path)


def renamed(path: Path, names: dict[str, str], to: Path) -> None:
    """Table with other names of columns."""
    with path.open(newline="") as file:
        header, *rows = csv.reader(file)
    with to.open("w", newline="") as file:
        csv.writer(file).writerows([[names.get(name, name) for name in header], *rows])


def test_exchanged_columns_are_told_and_mended(armid, tmp_path):
    assert armid("simulate", "stand-leg", "--servo", "--seconds", 8, "--out", "lab").code == 0
    swap = {f"q{j}": f"command{j}" for j in (1, 2, 3)} | {f"command{j}": f"q{j}" for j in (1, 2, 3)}
    renamed(tmp_path / "lab" / "recording.csv", swap, tmp_path / "swapped.csv")
    arm, gains = "lab/stand-leg.xml", ("--stiffness", 25, "--damping", 0.8)

    sound = armid("doctor", arm, "lab/recording.csv", "--json")
    assert sound.code == 0 and [each["code"] for each in sound.json["findings"]] == ["effort-missing"]
    told = armid("doctor", arm, "swapped.csv", "--json")
    (error,) = [each for each in told.json["findings"] if each["severity"] == "error"]
    assert told.code == 1 and error["code"] == "command-exchanged" and "columns" in error["remedy"]

    columns = ("--columns", "q=command{}", "--columns", "command=q{}")
    mended = armid("doctor", arm, "swapped.csv", *columns, "--json")
    assert mended.code == 0, mended.out

    wrong = armid("servo", arm, "swapped.csv", *gains, "--out", "result", "--json")
    warnings = wrong.json["warnings"] if wrong.out else []
    assert "command-exchanged" in {each["code"] for each in warnings} or "command-exchanged" in wrong.err
