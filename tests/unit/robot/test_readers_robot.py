"""Readers of robot descriptions: what they accept, what they refuse, and how they say so."""

from __future__ import annotations

import math
import pkgutil
import sys

import numpy as np
import pytest

from armid.errors import ArmidError, MissingExtraError, RobotError
from armid.maths.rotations import axis_rotation, homogeneous, rotation_x, rotation_z
from armid.robot import frame_pose, load_robot, readers
from armid.robot.readers import READERS, dh, mjcf, urdf

INERTIAL = (
    '<inertial><origin xyz="0 0 0.1"/><mass value="2"/>'
    '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
)
LIMIT = '<limit lower="-1" upper="2" velocity="3" effort="4"/>'


def joint_xml(name="j", kind="revolute", parent="base", child="a", inside=f'<axis xyz="0 0 1"/>{LIMIT}') -> str:
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="0 0 0.3"/><parent link="{parent}"/>'
        f'<child link="{child}"/>{inside}</joint>'
    )


def urdf_xml(*joints: str, links: str = "ab", inertial: str = INERTIAL) -> str:
    bodies = "".join(f'<link name="{name}">{inertial}</link>' for name in links[: len(joints)])
    return f'<robot name="r"><link name="base"/>{bodies}{"".join(joints)}</robot>'


def mjcf_xml(bodies: str, rest: str = "") -> str:
    return f'<mujoco model="r"><compiler angle="radian"/>{rest}<worldbody>{bodies}</worldbody></mujoco>'


MASS = '<inertial pos="0 0 0.1" mass="2" diaginertia="0.1 0.1 0.1"/>'


def read_urdf(text, locked=(), tip=None):
    return urdf.read(text, source="arm.urdf", locked=dict.fromkeys(locked, 0.0), tip=tip)


def read_mjcf(text, locked=(), tip=None):
    return mjcf.read(text, source="arm.xml", locked=dict.fromkeys(locked, 0.0), tip=tip)


def read_dh(text, tip=None):
    return dh.read(text, source="arm.toml", locked={}, tip=tip)


# The catalogue


def test_every_module_stands_in_the_catalogue():
    modules = {module.name for module in pkgutil.iter_modules(readers.__path__)}
    assert modules == set(READERS)


@pytest.mark.parametrize("name", READERS)
def test_every_reader_names_the_source_of_what_it_cannot_read(name):
    reader = READERS[name].reader
    assert all(suffix == suffix.lower() and suffix.startswith(".") for suffix in READERS[name].suffixes)
    if name == "xacro":
        pytest.importorskip("xacrodoc")
    for text in ("", "<", "\0", "[[joint]]", "<robot/>", "<mujoco/>", "joint = 3"):
        with pytest.raises(ArmidError, match=r"arm\.file"):
            reader.read(text, source="arm.file", locked={}, tip=None)


