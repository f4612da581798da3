"""Links that are only drawn stand in a plan's way, too: counted by MuJoCo, geom by geom."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from armid.excitation.collision.collision_model import make_collision_model
from armid.excitation.limits.joint_limits import described_limits
from armid.robot import load_robot
from armid.robot.collision_body_names import BodyName, link_of

DRAWN = 'contype="0" conaffinity="0"'
MASS = '<inertial pos="0 0 0.1" mass="1" diaginertia=".01 .01 .01"/>'

MJCF = f"""<mujoco><compiler angle="radian"/>
<asset><material name="glass" rgba="0 1 0 0.3"/></asset>
<worldbody>
  <geom type="plane" size="2 2 .1" pos="0 0 -1"/>
  <geom type="box" size=".1 .1 .1" pos="0 -.5 .3" {DRAWN}/>
  <geom type="box" size=".2 .2 .2" pos="0 0 .5" material="glass" {DRAWN}/>
  <body name="table" pos="0 .9 0"><geom type="box" size=".3 .1 .1"/></body>
  <body name="rack" pos=".5 0 .3"><geom type="box" size=".05 .05 .2" {DRAWN}/></body>
  <body name="dot" pos=".1 0 .4"><geom type="sphere" size=".02" {DRAWN}/></body>
  <body name="ghost" mocap="true" pos="0 0 .4"><geom type="box" size=".3 .3 .3" {DRAWN}/></body>
  <body name="goal" pos="0 0 .4"><freejoint name="loose"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <geom type="box" size=".3 .3 .3" {DRAWN}/></body>
  <body name="foot"><geom type="box" size=".1 .1 .05" {DRAWN}/>
    <body name="upper" pos="0 0 .1"><joint name="a" axis="0 1 0" range="-3 3"/>{MASS}
      <geom type="capsule" fromto="0 0 .05 0 0 .3" size=".03"/>
      <body name="middle" pos="0 0 .35"><joint name="b" axis="1 0 0" range="-3 3"/>{MASS}
        <geom type="capsule" fromto="0 0 .05 0 0 .15" size=".03"/>
        <body name="hand" pos="0 0 .2"><geom type="capsule" fromto="0 0 .1 0 .02 .3" size=".02" {DRAWN}/></body>
      </body></body></body>
