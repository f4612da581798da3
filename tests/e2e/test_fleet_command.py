"""`armid fleet` and `armid identify --fleet`, as the page about fleets shows them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from armid.cli import main as cli
from fleets import MadeUnit, made_fleet, write_fleet
from labs import write_arm, write_recording
from paged import blocks, follow, pages

pytest.importorskip("plotly")

PAGE = pages()["fleet.md"]

BLOCKS = 4
"""Blocks of the page that are executed."""


def armid(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main(list(arguments))
    return int(ended.value.code or 0)  # pyright: ignore[reportArgumentType]


def write_cells(units: list[MadeUnit], folder: Path, ending: str = "") -> None:
    for k, unit in enumerate(units, 1):
        write_recording(unit.training, folder / f"cell-{k}{ending}.csv")


def test_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    write_arm(tmp_path).rename(tmp_path / "arm.urdf")
    units = made_fleet(5, 3)
    write_cells(units[:4], tmp_path)
    write_recording(units[0].validation, tmp_path / "cell-1-check.csv")
    write_recording(units[1].validation, tmp_path / "later.csv")
    write_recording(units[4].training, tmp_path / "new-arm.csv")
    write_cells(made_fleet(4, 3, odd={(1, "FV_1"): 1.6}), tmp_path, "-april")
    text = next(block.text for block in blocks(PAGE) if block.text.startswith("# FLEET.toml"))
    for k in range(1, 5):
        text = text.replace(f"cell-{k}.csv", f"cell-{k}-april.csv")
    (tmp_path / "APRIL.toml").write_text(text)
    assert follow(PAGE) == BLOCKS
    record = json.loads((tmp_path / "fleets" / "april" / "fleet.json").read_text())
    named = [(each["unit"], each["parameter"]) for each in record["changes"] if each["beyond"]]
    assert named == [("cell-2", "FV_1")]
    page = (tmp_path / "fleets" / "april" / "report.html").read_text()
    assert "Changed since fleets/march" in page and "cell-3" in page


def test_json_has_all_units(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(tmp_path)
    write_fleet([replace(unit, validation=unit.training) for unit in made_fleet(2, 1)], tmp_path)
    text = Path("FLEET.toml").read_text()
    Path("FLEET.toml").write_text("\n".join(line for line in text.splitlines() if "validate" not in line))
    assert armid("fleet", "FLEET.toml", "--json", "--no-report", "--out", "stored") == 0
    record = json.loads(capsys.readouterr().out)
    assert [unit["name"] for unit in record["units"]] == ["unit-01", "unit-02"]
    assert [each["code"] for each in record["warnings"]] == ["fleet-small"]
    assert not Path("stored/report.html").exists()


def test_nothing_is_written_if_a_recording_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    write_fleet(made_fleet(2, 1), tmp_path)
    Path("unit-01.npz").unlink()
    assert armid("fleet", "FLEET.toml", "--out", "stored") == 2
    assert not Path("stored").exists()


def test_a_run_is_no_earlier_fleet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    write_fleet(made_fleet(2, 1), tmp_path)
    Path("run").mkdir()
    assert armid("fleet", "FLEET.toml", "--since", "run") == 2
    assert "run is not a fleet of armid" in " ".join(capsys.readouterr().err.split())


def test_method_and_fleet_exclude_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    write_fleet(made_fleet(2, 1), tmp_path)
    assert armid("identify", "small.urdf", "unit-01.npz", "--fleet", "stored", "--method", "wls") == 2
    assert "--fleet and --method are both given" in " ".join(capsys.readouterr().err.split())
