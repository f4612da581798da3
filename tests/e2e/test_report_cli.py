"""`armid report`, and the page that `identify` and `demo` leave in their run."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from armid.report import page as pages
from armid.report import rendering
from command_line import exit_code as armid
from labs import write_recordings, write_study
from reports import Page

pytest.importorskip("plotly")
pytest.importorskip("jinja2")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small arm's study, and two runs of it: with a page, and of other terms without one."""
    folder = tmp_path_factory.mktemp("small")
    write_recordings(folder)
    study = write_study(folder)
    assert armid("identify", study, "--out", folder / "run") == 0
    terms = "rigid-body,viscous,coulomb"
    assert armid("identify", study, "--terms", terms, "--no-report", "--out", folder / "other") == 0
    return folder


def test_identify_leaves_a_page_in_the_run(small: Path):
    page = Page((small / "run" / "report.html").read_text(encoding="utf-8"))
    assert "FV_3" in page.words and len(page.data["plots"]) > 20


def test_identify_leaves_none_where_none_is_wanted(small: Path):
    assert (small / "other" / "estimate.json").is_file() and not (small / "other" / "report.html").exists()


def test_report_writes_where_it_is_told(small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert armid("report", small / "run", "--out", tmp_path / "page.html") == 0
    assert capsys.readouterr().out == f"page written to {tmp_path / 'page.html'}\n"
    assert (tmp_path / "page.html").read_bytes() == (small / "run" / "report.html").read_bytes()


def test_report_writes_into_the_run_by_default(small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    run = shutil.copytree(small / "other", tmp_path / "run")
    assert armid("report", run, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found == {"report": str(run / "report.html"), "bytes": (run / "report.html").stat().st_size}


def test_two_runs_are_compared(small: Path, tmp_path: Path):
    assert armid("report", small / "run", small / "other", "--out", tmp_path / "change.html") == 0
    page = Page((tmp_path / "change.html").read_text(encoding="utf-8"))
    assert "Only in" in page.prose and "FO_2" in page.prose  # the offset that one of them has


def test_what_is_no_run_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert armid("report", tmp_path) == 2
    assert "is not a run of armid" in capsys.readouterr().err


def test_without_the_extra(small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd):
    """`identify` goes on and says in one line how to get it; `report` cannot."""
    monkeypatch.setattr(rendering, "find_spec", lambda name: None)
    assert armid("identify", small / "study.toml", "--out", tmp_path / "run", "--json") == 0
    out, err = capfd.readouterr()
    assert json.loads(out)["run"] == str(tmp_path / "run")
    said = [line for line in err.splitlines() if "report" in line]
    assert len(said) == 1 and said[0].startswith("no report.html") and "armid[report]" in said[0]
    assert not (tmp_path / "run" / "report.html").exists()
    assert armid("report", tmp_path / "run") == 2
    assert "armid[report]" in capfd.readouterr().err


def test_an_interrupted_page_leaves_the_run(
    small: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    def stopped(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(pages, "render", stopped)
    assert armid("identify", small / "study.toml", "--out", tmp_path / "run") == 0
    assert capsys.readouterr().err.endswith("no report.html: interrupted\n")
    assert (tmp_path / "run" / "estimate.json").is_file() and not (tmp_path / "run" / "report.html").exists()
