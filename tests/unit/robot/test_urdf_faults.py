"""Unusual URDF: namespaces, unexpanded xacro, missing limits, impossible inertias, unknown shapes."""

from __future__ import annotations

import numpy as np
import pytest

from armid.errors import RobotError
from armid.export.write import export_run
from armid.robot import load_robot
from armid.robot.described_bodies.reading import described_bodies
from armid.robot.readers import urdf
from exports import LOCKED, URDF, run_of

INERTIAL = (
    '<inertial><origin xyz="0 0 0.1"/><mass value="2"/>'
    '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
)
LIMIT = '<limit lower="-1" upper="2" effort="9" velocity="3"/>'


def arm(inside: str = LIMIT, kind: str = "revolute", link: str = INERTIAL, name: str = "j") -> str:
    """One joint with given contents and a link with given contents."""
    return (
        f'<robot name="r"><link name="base"/><link name="a">{link}</link><joint name="{name}" type="{kind}">'
        f'<parent link="base"/><child link="a"/><axis xyz="0 0 1"/>{inside}</joint></robot>'
    )


def read(text: str):
    return urdf.read(text, source="arm.urdf", locked={}, tip=None)


def told(text: str) -> list[tuple[str, str, str]]:
    return [(finding.code, finding.severity, finding.channel) for finding in read(text).findings]


@pytest.mark.parametrize("space", ["urn:drake", "namespace"])
def test_a_default_namespace_changes_nothing(tmp_path, space):
    (tmp_path / "plain.urdf").write_text(URDF)
    source = tmp_path / "odd.urdf"
    source.write_text(URDF.replace("<robot ", f'<robot xmlns="{space}" '))
    plain, robot = (load_robot(tmp_path / name, lock=LOCKED) for name in ("plain.urdf", "odd.urdf"))
    np.testing.assert_array_equal(robot.inertial_vector, plain.inertial_vector)
    assert robot.joint_names == plain.joint_names
    assert len(described_bodies(robot)) == len(described_bodies(plain)) > 0
    exported = export_run(run_of(tmp_path / "run", source, locked=LOCKED), "urdf")
    written = exported.path.read_text()
    assert f'xmlns="{space}"' in written
    assert "<!-- measured in 2009 -->" in written
    found = load_robot(exported.path, lock=LOCKED).inertial_vector
    without = export_run(run_of(tmp_path / "other", tmp_path / "plain.urdf", locked=LOCKED), "urdf")
    np.testing.assert_array_equal(found, load_robot(without.path, lock=LOCKED).inertial_vector)


@pytest.mark.parametrize(
    ("text", "message", "remedy"),
    [
        (arm('<limit lower="1.5" effort="1" velocity="1"/>'), "has lower=1.5 and no upper, so upper is 0", "add the"),
        (arm('<limit upper="-1" effort="1" velocity="1"/>'), "has upper=-1 and no lower, so lower is 0", "add the"),
        (arm('<origin xyz="${a} 0 0"/>'), r"found '\$\{a\} 0 0'", "xacro"),
        (arm(name="${prefix}j"), "contains xacro that is not expanded", "xacro"),
        (arm(kind="Revolute"), "joint 'j' has the unknown type 'Revolute'", "did you mean 'revolute'"),
        (arm(kind="hinge"), "joint 'j' has the unknown type 'hinge'", "correct the attribute type"),
    ],
)
def test_mistakes_are_told_with_a_remedy(text, message, remedy):
    with pytest.raises(RobotError, match=message) as error:
        read(text)
    assert remedy in error.value.remedy


@pytest.mark.parametrize(
    ("inside", "kind", "words"),
    [
        ("", "revolute", "the revolute joint has no position limits (no tag <limit>"),
        ('<limit effort="1" velocity="1"/>', "prismatic", "the prismatic joint has no position limits (no lower and"),
    ],
)
def test_a_joint_without_position_limits_is_told(inside, kind, words):
    robot = read(arm(inside, kind))
    assert [(f.code, f.severity, f.channel) for f in robot.findings] == [("limits-unknown", "info", "j")]
    assert words in robot.findings[0].evidence
    assert np.isinf(robot.joints[0].position_limits).all()


def test_joints_that_need_no_position_limits():
    assert told(arm("", "continuous")) == []
    assert read(arm('<limit lower="-1.5" effort="1" velocity="1"/>')).joints[0].position_limits.tolist() == [
        -1.5,
        0.0,
    ]


@pytest.mark.parametrize(
    "change", [('value="2"', 'value="-2"'), ('ixx="0.1"', 'ixx="-0.1"'), ('ixy="0"', 'ixy="0.2"')]
)
def test_impossible_inertias_of_moving_links_are_told(change):
    wrong = arm(link=INERTIAL.replace(*change))
    assert told(wrong) == [("inertia-impossible", "warning", "a")]
    still = arm().replace('<link name="base"/>', f'<link name="base">{INERTIAL.replace(*change)}</link>')
    assert told(still) == []


def test_a_second_inertial_is_told_and_the_first_counts():
    robot = read(arm(link=INERTIAL + INERTIAL.replace('value="2"', 'value="3"')))
    assert [(f.code, f.channel) for f in robot.findings] == [("description-ignored", "a")]
    assert robot.links[0].inertial is not None
    assert robot.links[0].inertial.mass == 2.0


@pytest.mark.parametrize(("key", "value"), [("damping", "-1"), ("friction", "-0.5")])
def test_negative_friction_is_told_and_not_used(key, value):
    robot = read(arm(f'{LIMIT}<dynamics {key}="{value}"/>'))
    assert [(f.code, f.severity, f.channel) for f in robot.findings] == [("description-ignored", "warning", "j")]
    assert f'{key}="{value}"' in robot.findings[0].evidence
    assert (robot.joints[0].drive.viscous, robot.joints[0].drive.coulomb) == (0.0, 0.0)


@pytest.mark.parametrize(("tag", "code"), [("collision", "shape-unknown"), ("visual", "visual-left-out")])
def test_an_unknown_shape_is_no_missing_mesh(tmp_path, tag, code):
    path = tmp_path / "arm.urdf"
    shape = f'<{tag}><geometry><plane normal="0 0 1"/></geometry></{tag}>'
    path.write_text(arm(link=INERTIAL + shape))
    robot = load_robot(path)
    (finding,) = (each for each in robot.findings if each.code == code)
    assert finding.channel == "a" and "<plane> of a" in finding.evidence
    assert "mesh-missing" not in {each.code for each in robot.findings}
    assert described_bodies(robot)[0].missing == ("<plane>",)