def test_xml_is_told_apart_by_its_root(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(urdf_xml(joint_xml()))
    assert load_robot(path).joint_names == ("j",)
    path.write_text(mjcf_xml(f'<body name="a"><joint name="k"/>{MASS}</body>'))
    assert load_robot(path).joint_names == ("k",)
    path.write_text("<sdf/>")
    with pytest.raises(RobotError, match="is not a URDF: its root is <sdf>"):
        load_robot(path)


# XML


@pytest.mark.parametrize("read", [read_urdf, read_mjcf])
@pytest.mark.parametrize(
    "prolog",
    [
        '<!DOCTYPE robot [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE robot SYSTEM "http://localhost/x.dtd">',
        '<!DOCTYPE robot [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;">]>',
    ],
)
def test_document_types_and_entities_are_refused(read, prolog):
    with pytest.raises(RobotError, match=r"arm.*:2: armid does not accept declarations of a document type"):
        read(f'<?xml version="1.0"?>\n{prolog}\n<robot name="&x;"/>')


@pytest.mark.parametrize("read", [read_urdf, read_mjcf])
def test_malformed_xml_names_the_line(read):
    with pytest.raises(RobotError, match=r"arm.*:3: the XML is not well-formed .mismatched tag"):
        read("<robot>\n<link>\n</robot>")


# URDF


def test_urdf_kinds_limits_and_names():
    robot = read_urdf(
        urdf_xml(
            joint_xml(),
            joint_xml("k", "continuous", "a", "b", '<axis xyz="0 3 4"/>'),
            joint_xml("s", "prismatic", "b", "c", '<limit lower="0" upper="0.5" velocity="0" effort="0"/>'),
            links="abc",
        )
    )
    assert robot.name == "r"
    assert robot.joint_names == ("j", "k", "s")
    assert [joint.kind for joint in robot.joints] == ["revolute", "continuous", "prismatic"]
    assert [link.name for link in robot.links] == ["a", "b", "c"]
    assert [joint.position_limits.tolist() for joint in robot.joints] == [[-1, 2], [-math.inf, math.inf], [0, 0.5]]
    assert [joint.velocity_limit for joint in robot.joints] == [3, math.inf, math.inf]
    assert [joint.effort_limit for joint in robot.joints] == [4, math.inf, math.inf]
    np.testing.assert_allclose(robot.joints[1].axis, [0, 0.6, 0.8], atol=1e-15)
    assert robot.joints[2].axis.tolist() == [1, 0, 0]
    np.testing.assert_allclose(robot.links[0].inertial.com, [0, 0, 0.1], atol=1e-15)


def test_a_joint_without_limits_or_with_placeholders_is_unlimited():
    bare = read_urdf(urdf_xml(joint_xml(inside='<axis xyz="0 0 1"/>')))
    assert bare.joints[0].position_limits.tolist() == [-math.inf, math.inf]
    assert [(f.code, f.severity, f.channel) for f in bare.findings] == [("limits-unknown", "info", "j")]
    for lower, upper in ((0, 0), (-10000, 10000)):
        limit = f'<limit lower="{lower}" upper="{upper}" velocity="1" effort="1"/>'
        robot = read_urdf(urdf_xml(joint_xml(inside=limit)))
        assert robot.joints[0].position_limits.tolist() == [-math.inf, math.inf]
        assert [(f.code, f.channel) for f in robot.findings] == [("limits-unknown", "j")]


@pytest.mark.parametrize(
    ("velocity", "effort", "known"),
    [
        (50000, 50000, (math.inf, math.inf)),
        (100, 1000, (math.inf, math.inf)),
        (100, 80, (math.inf, 80)),
        (100, 330, (math.inf, 330)),
        (53, 40, (53, 40)),
        (2.1, 9000, (2.1, 9000)),
    ],
)
def test_a_velocity_that_no_arm_reaches_is_unknown(velocity: float, effort: float, known: tuple[float, float]):
    """Values of iCub, Alex, an arm with one strong joint, G1 and KR 210."""
    limit = f'<limit lower="-1" upper="1" velocity="{velocity}" effort="{effort}"/>'
    robot = read_urdf(urdf_xml(joint_xml(inside=limit)))
    assert (robot.joints[0].velocity_limit, robot.joints[0].effort_limit) == known
    assert robot.joints[0].position_limits.tolist() == [-1.0, 1.0]
    told = [(f.code, f"{velocity:g}" in f.evidence) for f in robot.findings]
    assert told == ([("limits-unknown", True)] if math.isinf(known[0]) else [])


def test_meshes_need_not_exist():
    mesh = '<geometry><mesh filename="package://nowhere/a.stl"/></geometry>'
    robot = read_urdf(
        urdf_xml(joint_xml(), inertial=f"{INERTIAL}<visual>{mesh}</visual><collision>{mesh}</collision>")
    )
    assert robot.links[0].inertial.mass == 2


def test_zero_mass_everywhere_is_read_and_known_as_such():
    assert read_urdf(urdf_xml(joint_xml(), inertial="")).inertial_vector is None
    zero = INERTIAL.replace('"2"', '"0"').replace('"0.1"', '"0"')
    assert read_urdf(urdf_xml(joint_xml(), inertial=zero)).inertial_vector is None


def test_fixed_joints_are_merged():
    robot = read_urdf(urdf_xml(joint_xml(), joint_xml("f", "fixed", "a", "b", "")))
    assert robot.n == 1
    assert robot.links[0].inertial.mass == 4
    np.testing.assert_allclose(robot.links[0].inertial.com, [0, 0, 0.25], atol=1e-15)
    assert robot.tip.name == "b"
    with pytest.raises(RobotError, match="no joint 'f' to lock"):
        read_urdf(urdf_xml(joint_xml(), joint_xml("f", "fixed", "a", "b", "")), locked=["f"])


@pytest.mark.parametrize("kind", ["floating", "planar", "spherical"])
def test_other_kinds_are_refused_unless_locked(kind):
    text = urdf_xml(joint_xml(), joint_xml("loose", kind, "a", "b", ""))
    with pytest.raises(RobotError, match=f"arm.urdf: joint 'loose' is of kind '{kind}'(.|\n)*lock 'loose'"):
        read_urdf(text)
    assert read_urdf(text, locked=["loose"]).joint_names == ("j",)
    with pytest.raises(
        RobotError, match=f"'loose' is of kind {kind}, so it can be locked only at its zero pose; found the value 0.5"
    ):
        urdf.read(text, source="arm.urdf", locked={"loose": 0.5}, tip=None)


def test_mimic_joints_are_refused_unless_locked(tmp_path):
    mimic = f'<axis xyz="0 0 1"/>{LIMIT}<mimic joint="j" multiplier="-1"/>'
    text = urdf_xml(joint_xml(), joint_xml("finger", "revolute", "a", "b", mimic))
    with pytest.raises(
        RobotError, match=r"'finger' is a mimic joint: its position depends on that of 'j'(.|\n)*lock 'finger'"
    ):
        read_urdf(text)
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    robot = load_robot(path, locked={"finger": 0.5})
    assert robot.joint_names == ("j",)
    assert robot.links[0].inertial.mass == 4


@pytest.mark.parametrize(
    ("joint", "message"),
    [
        (joint_xml(inside=f'<axis xyz="0 0 0"/>{LIMIT}'), "joint 'j' has an axis of zero length"),
        (joint_xml(inside=f'<axis xyz="0 0"/>{LIMIT}'), "xyz of the axis of joint 'j' must be 3 finite numbers"),
        (joint_xml(inside='<limit lower="1" upper="-1"/>'), "lower position limit 1 rad of joint 'j' is above"),
        (joint_xml(inside='<limit lower="nan" upper="1"/>'), "lower of the limit of joint 'j' must be a finite"),
        (joint_xml(child="nowhere"), "the child link 'nowhere' of joint 'j' does not exist"),
        (
            joint_xml().replace("0 0 0.3", "0 x 0.3"),
            "xyz of the origin of joint 'j' must be 3 finite numbers; found '0 x 0.3'",
        ),
        (joint_xml(kind="hinge"), "joint 'j' has the unknown type 'hinge'"),
        (joint_xml(kind="fixed"), "has no movable joint"),
    ],
)
def test_bad_urdf_joints_are_named(joint, message):
    with pytest.raises(RobotError, match=message):
        read_urdf(urdf_xml(joint))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</robot>", '<link name="lost"/></robot>', "several root links, which no joint moves: base, lost"),
        (
            'mass value="2"',
            'mass value="heavy"',
            "value of the mass of link 'a' must be a finite number; found 'heavy'",
        ),
        ('<mass value="2"/>', "", "the inertial of link 'a' has no <mass>"),
        ('ixy="0"', "", "the inertia of link 'a' has no attribute ixy"),
        ('iyz="0"', 'iyz="x"', "iyz of the inertia of link 'a' must be a finite number"),
        ('<origin xyz="0 0 0.1"/>', '<origin xyz="0 0"/>', "xyz of the origin of the inertial of link 'a' must be 3"),
        ('<parent link="base"/>', "", "joint 'j' has no parent link"),
        (
            'parent link="base"',
            'parent link="bass"',
            r"the parent link 'bass' of joint 'j' does not exist(.|\n)*'base'",
        ),
        ('child link="a"', 'child link="base"', "the joints of these links form a loop: base"),
        ("</robot>", '<link name="a"/></robot>', "two links with the name 'a'"),
        ("</robot>", "<link/></robot>", "a link without a name"),
        ('joint name="j"', "joint", "a joint without a name"),
        ("</robot>", joint_xml("k") + "</robot>", "link 'a' is the child of two joints, 'j' and 'k'"),
        ("</robot>", joint_xml("j") + "</robot>", "two joints with the name 'j'"),
    ],
)
def test_a_urdf_that_is_no_tree_of_bodies_is_refused_with_the_place(old, new, message):
    text = urdf_xml(joint_xml())
    assert old in text
    text = text.replace(old, new, 1)
    if new == 'child link="base"':
        text = text.replace(f'<link name="a">{INERTIAL}</link>', "")
    with pytest.raises(RobotError, match=message):
        read_urdf(text)


