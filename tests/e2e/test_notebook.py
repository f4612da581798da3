"""The notebook of the tutorials is executed from its first cell to its last; shell commands run in this process."""

from __future__ import annotations

import ast
import json
import shlex
from pathlib import Path
from typing import Any

import pytest

from armid.cli import main as cli
from paged import DOCS

pytest.importorskip("mujoco")
pytest.importorskip("plotly")

NOTEBOOK = DOCS / "tutorials" / "whole_job.ipynb"


def sources() -> list[str]:
    """Text of each cell of code."""
    cells: list[dict[str, Any]] = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    assert all(cell.get("outputs") in (None, []) for cell in cells), "clear all outputs before committing"
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


def run_cell(text: str, names: dict[str, Any]) -> Any:
    """Runs a cell as a notebook does: shell commands by the command line, and the value of the last expression."""
    lines = text.splitlines()
    for line in (each for each in lines if each.startswith("!")):
        program, *arguments = shlex.split(line[1:])
        assert program == "armid"
        try:
            cli.main(arguments)
        except SystemExit as ended:
            assert not ended.code, line
    body = ast.parse("\n".join(line for line in lines if not line.startswith("!"))).body
    last = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), str(NOTEBOOK), "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), str(NOTEBOOK), "eval"), names)


@pytest.mark.collision
def test_the_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    shown = [run_cell(text, names) for text in sources()]
    assert names["result"].validation.verdict == "pass"
    assert sum(names["inside"]) >= 0.85 * len(names["inside"]) > 0  # 95 % are expected, of some fifty values
    assert sum(value is not None for value in shown) >= 5
    for made in ("plans/train/preflight.html", "run/report.html", "identified.urdf", "code"):
        assert Path(made).exists(), made
    capsys.readouterr()
