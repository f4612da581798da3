"""`armid track` as a user meets it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from command_line import Armid, command_line
from labs import small_recording, write_arm, write_recording


@pytest.fixture
def armid(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Armid:
    """The command line in a folder with a small arm, a run and a later recording."""
    write_arm(tmp_path)
    for k in (1, 2):
        write_recording(small_recording(k), tmp_path / f"day{k}.npz")

    run = command_line(capfd, monkeypatch, tmp_path)
    code, _, err = run("identify", "small.urdf", "day1.npz", "--out", "run", "--no-report")
    assert code == 0, err
    return run


def test_a_track_is_printed_and_written(armid: Armid):
    code, out, err = armid("track", "run", "day2.npz", "--tool", "--memory", 5, "--out", "track")
    assert code == 0, err
    assert "innovation" in out and "Largest changes" in out and "estimates over time written to track" in out
    record = json.loads(Path("track/track.json").read_text())
    assert record["memory"] == 5.0 and record["changed"] == "tool" and record["events"] == []
    table = np.genfromtxt("track/track.csv", delimiter=",", names=True)
    assert len(table) == len(record["time"]) == len(record["surprise"])
    names = [each["name"] for each in record["parameters"]]
    assert names[-10:-8] == ["M", "MX"] and set(names) <= set(table.dtype.names)
    again, out, _ = armid("track", "run", "day2.npz", "--memory", "inf", "--json")
    assert again == 0 and json.loads(out)["memory"] is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("day1.npz",), "must be a new recording"),
        (("day2.npz", "--tool", "--all"), "--tool and --all"),
        (("day2.npz", "--memory", "-1"), "above 0 s"),
        (("day2.npz", "--out", "run"), "run"),
        (("nowhere.npz",), "nowhere.npz"),
    ],
)
def test_bad_input_is_one_message(armid: Armid, arguments: tuple[str, ...], message: str):
    code, out, err = armid("track", "run", *arguments)
    assert code == 2 and message in err and not out
    assert not Path("track").exists()