def test_children_of_a_link_have_the_order_of_the_names_of_their_joints():
    """Saved runs have this order, which does not depend on the order in the file."""
    names = ("m", "z", "a")
    joints = [joint_xml(name, child=link) for name, link in zip(names, "abc", strict=True)]
    assert read_urdf(urdf_xml(*joints, links="abc")).joint_names == ("a", "m", "z")


def test_unexpanded_xacro_is_noticed():
    text = urdf_xml(joint_xml()).replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')
    assert read_urdf(text).n == 1
    with pytest.raises(RobotError, match="xacro that is not expanded"):
        read_urdf(text.replace("</robot>", '<xacro:property name="x" value="1"/></robot>'))


def test_everything_locked_is_refused():
    with pytest.raises(RobotError, match="All joints are locked"):
        read_urdf(urdf_xml(joint_xml()), locked=["j"])


# The tip


def fixed(name, parent, child):
    return joint_xml(name, "fixed", parent, child, "")


@pytest.mark.parametrize(
    ("joints", "tip"),
    [
        ([joint_xml()], "a"),
        ([joint_xml(), fixed("f", "a", "b"), fixed("g", "b", "c")], "c"),
        ([joint_xml(), fixed("f", "a", "b"), fixed("g", "b", "c"), fixed("h", "b", "d")], "b"),
        ([joint_xml(), fixed("f", "a", "b"), fixed("g", "a", "flange")], "flange"),
        ([joint_xml(), fixed("f", "a", "flange"), fixed("g", "flange", "tool0")], "tool0"),
        ([joint_xml(), joint_xml("k", "revolute", "a", "b"), joint_xml("s", "revolute", "base", "c")], "b"),
    ],
)
def test_the_tip_is_found_at_the_end_of_the_longest_chain(joints, tip):
    bodies = "".join(f'<link name="{name}">{INERTIAL}</link>' for name in ("a", "b", "c", "d", "flange", "tool0"))
    used = [
        x
        for x in bodies.split("</link>")
        if any(f'child link="{x.split(chr(34))[1:2][0]}"' in j for j in joints if x)
    ]
    text = f'<robot name="r"><link name="base"/>{"".join(x + "</link>" for x in used)}{"".join(joints)}</robot>'
    assert read_urdf(text).tip.name == tip


