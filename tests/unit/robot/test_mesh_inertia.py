"""Inertia of meshes: what is known of bodies of simple form, and what is said where it cannot be computed."""

from __future__ import annotations

import numpy as np
import pytest

from armid.maths.inertia import com_inertia_to_vector, transform
from armid.robot import load_robot
from armid.robot.mjcf.mesh_assets import inertia_of_triangles
from armid.robot.mjcf.mesh_reading import UncomputableError, read_mesh
from mesh_texts import HEIGHT, prism, write_mesh

INERTIAL = '<inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>'

ROUNDING = 1e-12
"""Relative; sums of some tens of products in double precision."""


def box(low, high):
    """Ten parameters of a box of density 1 between two corners."""
    side, middle = np.subtract(high, low), np.add(high, low) / 2
    volume = float(side.prod())
    moments = volume / 12 * (side @ side - side**2)
    return com_inertia_to_vector(volume, middle, np.diag(moments))


def test_a_mesh_that_is_not_convex_has_the_inertia_of_its_parts():
    vertices, faces = prism()
    parts = box((0, 0, 0), (0.3, 0.1, HEIGHT)) + box((0, 0.1, 0), (0.1, 0.25, HEIGHT))
    found = inertia_of_triangles(vertices[faces], "exact")
    np.testing.assert_allclose(found, parts, rtol=0, atol=ROUNDING)
    assert inertia_of_triangles(vertices[faces], "legacy")[0] > parts[0]  # counts the notch twice


@pytest.mark.parametrize("mode", ["exact", "legacy", "shell"])
def test_the_inertia_of_a_mesh_moves_with_it(mode: str):
    vertices, faces = prism()
    turned = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    turned *= np.sign(np.linalg.det(turned))
    shift = np.array([0.3, -0.2, 0.5])
    moved = inertia_of_triangles((vertices @ turned.T + shift)[faces], mode)
    there = transform(inertia_of_triangles(vertices[faces], mode), turned, shift)
    np.testing.assert_allclose(moved, there, rtol=0, atol=ROUNDING)


def test_a_shell_of_a_cube_is_its_six_sides():
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6)]
    faces = np.array([*faces, (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)])
    found = inertia_of_triangles(corners[faces], "shell")
    assert found[0] == pytest.approx(6.0, rel=ROUNDING)
    np.testing.assert_allclose(found[1:4], 3.0, rtol=ROUNDING)
    # About the centre: two sides turn about their own normal, 1/6 each, four about an edge at a distance of 1/2.
    about_centre = 2 * (1 / 6) + 4 * (1 / 12 + 1 / 4)
    assert found[4] - 6.0 * (0.25 + 0.25) == pytest.approx(about_centre, rel=ROUNDING)


def test_an_inside_out_mesh_has_no_volume():
    vertices, faces = prism()
    with pytest.raises(UncomputableError, match="turned inside out"):
        inertia_of_triangles(vertices[faces[:, ::-1]], "exact")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("m.stl", b"solid ascii\nfacet", "not that of a binary STL"),
        ("m.obj", b"v 0 0 0\nf 1 2 3\n", "names a vertex that does not exist"),
        ("m.obj", b"v 0 0 nan\nf 1 1 1\n", "a coordinate is not finite"),
        ("m.obj", b"v 0 zero 0\n", "is damaged"),
        ("m.msh", b"1234", "is damaged"),
        ("m.dae", b"", "is none of .stl, .obj, .msh"),
    ],
)
def test_files_that_are_no_meshes_are_named(tmp_path, name: str, content: bytes, message: str):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(UncomputableError, match=message) as caught:
        read_mesh(path, path.suffix)
    assert str(path) in caught.value.problem


def said(path, assets: str, geom: str) -> str:
    """Evidence about the body `a`, whose inertia cannot be computed."""
    body = f'<body name="a"><joint name="j"/>{geom}</body>'
    path.write_text(f"<mujoco><asset>{assets}</asset><worldbody>{body}</worldbody></mujoco>")
    robot = load_robot(path)
    (found,) = [each for each in robot.findings if each.code == "inertial-missing"]
    assert found.channel == "a" and robot.inertial_vector is None
    return found.evidence


def test_what_cannot_be_computed_is_said_with_the_body_and_the_reason(tmp_path):
    vertices, faces = prism()
    write_mesh(tmp_path / "open.stl", vertices, faces)
    write_mesh(tmp_path / "wrong.stl", vertices, np.vstack([faces[:-1], faces[-1:, ::-1]]))
    path, mesh = tmp_path / "arm.xml", '<geom type="mesh" mesh="m"/>'
    missing = said(path, '<mesh name="m" file="no/where.stl"/>', mesh)
    assert f"a (the mesh file {tmp_path / 'no' / 'where.stl'} does not exist)" in missing
    unoriented = said(path, '<mesh name="m" file="wrong.stl" inertia="exact"/>', mesh)
    assert "the triangles of the mesh 'm' are not consistently oriented" in unoriented
    assert "is simplified" in said(path, '<mesh name="m" file="open.stl" inertia="convex" maxhullvert="6"/>', mesh)
    assert "none of convex" in said(path, '<mesh name="m" file="open.stl" inertia="precise"/>', mesh)
    assert "neither a file nor vertices" in said(path, '<mesh name="m" builtin="sphere"/>', mesh)
    assert "there is no mesh 'm'" in said(path, "", mesh)
    assert "a box is fitted" in said(path, '<mesh name="m" file="open.stl"/>', '<geom type="box" mesh="m"/>')
    assert "it has a shell" in said(path, "", '<geom type="box" size="1 1 1" shellinertia="true"/>')


@pytest.mark.parametrize(("inertial", "matters"), [("", True), (INERTIAL, False)], ids=["inertia", "drawing"])
def test_the_digest_covers_meshes_that_give_inertia(tmp_path, inertial: str, matters: bool):
    vertices, faces = prism()
    path, mesh = tmp_path / "arm.xml", '<mesh name="m" file="m.stl"/>'
    body = f'<body name="a"><joint name="j"/>{inertial}<geom type="mesh" mesh="m"/></body>'
    path.write_text(f"<mujoco><asset>{mesh}</asset><worldbody>{body}</worldbody></mujoco>")
    write_mesh(tmp_path / "m.stl", vertices, faces)
    robot = load_robot(path)
    assert load_robot(path).sha256 == robot.sha256 and robot.inertial_vector is not None
    write_mesh(tmp_path / "m.stl", 1.1 * vertices, faces)
    assert (load_robot(path).sha256 != robot.sha256) == matters


def test_reasons_that_bodies_share_are_said_once(tmp_path):
    path, mesh = tmp_path / "arm.xml", '<geom type="mesh" mesh="m" mass="0.5"/>'
    path.write_text(
        '<mujoco><asset><mesh name="m" file="no.stl"/></asset><worldbody><body name="a"><joint name="j"/>'
        f'{mesh}<body name="b"><joint name="k"/>{mesh}</body></body></worldbody></mujoco>'
    )
    (found,) = [each for each in load_robot(path).findings if each.code == "inertial-missing"]
    assert f"a, b (the mesh file {tmp_path / 'no.stl'} does not exist)" in found.evidence
    assert "(a 0.5 kg, b 0.5 kg)" in found.evidence
