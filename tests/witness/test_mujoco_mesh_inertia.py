"""Inertia of bodies from meshes and primitives against what MuJoCo's own compiler makes of the same file."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from armid.excitation.collision.coal import mesh_faces
from armid.maths.inertia import vector_to_com_inertia
from armid.robot import load_robot
from mesh_texts import prism, write_mesh

SINGLE = 1e-6
"""Relative, and absolute in metres: MuJoCo keeps vertices, and what turns them, in single precision."""

SOLIDS = (
    '<geom type="box" size=".1 .2 .3" pos="1 0 0"/> <geom size=".1" pos="1 1 1"/>'
    '<geom type="capsule" fromto="0 0 0 .3 .1 .2" size=".05"/> <geom type="box" fromto="0 0 0 .3 .1 .2" size=".05"/>'
    '<geom type="ellipsoid" size=".1 .2 .15" euler="1 30 70"/> <geom type="cylinder" size=".1 .2" mass="1.5"/>'
)


def check(path, text: str) -> None:
    """Compares mass, centre of mass and inertia of the body `a` of an MJCF."""
    path.write_text(text)
    model = mujoco.MjModel.from_xml_path(str(path))
    k = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "a")
    turned = np.zeros(9)
    mujoco.mju_quat2Mat(turned, model.body_iquat[k])
    axes = turned.reshape(3, 3)
    expected = axes @ np.diag(model.body_inertia[k]) @ axes.T
    robot = load_robot(path)
    assert "inertial-missing" not in {finding.code for finding in robot.findings}
    mass, com, inertia = vector_to_com_inertia(robot.inertial_vector[0])
    assert mass == pytest.approx(model.body_mass[k], rel=SINGLE)
    np.testing.assert_allclose(com, model.body_ipos[k], rtol=0, atol=SINGLE)
    np.testing.assert_allclose(inertia, expected, rtol=0, atol=SINGLE * np.abs(expected).max())


def document(mesh: str, geoms: str, *, compiler: str = "", rest: str = "") -> str:
    return (
        f"<mujoco><compiler {compiler}/>{rest}<asset><mesh {mesh}/></asset><worldbody><body name='a'>"
        f"<joint name='j'/>{geoms}</body></worldbody></mujoco>"
    )


@pytest.mark.parametrize("mode", ["", 'inertia="legacy"', 'inertia="exact"', 'inertia="convex"', 'inertia="shell"'])
@pytest.mark.parametrize(
    "placed", ["", 'scale="-1 2 1"', 'refpos=".1 .2 .3" refquat="0.7 0.7 0.3 0.1" scale="1 2 3"']
)
@pytest.mark.parametrize("geom", ["", 'mass="2" pos=".1 .2 .3" euler="10 20 30"', 'density="300"'])
def test_modes_and_placements_of_a_mesh(tmp_path, mode: str, placed: str, geom: str):
    write_mesh(tmp_path / "l.stl", *prism())
    mesh = f'name="m" file="l.stl" {mode} {placed}'
    check(tmp_path / "arm.xml", document(mesh, f'<geom type="mesh" mesh="m" {geom}/>{SOLIDS}'))


@pytest.mark.collision
@pytest.mark.parametrize(
    "placed",
    [
        "",
        'scale="-1 2 1"',
        'refpos=".1 .2 .3" scale="1 2 3"',
        'refpos=".1 .2 .3" refquat="0.7 0.7 0.3 0.1" scale="2 2 2"',
        'refpos=".1 .2 .3" refquat="0.7 0.7 0.3 0.1" scale="2 -2 2"',
        'refpos=".1 .2 .3" refquat="1 0 1 0" scale="1 2 -3"',
    ],
)
def test_meshes_are_drawn_and_checked_where_mujoco_has_them(tmp_path, placed: str):
    """Every corner of the mesh of the compiled model is one of the shape's in the frame of the body."""
    write_mesh(tmp_path / "l.stl", *prism())
    path = tmp_path / "arm.xml"
    path.write_text(document(f'name="m" file="l.stl" {placed}', '<geom mesh="m" pos=".1 0 .2" euler="10 20 30"/>'))
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    expected = model.mesh_vert @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0]
    robot = load_robot(path)
    for (shape,) in (robot.shapes, robot.visuals):
        corners = mesh_faces(shape)[0] @ shape.placement[:3, :3].T + shape.placement[:3, 3]
        apart = np.linalg.norm(corners[:, None] - expected, axis=-1)
        np.testing.assert_allclose(apart.min(axis=0), 0.0, atol=SINGLE)
        np.testing.assert_allclose(apart.min(axis=1), 0.0, atol=SINGLE)