def test_locked_fingers_do_not_make_the_tip():
    joints = (
        joint_xml(),
        fixed("f", "a", "b"),
        joint_xml("left", "prismatic", "b", "c"),
        joint_xml("right", "prismatic", "b", "d"),
        fixed("g", "b", "e"),
    )
    text = urdf_xml(*joints, links="abcde")
    assert read_urdf(text).tip.name == "d"
    assert read_urdf(text, locked=["left", "right"]).tip.name == "e"
    assert read_urdf(text, tip="c").tip.name == "c"
    with pytest.raises(RobotError, match=r"no frame 'hand' for the tip(.|\n)*base, a, b"):
        read_urdf(text, tip="hand")


def test_beyond_a_locked_wrist_the_flange_is_still_the_tip(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf_xml(joint_xml(), joint_xml("k", "revolute", "a", "b")))
    robot = load_robot(path, locked={"k": 0.3})
    assert robot.tip.name == "b"
    assert robot.tip.parent == 0
    np.testing.assert_allclose(robot.tip.placement[:3, 3], [0, 0, 0.3])


# MJCF


def test_several_joints_of_a_body_become_a_chain():
    joints = '<joint name="x" type="slide" axis="1 0 0" range="-1 1"/><joint name="z" axis="0 0 1" pos="0 0.1 0"/>'
    robot = read_mjcf(mjcf_xml(f'<body name="cart" pos="0 0 1">{joints}{MASS}</body>'))
    assert robot.joint_names == ("x", "z")
    assert [j.kind for j in robot.joints] == ["prismatic", "continuous"]
    assert robot.links[0].inertial is None
    assert robot.links[1].inertial.mass == 2
    R, p = frame_pose(robot, [[0.5, math.pi / 2]])
    np.testing.assert_allclose(p[0], [0.5 + 0.1, 0.1, 1.0], atol=1e-15)
    np.testing.assert_allclose(R[0], rotation_z(math.pi / 2), atol=1e-15)


@pytest.mark.parametrize(
    ("joint", "kind"), [('<freejoint name="f"/>', "free"), ('<joint name="f" type="ball"/>', "ball")]
)
def test_free_and_ball_joints_are_refused_unless_locked(joint, kind):
    text = mjcf_xml(f'<body name="a" pos="0 0 1">{joint}{MASS}<body name="b"><joint name="k"/>{MASS}</body></body>')
    with pytest.raises(RobotError, match=f"joint 'f' is of kind '{kind}'"):
        read_mjcf(text)
    robot = read_mjcf(text, locked=["f"])
    assert robot.joint_names == ("k",)
    np.testing.assert_allclose(robot.joints[0].placement[:3, 3], [0, 0, 1])


