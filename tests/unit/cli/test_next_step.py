"""`armid` alone looks at the working folder and says what to do next."""

from __future__ import annotations

import os
from pathlib import Path

from armid.cli.folder_overview import DESCRIPTIONS, next_step
from armid.robot.readers import READERS


def test_an_empty_folder_gets_the_beginning(tmp_path: Path):
    assert "armid demo" in next_step(tmp_path) and "armid --help" in next_step(tmp_path)


def test_an_arm_then_a_log_then_a_study_then_runs(tmp_path: Path):
    (tmp_path / "arm.urdf").touch()
    assert "armid excite arm.urdf" in next_step(tmp_path)
    (tmp_path / "monday.csv").touch()
    assert "armid identify arm.urdf monday.csv" in next_step(tmp_path)
    (tmp_path / "study.toml").touch()
    assert "armid identify study.toml" in next_step(tmp_path)
    for age, name in enumerate(("today", "before")):
        estimate = tmp_path / "runs" / name / "estimate.json"
        estimate.parent.mkdir(parents=True)
        estimate.touch()
        os.utime(estimate, (1e9 - age, 1e9 - age))
    assert "armid report runs/today" in next_step(tmp_path)


def test_logs_are_what_readers_read_vague_names_last_and_bags_are_folders(tmp_path: Path):
    (tmp_path / "arm.urdf").touch()
    bag = tmp_path / "monday" / "metadata.yaml"
    bag.parent.mkdir()
    bag.touch()
    assert "armid doctor arm.urdf monday" in next_step(tmp_path)
    for name in ("notes.txt", "run.pq"):
        (tmp_path / name).touch()
    assert "armid doctor arm.urdf run.pq" in next_step(tmp_path)
    for name in ("a.csv.gz", "b.tsv"):
        (tmp_path / name).touch()
        assert "armid doctor arm.urdf a.csv.gz" in next_step(tmp_path)


def test_descriptions_are_those_of_the_readers():
    """But for DH tables, whose suffix is that of studies."""
    suffixes = {suffix for form in READERS.values() for suffix in form.suffixes}
    assert {*DESCRIPTIONS, ".toml"} == suffixes