def test_a_mesh_that_no_scale_along_its_axes_gives_is_told(tmp_path):
    write_mesh(tmp_path / "l.stl", *prism())
    path = tmp_path / "arm.xml"
    path.write_text(document('name="m" file="l.stl" refquat="0.7 0.7 0.3 0.1" scale="1 2 3"', '<geom mesh="m"/>'))
    robot = load_robot(path)
    (told,) = (finding for finding in robot.findings if finding.code == "shape-unknown")
    assert not robot.shapes and "'m', which is scaled along other axes" in told.evidence


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".msh"])
def test_formats_of_files(tmp_path, suffix: str):
    (tmp_path / "parts").mkdir()
    write_mesh(tmp_path / "parts" / f"l{suffix}", *prism())
    for compiler, file in (('meshdir="parts"', f"l{suffix}"), ('assetdir="parts" strippath="true"', f"no/l{suffix}")):
        text = document(f'file="{file}"', '<geom type="mesh" mesh="l" mass="2"/>', compiler=compiler)
        check(tmp_path / "arm.xml", text)


def test_an_obj_counts_its_first_group_polygons_and_backwards(tmp_path):
    (tmp_path / "m.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n# a cube of quadrangles\n"
        "o first\nf 4 3 2 1\nf 5/1/1 6/1/1 7/1/1 8/1/1\nf 1 2 6 5\nf 2 3 7 6\nusemtl other\nf -6 -5 -1 -2\n"
        "f 4 1 5 8\nv 3 0 0\nv 4 0 0\nv 3 1 0\nv 3 0 1\ng second\nf 9 11 10\nf 9 10 12\nf 10 11 12\nf 11 9 12\n"
    )
    for mode in ("exact", "legacy"):
        check(tmp_path / "arm.xml", document(f'file="m.obj" inertia="{mode}"', '<geom type="mesh" mesh="m"/>'))


@pytest.mark.parametrize("faces", [True, False])
def test_vertices_in_the_document(tmp_path, faces: bool):
    vertices, triangles = prism()
    listed = f'vertex="{" ".join(map(repr, vertices.ravel().tolist()))}"'
    if faces:
        listed += f' face="{" ".join(map(str, triangles.ravel().tolist()))}"'
    check(tmp_path / "arm.xml", document(f'name="m" {listed}', '<geom type="mesh" mesh="m"/>'))


@pytest.mark.parametrize(
    ("compiler", "rest"),
    [
        ('inertiagrouprange="0 2"', ""),
        ('inertiafromgeom="true"', ""),
        ("", '<default><mesh scale="2 1 1" inertia="exact"/><geom density="200"/></default>'),
        ("", '<default><default class="c"><mesh inertia="convex"/></default></default>'),
    ],
)
def test_groups_classes_and_settings(tmp_path, compiler: str, rest: str):
    write_mesh(tmp_path / "l.obj", *prism())
    geoms = (
        '<inertial pos="0 0 0" mass="9" diaginertia="9 9 9"/>'
        * ("fromgeom" in compiler)
        + '<geom type="mesh" mesh="l"/><geom type="mesh" mesh="l" group="3" pos="1 0 0"/>'
        '<geom type="mesh" mesh="l" mass="0"/><geom type="mesh" mesh="l" density="0"/>'
    )
    own = 'class="c"' * ('class="c"' in rest)
    check(tmp_path / "arm.xml", document(f'file="l.obj" {own}', geoms, compiler=compiler, rest=rest))