PAIR = f'<body name="a"><joint name="j"/>{MASS}<body name="b"><joint name="k"/>{MASS}</body></body>'


def test_equalities_are_refused_unless_the_follower_is_locked_or_they_are_off():
    tie = '<equality><joint joint1="k" joint2="j"/></equality>'
    with pytest.raises(RobotError, match="joint 'k' is a mimic joint: an equality couples it to 'j'"):
        read_mjcf(mjcf_xml(PAIR, tie))
    assert read_mjcf(mjcf_xml(PAIR, tie), locked=["k"]).n == 2
    assert read_mjcf(mjcf_xml(PAIR, tie.replace("joint1", 'active="false" joint1'))).n == 2
    with pytest.raises(RobotError, match="kind 'connect', which closes a loop"):
        read_mjcf(mjcf_xml(PAIR, '<equality><connect body1="a" body2="b" anchor="0 0 0"/></equality>'))


def test_limits_follow_classes_switches_and_actuators():
    rest = (
        '<default><joint range="-1 1"/><default class="loose"><joint limited="false"/></default></default>'
        '<actuator><motor joint="j" ctrlrange="-2 2" gear="3"/>'
        '<position joint="k" ctrlrange="-9 9" forcerange="-5 6"/>'
        "</actuator>"
    )
    bodies = PAIR.replace('name="k"', 'name="k" class="loose"').replace(
        "</body></body>",
        f'<body name="c"><joint name="l" range="-2 3" actuatorfrcrange="-7 8"/>{MASS}</body></body></body>',
    )
    robot = read_mjcf(mjcf_xml(bodies, rest))
    assert [j.position_limits.tolist() for j in robot.joints] == [[-1, 1], [-math.inf, math.inf], [-2, 3]]
    assert [j.effort_limit for j in robot.joints] == [6, 5, 7]
    off = mjcf_xml(bodies, rest).replace('angle="radian"', 'angle="radian" autolimits="false"')
    assert read_mjcf(off).joints[0].position_limits.tolist() == [-math.inf, math.inf]


