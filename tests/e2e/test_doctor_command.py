"""`armid doctor` as people and programs call it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from armid.cli.main import main
from labs import small_recording, write_arm, write_recording, write_recordings, write_study

KEYS = {"code", "severity", "channel", "evidence", "effect", "remedy", "recording"}


def called(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as end:
        main(["doctor", *arguments])
    return int(end.value.code or 0), capsys.readouterr().out


def test_a_sound_study_is_done(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    write_recordings(tmp_path)
    code, out = called(capsys, str(write_study(tmp_path)), "--json")
    record = json.loads(out)
    assert code == 0 and list(record) == ["findings"]
    assert not [f for f in record["findings"] if f["severity"] == "error"]


def test_a_turned_torque_is_an_error_with_its_remedy(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    log = small_recording(1)
    assert log.effort is not None
    path = write_recording(replace(log, effort=-log.effort), tmp_path / "run.csv")
    code, out = called(capsys, str(write_arm(tmp_path)), str(path), "--json")
    first = json.loads(out)["findings"][0]
    assert code == 1 and set(first) == KEYS
    assert (first["code"], first["severity"], first["remedy"]) == ("torque-sign", "error", "torque_sign = -1")
    assert called(capsys, str(tmp_path / "small.urdf"), str(path), "--torque-sign", "-1", "--json")[0] == 0


def test_people_see_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = write_recording(small_recording(1), tmp_path / "run.csv", clock=False)
    code, out = called(capsys, str(write_arm(tmp_path)), str(path))
    assert code == 1 and "clock-missing" in out and "--rate" in out


def test_people_without_a_study_are_told_an_option_or_the_study_they_need(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    log = small_recording(1)
    assert log.effort is not None and log.time is not None
    arm = str(write_arm(tmp_path))
    turned = write_recording(replace(log, effort=-log.effort), tmp_path / "turned.csv")
    assert "--torque-sign -1" in called(capsys, arm, str(turned))[1]
    slow = write_recording(replace(log, time=1e3 * log.time), tmp_path / "slow.csv")
    out = called(capsys, arm, str(slow))[1]
    assert "--time-unit 0.001" in out and "in a study.toml:" not in out
    one = log.effort * [1.0, 1.0, -1.0]
    out = called(capsys, arm, str(write_recording(replace(log, effort=one), tmp_path / "one.csv")))[1]
    assert "in a study.toml:" in out and "torque_sign = [1, 1, -1]" in out and "[[recording]]" in out


def test_bad_input_is_no_finding(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert called(capsys, str(write_arm(tmp_path)))[0] == 2
    assert called(capsys, str(tmp_path / "small.urdf"), str(tmp_path / "none.csv"))[0] == 2
