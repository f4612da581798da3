"""Meshes of negative scale, which make a left part of a right one: loaded, measured and drawn as mirrored."""

from __future__ import annotations

import numpy as np
import pytest

from armid.errors import RobotError
from armid.excitation.collision.coal import distances, mesh_triangles
from armid.excitation.collision.hull_distances import Hulls
from armid.report.preview.scene import bodies_of
from armid.robot import load_robot
from armid.robot.kinematics import forward_kinematics

pytestmark = pytest.mark.collision

CORNER = "v 0 0 0\nv 0.1 0 0\nv 0 0.2 0\nv 0 0 0.3\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
"""A tetrahedron off its origin, its faces counter-clockwise from outside."""

MIRROR = np.array([1.0, -1.0, 1.0])

URDF = """<robot name="r"><link name="base"><collision><origin xyz="0 -0.5 0"/><geometry><box size="0.1 0.1 0.1"/>
</geometry></collision></link><joint name="j" type="continuous"><parent link="base"/><child link="a"/></joint>
<link name="a"><visual>MESH</visual><collision>MESH</collision></link></robot>"""

MJCF = """<mujoco model="r"><asset><mesh name="part" file="part.obj" scale="SCALE"/></asset><worldbody>
<geom type="box" size="0.05 0.05 0.05" pos="0 -0.5 0"/>
<body name="a"><joint name="j" axis="1 0 0"/><geom type="mesh" mesh="part"/></body></worldbody></mujoco>"""


def description(folder, suffix, scale):
    (folder / "part.obj").write_text(CORNER)
    mesh = f'<geometry><mesh filename="part.obj" scale="{scale}"/></geometry>'
    path = folder / f"arm{suffix}"
    path.write_text(URDF.replace("MESH", mesh) if suffix == ".urdf" else MJCF.replace("SCALE", scale))
    return path


def volume(triangles):
    """Enclosed volume [m³], positive where faces go counter-clockwise seen from outside."""
    return np.linalg.det(triangles).sum() / 6.0


@pytest.mark.parametrize("suffix", [".urdf", ".xml"])
def test_a_mirrored_mesh_is_the_mirror_image(tmp_path, suffix):
    plain = load_robot(description(tmp_path, suffix, "1 1 1"))
    robot = load_robot(description(tmp_path, suffix, "1 -1 1"))
    assert not {finding.code for finding in robot.findings} & {"visual-left-out", "mesh-missing"}
    right, left = (mesh_triangles(arm.shapes[-1]) for arm in (plain, robot))
    corners = {tuple(c) for c in np.round((right * MIRROR).reshape(-1, 3), 12) + 0.0}
    assert corners == {tuple(c) for c in np.round(left.reshape(-1, 3), 12) + 0.0}
    assert volume(right) == pytest.approx(0.001) == pytest.approx(volume(left))


def test_distances_are_those_of_the_mirror_image(tmp_path):
    """The box stands 0.45 m away on the side to which the mesh of 0.2 m is mirrored."""
    pair = np.array([[0, 1]])
    for scale, apart in (("1 1 1", 0.45), ("1 -1 1", 0.25)):
        robot = load_robot(description(tmp_path, ".urdf", scale))
        poses = forward_kinematics(robot, np.zeros((1, 1)))
        assert distances(robot.shapes, pair, poses) == pytest.approx(apart, abs=1e-6)
        assert Hulls(robot.shapes, pair, np.array([0])).distances(poses) == pytest.approx(apart, abs=1e-6)


def test_the_preview_draws_both_sides(tmp_path):
    drawn, meshes, missing = bodies_of(load_robot(description(tmp_path, ".urdf", "1 -1 1")))
    assert len(meshes) == 1 and not missing
    assert [body["link"] for body in drawn if "mesh" in body] == [0]


def test_a_scale_of_zero_is_refused(tmp_path):
    with pytest.raises(RobotError, match="needs a scale other than zero") as caught:
        load_robot(description(tmp_path, ".urdf", "1 0 1"))
    assert caught.value.remedy
