"""Geoms of an MJCF as bodies of links, against MuJoCo's own places and sizes."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from armid.robot import load_robot
from armid.robot.kinematics import forward_kinematics

ROUNDING = 1e-6
"""MuJoCo keeps quaternions, and the plain form keeps numbers as text: [m]."""

ARM = """<mujoco model="arm"><compiler angle="degree" eulerseq="xyz"/>
<default><geom rgba="1 0 0 1"/><default class="drawn"><geom contype="0" conaffinity="0"/></default>
<default class="bone"><geom type="capsule" size="0.05 0.1"/></default></default>
<worldbody>
<geom type="plane" size="1 1 0.1" pos="0 0 -0.2" name="ground"/>
<geom type="box" size="0.1 0.2 0.05" pos="0 0.1 0" euler="10 0 30"/>
<body name="a" pos="0 0 0.3" euler="0 20 0"><joint name="one" axis="0 0 1" pos="0.1 0 0"/>
<geom class="bone" pos="0.1 0 0.2" euler="0 90 0"/><geom type="mesh" mesh="none"/>
<geom class="drawn" type="sphere" size="0.5"/>
<geom class="bone" fromto="0 0 0 0.2 0.1 0.3" size="0.03"/>
<body name="fixed" pos="0 0 0.4" quat="0.9 0.1 0.3 0"><geom type="cylinder" size="0.04 0.2" axisangle="1 0 0 40"/>
<body name="b" pos="0.2 0 0"><joint name="two" type="slide" axis="1 0 0"/><joint name="three" axis="0 1 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<geom size="0.06" pos="0.1 0.2 0.3"/><geom type="box" size="0.1 0.2 0.3" zaxis="1 1 0"/></body></body></body>
</worldbody><asset>MESH</asset></mujoco>"""


def test_as_mujoco_places_them(tmp_path):
    plain = ARM.replace("MESH", "").replace('<geom type="mesh" mesh="none"/>', "")
    path = tmp_path / "arm.xml"
    path.write_text(ARM.replace("MESH", '<mesh name="none" file="none.stl"/>'))
    robot = load_robot(path)
    assert "mesh-missing" in [finding.code for finding in robot.findings]
    model = mujoco.MjModel.from_xml_string(plain)
    data = mujoco.MjData(model)
    q = np.array([0.4, 0.1, -0.7])
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    R, p = forward_kinematics(robot, q[None])
    kinds = {"half-space": 0, "sphere": 2, "capsule": 3, "cylinder": 5, "box": 6}
    theirs = [k for k in range(model.ngeom) if model.geom_contype[k]]
    assert len(theirs) == len(robot.shapes) == 7
    for shape, k in zip(robot.shapes, theirs, strict=True):
        turn, place = shape.placement[:3, :3], shape.placement[:3, 3]
        if shape.link >= 0:
            turn, place = R[0, shape.link] @ turn, p[0, shape.link] + R[0, shape.link] @ place
        assert kinds[shape.kind] == model.geom_type[k]
        assert place == pytest.approx(data.geom_xpos[k], abs=ROUNDING)
        matrix = data.geom_xmat[k].reshape(3, 3)
        if shape.kind == "box":
            assert turn == pytest.approx(matrix, abs=ROUNDING)
            assert shape.size == pytest.approx(2.0 * model.geom_size[k])
        elif shape.kind != "sphere":
            assert abs(turn[:, 2] @ matrix[:, 2]) == pytest.approx(1.0, abs=ROUNDING)
        if shape.kind in ("capsule", "cylinder"):
            assert shape.size[:2] == pytest.approx(model.geom_size[k][:2] * [1.0, 2.0])
        if shape.kind == "sphere":
            assert shape.size[0] == pytest.approx(model.geom_size[k][0])


TETRAHEDRON = """o corner
v 0 0 0
v 0.1 0 0
v 0 0.2 0
v 0 0 0.3
f 1 3 2
f 1 2 4
f 2 3 4
f 1 4 3
"""


def test_a_mesh_that_is_there(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "corner.obj").write_text(TETRAHEDRON)
    text = ARM.replace("MESH", '<mesh name="none" file="corner.obj" scale="2 2 2"/>')
    (tmp_path / "arm.xml").write_text(text.replace("<compiler ", '<compiler meshdir="parts" '))
    robot = load_robot(tmp_path / "arm.xml")
    mesh = next(shape for shape in robot.shapes if shape.kind == "mesh")
    assert mesh.size.tolist() == [2.0, 2.0, 2.0] and mesh.path.endswith("corner.obj")
    assert mesh.link == 0


SOLID = """<mujoco><asset>{asset}</asset><worldbody><body name="a" pos="0 0 0.3"><joint name="j"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{geom}</body></worldbody></mujoco>"""


@pytest.mark.parametrize("place", ['fromto="0 0.1 0 0.1 0.2 -0.3"', 'pos="0.1 0 0.2" euler="10 20 30"'])
@pytest.mark.parametrize("kind", ["box", "ellipsoid", "capsule", "cylinder"])
def test_sizes_and_places_of_solids(tmp_path, kind, place):
    path = tmp_path / "arm.xml"
    path.write_text(SOLID.format(asset="", geom=f'<geom type="{kind}" size="0.05 0.07 0.09" {place}/>'))
    (shape,) = load_robot(path).shapes
    model = mujoco.MjModel.from_xml_path(str(path))
    assert shape.kind == kind
    factor = {"ellipsoid": [1, 1, 1], "box": [2, 2, 2]}.get(kind, [1, 2, 0])
    assert shape.size == pytest.approx(model.geom_size[0] * factor)
    assert shape.placement[:3, 3] == pytest.approx(model.geom_pos[0], abs=ROUNDING)
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, model.geom_quat[0])
    theirs = matrix.reshape(3, 3)
    assert abs(shape.placement[:3, 2] @ theirs[:, 2]) == pytest.approx(1.0, abs=ROUNDING)
    if "fromto" not in place and kind in ("box", "ellipsoid"):  # otherwise round about z
        assert shape.placement[:3, :3] == pytest.approx(theirs, abs=ROUNDING)


CORNERS = 'vertex="0 0 0 0.1 0 0 0 0.1 0 0 0 0.1"'


@pytest.mark.parametrize(
    ("asset", "geom", "words"),
    [
        (f'<mesh name="m" {CORNERS}/>', 'type="mesh" mesh="m"', "'m', which is given by vertex"),
        ('<mesh name="m" builtin="sphere" params="2"/>', 'type="mesh" mesh="m"', "'m', which is given by builtin"),
        (f'<mesh name="m" {CORNERS}/>', 'type="box" mesh="m"', "a box that is fitted to the mesh 'm'"),
        ('<hfield name="h" nrow="2" ncol="2" size="1 1 1 1"/>', 'type="hfield" hfield="h"', "of type 'hfield'"),
    ],
)  # fmt: skip
def test_geoms_that_are_not_read_are_no_missing_meshes(tmp_path, asset, geom, words):
    path = tmp_path / "arm.xml"
    path.write_text(SOLID.format(asset=asset, geom=f"<geom {geom}/>"))
    mujoco.MjModel.from_xml_path(str(path))
    robot = load_robot(path)
    (found,) = (finding for finding in robot.findings if finding.code == "shape-unknown")
    assert found.severity == "warning" and found.channel == "a" and words in found.evidence
    assert "mesh-missing" not in {finding.code for finding in robot.findings}
    path.write_text(SOLID.format(asset=asset, geom=f'<geom contype="0" conaffinity="0" {geom}/>'))
    codes = {finding.code for finding in load_robot(path).findings}
    assert "visual-left-out" in codes and not codes & {"visual-missing", "mesh-missing", "shape-unknown"}
