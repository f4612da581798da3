"""docs/lab.md says what the lab is: its lab.toml is read, its tables name what there is, its Python runs."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from armid.lab.controller import CONTROLLERS
from armid.lab.faults import FAULTS
from armid.lab.known_arms import EFFECTS, OWN
from armid.lab.options import LabOptions, parse_options

PAGE = (Path(__file__).parents[2] / "docs" / "lab.md").read_text()


def block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    return found[1]


def test_the_file_is_read_and_names_every_option():
    table = tomllib.loads(block("toml"))
    found = parse_options(table)
    assert found.sensing.effort.delay == 2e-3 and len(found.faults) == 1

    def missing(value: Any, table: dict[str, Any], where: str) -> list[str]:
        names = [f"{where}{f.name}" for f in dataclasses.fields(value) if f.name not in table]
        for name, inner in table.items():
            if isinstance(inner, dict) and where == "" and name != "arm":
                names += missing(getattr(value, name), inner, f"{name}.")
        return names

    assert missing(LabOptions(), table, "") == []


def test_tables_name_what_there_is():
    rows = re.findall(r"^\| `([\w-]+)` \|", PAGE, re.MULTILINE)
    assert set(rows) == {*EFFECTS, *OWN}
    for name in (*FAULTS, *CONTROLLERS):
        assert f"`{name}`" in PAGE or f'"{name}"' in PAGE


def test_the_python_runs(capsys: pytest.CaptureFixture[str]):
    exec(block("python"), {})
    assert capsys.readouterr().out.startswith("20000 ")
