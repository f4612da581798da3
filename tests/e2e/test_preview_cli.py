"""`armid preview`: arms, plans, recordings and runs on a page of their own."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from armid.excitation.fourier import save_plan
from command_line import exit_code as armid
from labs import URDF, small_plan, write_arm, write_recordings, write_study
from reports import Page, make_run

pytest.importorskip("jinja2")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small arm, a plan of it, recordings and a run."""
    folder = tmp_path_factory.mktemp("small")
    make_run(folder)
    write_arm(folder)
    save_plan(small_plan(1), folder / "plan.json")
    return folder


def shown(path: Path) -> dict[str, Any]:
    """Return what a page's script is given."""
    return Page(path.read_text(encoding="utf-8")).data


@pytest.mark.parametrize("motion", ["plan.json", "run2.csv", "run", None])
def test_an_arm_that_does_something(motion: str | None, folder: Path, tmp_path: Path, capsys):
    out = tmp_path / "page.html"
    arguments = [] if motion is None else [folder / motion]
    assert armid("preview", folder / "small.urdf", *arguments, "--floor", "-0.5", "--out", out, "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"preview": str(out), "bytes": out.stat().st_size, "findings": []}
    data = shown(out)
    assert data["duration"] == pytest.approx({"plan.json": 8.0, None: 0.0}.get(motion, 16.0), abs=0.02)
    assert [layer["name"] for layer in data["layers"]] == ["description", *(["estimate"] if motion == "run" else [])]
    assert [each["name"] for each in data["surroundings"]] == ["floor"]


def test_a_run_shows_what_it_was_judged_on(folder: Path, tmp_path: Path):
    run = shutil.copytree(folder / "run", tmp_path / "run")
    assert armid("preview", run) == 0
    page = Page((run / "preview.html").read_text(encoding="utf-8"))
    assert "run2.csv" in page.prose and "masses: estimate" in page.prose
    assert all(body["mass"] > 0.0 for layer in page.data["layers"] for body in layer["bodies"])


def test_recordings_that_are_gone_are_asked_for(folder: Path, tmp_path: Path, capsys):
    run = shutil.copytree(folder / "run", tmp_path / "run")
    record = json.loads((run / "study.json").read_text())
    (run / "study.json").write_text(json.dumps(record | {"folder": str(tmp_path)}))
    assert armid("preview", run) == 2
    assert "--data" in capsys.readouterr().err and not (run / "preview.html").exists()
    assert armid("preview", run, "--data", folder) == 0


@pytest.mark.parametrize("motion", ["nowhere.csv", "nowhere.json", "thesis-a1"])
def test_what_cannot_be_shown_is_refused(motion: str, folder: Path, tmp_path: Path, capsys):
    assert armid("preview", folder / "small.urdf", motion, "--out", tmp_path / "page.html") == 2
    assert motion in capsys.readouterr().err and not (tmp_path / "page.html").exists()


@pytest.mark.collision
def test_excite_leaves_pages_or_not(tmp_path: Path):
    options = ["--experiment", "sweeps", "--format", "csv"]
    assert armid("excite", "ur5e", *options, "--out", tmp_path / "with") == 0
    assert (tmp_path / "with" / "preview.html").is_file()
    assert armid("preview", "ur5e", tmp_path / "with", "--out", tmp_path / "again.html") == 0
    assert shown(tmp_path / "again.html")["q"] == shown(tmp_path / "with" / "preview.html")["q"]
    assert armid("preview", "ur5e", tmp_path / "with" / "plan.csv", "--out", tmp_path / "table.html") == 0
    assert armid("excite", "ur5e", *options, "--no-report", "--out", tmp_path / "without") == 0
    assert not (tmp_path / "without" / "preview.html").exists()


def test_missing_meshes_are_said_on_the_terminal(folder: Path, tmp_path: Path, capsys):
    text = (folder / "small.urdf").read_text()
    mesh = '<visual><geometry><mesh filename="nowhere.stl"/></geometry></visual></link>'
    (tmp_path / "arm.urdf").write_text(text.replace("</link>", mesh, 1) if "</link>" in text else text)
    out = tmp_path / "page.html"
    assert armid("preview", tmp_path / "arm.urdf", "--out", out) == 0
    said = capsys.readouterr()
    assert "joint axes and the lines between them" in said.out
    assert "visual-missing" in said.err and "nowhere.stl" in said.err and "--package" in said.err
    assert "nowhere.stl" in Page(out.read_text(encoding="utf-8")).prose
    assert armid("preview", tmp_path / "arm.urdf", "--out", out, "--json") == 0
    (finding,) = json.loads(capsys.readouterr().out)["findings"]
    assert finding["code"] == "visual-missing"
    assert armid("preview", folder / "small.urdf", "--out", out) == 0
    assert capsys.readouterr() == (f"page written to {out}\n", "")


@pytest.mark.collision
def test_meshes_of_a_run_are_found_in_a_package_that_is_given_later(tmp_path: Path, capsys):
    """Also where identify was called without the package, because meshes have no effect on the dynamics."""
    meshes = tmp_path / "elsewhere" / "arm_description" / "meshes"
    meshes.mkdir(parents=True)
    (meshes / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n")
    (tmp_path / "arm").mkdir()
    write_recordings(tmp_path / "arm")
    study = write_study(tmp_path / "arm")
    visual = '<visual><geometry><mesh filename="package://arm_description/meshes/a.obj"/></geometry></visual>'
    (tmp_path / "arm" / "small.urdf").write_text(
        URDF.replace('<link name="link_2">', f'<link name="link_2">{visual}')
    )
    run, page = tmp_path / "run", tmp_path / "page.html"
    assert armid("identify", study, "--out", run, "--no-report") == 0
    assert armid("preview", run, "--out", page) == 0
    assert "--package NAME=DIR" in capsys.readouterr().err
    package = f"arm_description={meshes.parent}"
    assert armid("preview", run, "--package", package, "--out", page) == 0
    assert "--package" not in capsys.readouterr().err and len(shown(page)["meshes"]) == 1