</worldbody></mujoco>"""

INERTIA = '<inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>'


def _link(name: str, kind: str, shape: str, at: str) -> str:
    body = f'<{kind}><origin xyz="{at}"/><geometry>{shape}</geometry></{kind}>'
    return f'<link name="{name}">{INERTIA}{body}</link>'


def _joint(name: str, parent: str, child: str, at: str, axis: str = "") -> str:
    kind, more = ("revolute", f'<axis xyz="{axis}"/>') if axis else ("fixed", "")
    limit = '<limit lower="-3" upper="3" velocity="2" effort="50"/>' if axis else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/>{more}{limit}</joint>'
    )


URDF = (
    '<robot name="drawn"><mujoco><compiler discardvisual="false" fusestatic="false"/></mujoco><link name="ground"/>'
    + _link("table", "collision", '<box size=".6 .2 .2"/>', "0 .9 0")
    + _link("foot", "visual", '<box size=".2 .2 .1"/>', "0 0 0")
    + _link("upper", "collision", '<cylinder radius=".03" length=".25"/>', "0 0 .175")
    + _link("middle", "collision", '<cylinder radius=".03" length=".1"/>', "0 0 .1")
    + _link("hand", "visual", '<cylinder radius=".02" length=".25"/>', "0 0 .2")
    + _joint("t", "ground", "table", "0 0 0")
    + _joint("f", "ground", "foot", "0 0 0")
    + _joint("a", "foot", "upper", "0 0 .1", "0 1 0")
    + _joint("b", "upper", "middle", "0 0 .35", "1 0 0")
    + _joint("h", "middle", "hand", "0 0 .2")
    + "</robot>"
)


def _loaded(folder: Path, text: str):
    """The arm of a text, its joints named `a` and `b` free."""
    path = folder / ("arm.xml" if text is MJCF else "arm.urdf")
    path.write_text(text)
    return load_robot(path, only=("a", "b"))


def _found(robot, code: str) -> str:
    """Evidence of the findings of a code."""
    return " ".join(each.evidence for each in robot.findings if each.code == code)


@pytest.mark.collision
@pytest.mark.parametrize(("text", "drawn"), [(MJCF, {"foot", "hand", "rack", "world"}), (URDF, {"foot", "hand"})])
def test_nothing_that_is_drawn_is_run_into(text, drawn, tmp_path):
    """Wherever MuJoCo sees a moving geom in another, the collision model sees it, too."""
    robot = _loaded(tmp_path, text)
    limits = described_limits(robot)
    cell = make_collision_model(robot, limits)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    at = [model.joint(name).qposadr[0] for name in robot.joint_names]
    checked = {frozenset((link_of(cell.shapes[i].name), link_of(cell.shapes[j].name))) for i, j in cell.pairs}
    assert {frozenset(("foot", "hand")), frozenset(("table", "hand"))} <= checked
    left_out, poses = {"dot", "ghost", "goal"}, np.random.default_rng(1).uniform(-3.0, 3.0, (400, 2))
    seen = cell.too_close(poses)
    hits = 0
    for pose, close in zip(poses, seen, strict=True):
        data.qpos[at] = pose
        mujoco.mj_kinematics(model, data)
        told = {frozenset(map(link_of, (cell.shapes[i].name, cell.shapes[j].name))) for i, j in cell.pairs[close]}
        for hand in (g for g in range(model.ngeom) if _body(model, g) == "hand"):
            for other in range(model.ngeom):
                name = _body(model, other)
                glass = text is MJCF and model.geom_matid[other] >= 0
                if name in {"hand", "middle", "upper"} | left_out or glass:
                    continue
                if mujoco.mj_geomDistance(model, data, hand, other, 0.1, None) < 0.0:
                    hits += 1
                    assert frozenset(("hand", name)) in told
    assert hits > 10  # poses that touch are among them
    assert all(name in _found(robot, "bodies-from-visuals") for name in drawn)


def _body(model, geom: int) -> str:
    return model.body(model.geom_bodyid[geom]).name


def test_markers_do_not_stand_in_the_way_and_are_named(tmp_path):
    """Dots, glass, and what a simulation moves: the arm may pass through, and the finding says so."""
    robot = _loaded(tmp_path, MJCF)
    assert not {link_of(shape.name) for shape in robot.shapes} & {"dot", "ghost", "goal"}
    assert sum(link_of(shape.name) == "world" and shape.kind == "box" for shape in robot.shapes) == 1
    said = _found(robot, "markers-unchecked")
    assert all(name in said for name in ("dot", "ghost", "goal", "world shape 2"))


def test_links_without_anything_to_check_are_named(tmp_path):
    """A massive link without any geometry, and one whose only mesh is missing."""
    bare = URDF.replace(_link("upper", "collision", '<cylinder radius=".03" length=".25"/>', "0 0 .175"),
                        f'<link name="upper">{INERTIA}</link>')  # fmt: skip
    bare = bare.replace('<cylinder radius=".02" length=".25"/>', '<mesh filename="hand.stl"/>')
    said = _found(_loaded(tmp_path, bare), "bodies-unknown")
    assert "upper" in said and "hand" in said and "middle" not in said and "ground" not in said
    assert not _found(_loaded(tmp_path, URDF), "bodies-unknown")


def test_bodies_drawn_beside_collision_geometry_of_their_own_are_left(tmp_path):
    """A cable or a sticker on a link with collision geometry is no body."""
    text = URDF.replace('<link name="middle">', '<link name="middle"><visual><geometry><sphere radius=".2"/>'
                        "</geometry></visual>")  # fmt: skip
    names = [shape.name for shape in _loaded(tmp_path, text).shapes]
    assert names.count(BodyName("middle")) == 1 and not any(name == "middle shape 2" for name in names)
