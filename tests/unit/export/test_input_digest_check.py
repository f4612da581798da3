"""Description of a run, found again: unchanged, changed, and stored with the digest of earlier versions."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import pytest

from armid.errors import OutputError
from armid.export.input_digest_check import find_source
from armid.robot import load_robot
from armid.robot.mjcf.mesh_assets import MeshAssets
from armid.runs.run import Run
from exports import run_of
from mesh_texts import prism, write_mesh

ASSET = '<asset><mesh name="m" file="m.stl"/></asset>'
BODY = '<body name="a"><joint name="j"/><geom type="mesh" mesh="m"/></body>'


def described(folder: Path, *, included: bool) -> Path:
    """An MJCF whose inertia follows from a mesh; its bodies are in a second file if `included`."""
    path, body = folder / "arm.xml", BODY
    if included:
        (folder / "body.xml").write_text(f"<mujoco>{BODY}</mujoco>")
        body = '<include file="body.xml"/>'
    path.write_text(f"<mujoco>{ASSET}<worldbody>{body}</worldbody></mujoco>")
    write_mesh(folder / "m.stl", *prism())
    return path


def stored(folder: Path, path: Path, sha256: str) -> Run:
    """A run of the description that has this digest of it."""
    run = run_of(folder / "run", path)
    robot = {"description": str(path), "gravity": None, "lock": [], "tip": None, "only": []}
    (folder / "run" / "study.json").write_text(json.dumps({"robot": robot, "folder": ".", "recordings": []}))
    return replace(run, robot=replace(run.robot, sha256=sha256))


@pytest.mark.parametrize("included", [False, True])
def test_runs_of_earlier_versions_have_a_digest_without_meshes(tmp_path, monkeypatch, included: bool):
    path = described(tmp_path, included=included)
    with monkeypatch.context() as context:
        context.setattr(MeshAssets, "inertia_files", lambda self: [])
        former = load_robot(path).sha256
    assert former != load_robot(path).sha256
    if not included:
        assert former == hashlib.sha256(path.read_bytes()).hexdigest()
    run = stored(tmp_path, path, former)
    assert find_source(run).path == str(path)
    changed = tmp_path / ("body.xml" if included else "arm.xml")
    changed.write_text(changed.read_text().replace('name="a"', 'name="b"'))
    with pytest.raises(OutputError, match="has changed since the identification"):
        find_source(run)


def test_a_run_with_the_digest_of_meshes_notices_a_changed_mesh(tmp_path):
    path = described(tmp_path, included=False)
    run = stored(tmp_path, path, load_robot(path).sha256)
    assert find_source(run).path == str(path)
    vertices, faces = prism()
    write_mesh(tmp_path / "m.stl", 1.1 * vertices, faces)
    with pytest.raises(OutputError, match="has changed since the identification"):
        find_source(run)