def test_gravity_of_the_file_is_kept_unless_told_otherwise(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(mjcf_xml(PAIR, '<option gravity="0 1 2"/>'))
    assert load_robot(path).gravity.tolist() == [0, 1, 2]
    assert load_robot(path, gravity=[3, 0, 0]).gravity.tolist() == [3, 0, 0]
    assert read_mjcf(mjcf_xml(PAIR)).gravity.tolist() == [0, 0, -9.81]


def test_inertia_from_meshes_is_unknown_and_said_so():
    rest = '<asset><mesh name="m" file="nowhere.stl"/></asset>'
    robot = read_mjcf(mjcf_xml('<body name="a"><joint name="j"/><geom type="mesh" mesh="m"/></body>', rest))
    assert robot.inertial_vector is None
    assert [(f.code, f.channel) for f in robot.findings] == [("inertial-missing", "a"), ("mesh-missing", "a")]
    fine = read_mjcf(mjcf_xml(f'<body name="a"><joint name="j"/>{MASS}<geom type="mesh" mesh="m"/></body>', rest))
    assert fine.links[0].inertial.mass == 2
    assert [f.code for f in fine.findings] == ["mesh-missing"]


def test_bodies_with_unknown_inertia_are_named_in_one_finding_with_their_stated_masses():
    mesh = '<geom type="mesh" mesh="m"'
    text = mjcf_xml(
        f'<body name="a"><joint name="j"/>{mesh} mass="0.4"/>{mesh} mass="0.25"/>'
        f'<body name="b"><joint name="k"/>{mesh}/></body></body>',
        '<asset><mesh name="m" file="nowhere.stl"/></asset>',
    )
    (found,) = [f for f in read_mjcf(text).findings if f.code == "inertial-missing"]
    assert found.channel == "a, b"
    assert "(a 0.65 kg)" in found.evidence


def test_settings_that_change_masses_are_reported():
    text = mjcf_xml(PAIR).replace("<compiler ", '<compiler settotalmass="3" ')
    assert [(f.code, f.severity) for f in read_mjcf(text).findings] == [("description-ignored", "warning")]


def test_includes_are_resolved_and_count_for_the_digest(tmp_path):
    (tmp_path / "scene.xml").write_text('<mujoco><include file="arm.xml"/></mujoco>')
    (tmp_path / "arm.xml").write_text(mjcf_xml(PAIR))
    one = load_robot(tmp_path / "scene.xml")
    assert one.joint_names == ("j", "k")
    (tmp_path / "arm.xml").write_text(mjcf_xml(PAIR.replace('mass="2"', 'mass="3"')))
    assert load_robot(tmp_path / "scene.xml").sha256 != one.sha256
    (tmp_path / "arm.xml").unlink()
    with pytest.raises(RobotError, match=r"arm.xml cannot be read as a part of"):
        load_robot(tmp_path / "scene.xml")
    (tmp_path / "arm.xml").write_text('<mujoco><include file="arm.xml"/></mujoco>')
    with pytest.raises(RobotError, match="more than once"):
        load_robot(tmp_path / "scene.xml")


@pytest.mark.parametrize(
    ("bodies", "message"),
    [
        (f'<frame pos="0 0 1">{PAIR}</frame>', "uses <frame>"),
        (PAIR.replace('name="j"', 'name="j" axis="0 0 0"'), "joint 'j' has an axis of zero length"),
        (PAIR.replace('name="j"', 'name="j" range="1 -1"'), "lower position limit 1 rad of joint 'j' is above"),
        (PAIR.replace('name="j"', 'name="j" class="lost"'), "no default class 'lost'"),
        (PAIR.replace('name="k"', 'name="j"'), "two joints named 'j'"),
        (PAIR.replace('name="b"', 'name="a"'), "two bodies named 'a'"),
        (PAIR.replace('name="b"', 'name="world"'), "two bodies named 'world'"),
        (PAIR.replace('name="a"', 'name="a" pos="0 0 x"'), "pos of body 'a' must be 3 finite numbers; found '0 0 x'"),
        (PAIR.replace('name="a"', 'name="a" xyaxes="1 0 0 2 0 0"'), "the orientation of joint 'j' is not a rotation"),
        (PAIR.replace('mass="2"', 'mass="two"'), "mass of the inertial of 'a' must be a finite number"),
        (PAIR.replace('mass="2"', ""), "the inertial of 'a' has no mass"),
        (PAIR.replace(MASS, '<geom size="big"/>'), "size of a geom of 'a' must be a finite number"),
        ('<body name="a"/>', "no movable joint"),
        ("", "no movable joint"),
    ],
)
def test_bad_mjcf_is_named(bodies, message):
    with pytest.raises(RobotError, match=message):
        read_mjcf(mjcf_xml(bodies))


def test_an_unknown_euler_sequence_is_refused():
    with pytest.raises(RobotError, match="eulerseq has the invalid value 'xyq'"):
        read_mjcf(mjcf_xml(PAIR).replace("<compiler ", '<compiler eulerseq="xyq" '))


# Xacro


XACRO = (
    '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="sizes.xacro"/>'
    '<link name="base"/><link name="a"/>'
    '<joint name="${prefix}j" type="continuous"><origin xyz="0 0 ${height / 2}" rpy="${pi/2} 0 0"/>'
    '<parent link="base"/>'
    '<child link="a"/><axis xyz="0 0 1"/></joint></robot>'
)
SIZES = (
    '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="height" value="0.6"/>'
    '<xacro:property name="prefix" value="left_"/></robot>'
)


@pytest.fixture
def xacro_file(tmp_path):
    pytest.importorskip("xacrodoc")
    (tmp_path / "sizes.xacro").write_text(SIZES)
    path = tmp_path / "arm.urdf.xacro"
    path.write_text(XACRO)
    return path


def test_xacro_is_expanded(xacro_file):
    robot = load_robot(xacro_file)
    assert robot.joint_names == ("left_j",)
    np.testing.assert_array_equal(robot.joints[0].placement, homogeneous(rotation_x(math.pi / 2), [0.0, 0.0, 0.3]))
    (xacro_file.parent / "sizes.xacro").write_text(SIZES.replace("0.6", "0.8"))
    again = load_robot(xacro_file)
    assert again.sha256 != robot.sha256
    assert again.joints[0].placement[2, 3] == pytest.approx(0.4)


@pytest.mark.parametrize(
    "text",
    [
        XACRO.replace("${height / 2}", "${hight}"),
        XACRO.replace("sizes.xacro", "lost.xacro"),
        XACRO.replace("sizes.xacro", "$(find nowhere)/a.xacro"),
        XACRO.replace("sizes.xacro", "$(arg unset)"),
    ],
)
def test_xacro_that_cannot_be_expanded(xacro_file, text, capfd):
    xacro_file.write_text(text)
    with pytest.raises(RobotError, match="cannot be expanded by xacro"):
        load_robot(xacro_file)
    capfd.readouterr()


def test_without_xacrodoc_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    (tmp_path / "arm.xacro").write_text(XACRO)
    with pytest.raises(MissingExtraError, match=r"needs the package 'xacrodoc'(.|\n)*armid\[xacro\]"):
        load_robot(tmp_path / "arm.xacro")


# DH tables


def transform(R=None, p=(0.0, 0.0, 0.0)):
    return homogeneous(np.eye(3) if R is None else R, p)


X, Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def literal(convention: str, row: dict[str, float], q: float, prismatic: bool):
    """Transform of one row as the textbooks write it."""
    turn, shift = (0.0, q) if prismatic else (q, 0.0)
    if convention == "thesis":
        turned = axis_rotation(Z, row["phi"]) @ axis_rotation(X, row["theta"]) @ axis_rotation(Z, row["psi"] + turn)
        return transform(p=(0, row["d_y"], row["d_z"])) @ transform(turned) @ transform(p=(0, 0, shift))
    about_z = transform(axis_rotation(Z, row["theta"] + turn), (0, 0, row["d"] + shift))
    about_x = transform(axis_rotation(X, row["alpha"]), (row["a"], 0, 0))
    return about_z @ about_x if convention == "standard" else about_x @ about_z


KEYS = {"standard": ("a", "alpha", "d", "theta"), "modified": ("a", "alpha", "d", "theta")}
KEYS["thesis"] = ("d_y", "d_z", "phi", "theta", "psi")


@pytest.mark.parametrize("convention", KEYS)
def test_a_table_is_the_product_of_its_rows_and_carries_its_masses(convention):
    rng = np.random.default_rng(3)
    rows = [dict(zip(KEYS[convention], rng.uniform(-1, 1, len(KEYS[convention])), strict=True)) for _ in range(5)]
    kinds = ["revolute", "prismatic", "revolute", "revolute", "prismatic"]
    com = rng.normal(size=(5, 3))
    text = f'convention = "{convention}"\n[base]\nxyz = [0.1, 0.2, 0.3]\nrpy = [0.0, 0.0, 0.5]\n'
    for i, row in enumerate(rows):
        entries = "".join(f"{key} = {value!r}\n" for key, value in ((k, float(v)) for k, v in row.items()))
        text += f'[[joint]]\nname = "j{i}"\nkind = "{kinds[i]}"\n{entries}'
        inertia = "{ xx = 0.1, xy = 0.01, xz = 0.0, yy = 0.2, yz = 0.0, zz = 0.15 }"
        text += f"[joint.inertial]\nmass = 2\ncom = {com[i].tolist()}\ninertia = {inertia}\n"
    text += '[tip]\nname = "hand"\nxyz = [0.0, 0.0, 0.2]\n'
    robot = read_dh(text)
    q = rng.uniform(-1, 1, (1, 5))
    pose = transform(axis_rotation(Z, 0.5), (0.1, 0.2, 0.3))
    for i, row in enumerate(rows):
        pose = pose @ literal(convention, row, q[0, i], kinds[i] == "prismatic")
        R, p = frame_pose(robot, q, read_dh(text, tip=f"link_{i + 1}").tip)
        inertial = robot.links[i].inertial
        np.testing.assert_allclose(R[0] @ inertial.com + p[0], pose[:3, :3] @ com[i] + pose[:3, 3], atol=1e-13)
        tensor = np.array([[0.1, 0.01, 0], [0.01, 0.2, 0], [0, 0, 0.15]])
        about_com = inertial.seen_from(np.eye(3), -inertial.com).inertia[[0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape(3, 3)
        np.testing.assert_allclose(R[0] @ about_com @ R[0].T, pose[:3, :3] @ tensor @ pose[:3, :3].T, atol=1e-12)
    R, p = frame_pose(robot, q)
    assert robot.tip.name == "hand"
    np.testing.assert_allclose(p[0], pose[:3, :3] @ [0, 0, 0.2] + pose[:3, 3], atol=1e-14)
    np.testing.assert_allclose(R[0], pose[:3, :3], atol=1e-14)


ROW = 'name = "r"\nconvention = "modified"\n[[joint]]\nname = "a"\nd = 1.0\n'


def test_units_hold_for_angles_and_not_for_lengths():
    text = (
        ROW.replace("[[joint]]", 'units = "deg"\n[[joint]]') + "alpha = 90\nposition = [-170, 170]\nvelocity = 180\n"
    )
    joint = read_dh(text).joints[0]
    np.testing.assert_allclose(joint.position_limits, [-math.radians(170), math.radians(170)])
    assert joint.velocity_limit == math.pi
    assert joint.placement[:3, :3].tolist() == [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    slide = read_dh(text + 'kind = "prismatic"\n').joints[0]
    assert slide.position_limits.tolist() == [-170, 170]
    assert slide.velocity_limit == 180


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ('"pi"', math.pi),
        ('"-pi/2"', -math.pi / 2),
        ('"3*pi/4"', 3 * math.pi / 4),
        ('" + 1.5 * pi "', 1.5 * math.pi),
        ("0.3", 0.3),
        ("1", 1.0),
    ],
)
def test_angles_may_be_multiples_of_pi(written, value):
    placement = read_dh(ROW + f"theta = {written}\n").joints[0].placement
    np.testing.assert_allclose(placement[:3, :3], rotation_z(value), rtol=0, atol=0)


def test_a_mass_without_inertia_is_a_point_and_said_so():
    robot = read_dh(ROW + "[joint.inertial]\nmass = 2\ncom = [0.1, 0, 0]\n")
    assert np.linalg.matrix_rank(robot.links[0].inertial.pseudo_inertia) == 1
    assert [f.code for f in robot.findings] == ["inertia-missing"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ROW + "aplha = 1\n", r"joint 1: unknown key 'aplha'(.|\n)*a, d, alpha, theta, name(.|\n)*write 'alpha'"),
        (ROW + "phi = 1\n", "joint 1: unknown key 'phi'"),
        ('speed = 1\nconvention = "modified"\n', r"unknown key 'speed'(.|\n)*name, convention, units"),
        (
            ROW.replace("modified", "craig"),
            r"convention has the unknown value 'craig'(.|\n)*standard, modified, thesis",
        ),
        (ROW.replace('convention = "modified"\n', ""), "the key 'convention' is missing"),
        (ROW.replace('"a"', "3"), "joint 1: name must be a name; found 3"),
        (
            ROW + 'kind = "planar"\n',
            r"joint 1: kind has the unknown value 'planar'(.|\n)*revolute, continuous, prismatic",
        ),
        (ROW + 'theta = "pi*2"\n', r"theta must be an angle(.|\n)*found 'pi\*2'"),
        (ROW + 'theta = "__import__(1)"\n', "theta must be an angle"),
        (ROW + 'theta = "pi/0"\n', "theta must be an angle"),
        (ROW.replace("1.0", "inf"), "joint 1: d must be a finite number; found inf"),
        (ROW.replace("1.0", "true"), "joint 1: d must be a finite number; found True"),
        (ROW + "position = [1.0]\n", "position must be a list of 2 angles"),
        (ROW + "position = [1.0, -1.0]\n", "is not smaller than the upper limit"),
        (ROW + 'kind = "continuous"\nposition = [-1.0, 1.0]\n', "continuous but has position limits"),
        (ROW + "velocity = 0\n", "velocity must be positive"),
        (ROW + "[joint.inertial]\nmass = 2\n", "joint 1, inertial: com is missing"),
        (ROW + "inertial = 2\n", "joint 1, inertial: the entry must be a table"),
        (
            ROW + "[joint.inertial]\nmass = 2\ncom = [0,0,0]\ninertia = { xx = 1 }\n",
            "inertia: xy, xz, yy, yz, zz are missing",
        ),
        (ROW + "[tip]\nxy = [1, 2]\n", r"\[tip\]: unknown key 'xy'"),
        (ROW + "tip = \n", "not valid TOML: Invalid value .at line 6"),
        ('convention = "modified"\n', r"has no \[\[joint\]\]"),
        ('convention = "modified"\n[joint]\nname = "a"\n', r"joint must be an array of tables"),
        (ROW + '[[joint]]\nname = "a"\n', "The names of the joints must differ"),
    ],
)
def test_bad_tables_are_named(text, message):
    with pytest.raises(RobotError, match=message):
        read_dh(text)


def test_an_unknown_tip_lists_the_frames():
    with pytest.raises(RobotError, match=r"no frame 'hand'(.|\n)*tip, link_1"):
        read_dh(ROW, tip="hand")


def test_a_box_that_is_only_drawn_beside_the_arm():
    """A box without contacts in the world may be a marker; its size decides."""
    box = '<geom type="box" size="{0} {0} {0}" contype="0" conaffinity="0"/>'
    arm = f'<body name="a"><joint name="j"/>{MASS}<geom size="0.1"/></body>'
    for edge in (0.01, 1.0):
        assert len(read_mjcf(mjcf_xml(box.format(edge) + arm)).visuals) == 2
