"""Collada meshes in other units than metres: bodies and pictures have the size of the arm."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from armid.checked_array import Array
from armid.errors import MissingExtraError, RobotError
from armid.excitation.collision.coal import mesh_faces
from armid.excitation.collision.mesh_hulls import outline_of
from armid.robot.collada_unit import collada_unit
from armid.robot.shapes import Shape
from mesh_texts import collada, prism

pytestmark = pytest.mark.collision

SINGLE = 1e-6
"""Relative rounding of coordinates that the reader of meshes keeps in single precision."""

INCH = '<unit meter="0.0254" name="inch"/>'


def corners_of(path: Path, scale: float = 1.0) -> Array:
    return mesh_faces(Shape("body", 0, "mesh", np.full(3, scale), np.eye(4), str(path)))[0]


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("ARMID_CACHE", str(tmp_path / "cache"))


@pytest.mark.parametrize("axis", ["", "<up_axis>Z_UP</up_axis>", "<up_axis>Y_UP</up_axis>"])
@pytest.mark.parametrize(("unit", "metres"), [("", 1.0), (INCH, 0.0254), ('<unit name="meter"/>', 1.0)])
def test_a_mesh_has_its_size_in_metres_and_is_not_turned(tmp_path: Path, unit: str, metres: float, axis: str):
    vertices, faces = prism()
    path = tmp_path / "part.dae"
    path.write_text(collada(vertices / metres, faces, unit + axis))
    found = corners_of(path)
    np.testing.assert_allclose(np.unique(found.round(6), axis=0), np.unique(vertices.round(6), axis=0), atol=SINGLE)
    np.testing.assert_allclose(corners_of(path, 2.0), 2.0 * found, rtol=SINGLE)


def test_outlines_for_the_search_have_the_size_of_the_body(tmp_path: Path):
    vertices, faces = prism()
    path = tmp_path / "part.dae"
    path.write_text(collada(vertices / 0.0254, faces, INCH))
    outline = outline_of(Shape("body", 0, "mesh", np.ones(3), np.eye(4), str(path)))
    reached = np.array([np.abs(part.corners).max() for part in outline.parts])
    assert reached.max() == pytest.approx(np.abs(vertices).max(), rel=SINGLE)


@pytest.mark.parametrize("meter", ["0", "-1", "nan", "inch"])
def test_a_unit_that_is_no_length_is_refused(tmp_path: Path, meter: str):
    path = tmp_path / "part.dae"
    path.write_text(collada(*prism(), f'<unit meter="{meter}"/>'))
    with pytest.raises(RobotError, match=f'found <unit meter="{meter}">'):
        corners_of(path)


def test_other_and_damaged_files_have_no_unit(tmp_path: Path):
    stl, torn = tmp_path / "part.stl", tmp_path / "torn.dae"
    stl.write_text(f"<COLLADA><asset>{INCH}</asset></COLLADA>")
    torn.write_text("<COLLADA><asset><<<")
    assert [collada_unit(str(path)) for path in (stl, torn, tmp_path / "none.dae")] == [1.0, 1.0, 1.0]
    late = tmp_path / "late.dae"
    late.write_text(f"<COLLADA><asset/><library><asset>{INCH}</asset></library></COLLADA>")
    assert collada_unit(str(late)) == 1.0


def test_without_coal_the_extra_to_install_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "body.dae"
    path.write_text(collada(*prism()))
    monkeypatch.setitem(sys.modules, "coal", None)
    with pytest.raises(MissingExtraError, match=r"armid\[collision\]"):
        corners_of(path)
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(MissingExtraError, match=r"no wheels for Windows[^\0]*Subsystem for Linux"):
        corners_of(path)
