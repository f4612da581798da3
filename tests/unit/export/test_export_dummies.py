"""Links of a description that have no extent: sensors and tools of a mass alone, frames of nothing."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from armid.errors import OutputError
from armid.export.write import export_run
from armid.robot import load_robot
from exports import run_of, run_with

SENSOR = '<inertial><mass value="0.1"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'
NOTHING = '<inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'
BODY = (
    '<inertial><origin xyz="0.02 0 0.1"/><mass value="{}"/>'
    '<inertia ixx="0.05" ixy="0" ixz="0" iyy="0.06" iyz="0" izz="0.04"/></inertial>'
)


def fixed(name, parent, inside, at="0 0 0.05"):
    return (
        f'<link name="{name}">{inside}</link><joint name="{name}_fix" type="fixed"><parent link="{parent}"/>'
        f'<child link="{name}"/><origin xyz="{at}"/></joint>'
    )


def moved(name, parent, axis, inside):
    return (
        f'<link name="{name}">{inside}</link><joint name="{name}_joint" type="revolute"><parent link="{parent}"/>'
        f'<child link="{name}"/><origin xyz="0 0 0.3"/><axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" velocity="2" effort="20"/></joint>'
    )


URDF = (
    '<robot name="dummies"><link name="base"/>'
    + moved("mere", "base", "0 0 1", "")
    + moved("one", "mere", "0 1 0", BODY.format(3.0))
    + fixed("sensor", "one", SENSOR, "0.05 0 0.2")
    + moved("two", "one", "0 1 0", BODY.format(2.0))
    + fixed("tool", "two", SENSOR)
    + fixed("tip", "tool", "")
    + fixed("nothing", "tip", NOTHING)
    + "</robot>"
)


@pytest.fixture
def description(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(URDF)
    return path


def the_run(tmp_path, description, mass=1.1):
    """A run whose links are those of the description, heavier or lighter."""
    robot = load_robot(description)
    vectors = robot.inertial_vector.copy()
    vectors[0] = [0.4, 0, 0, 0.04, 0.02, 0, 0.02, 0, 0, 0.01]
    return run_of(tmp_path / "run", description, inertial=np.vstack([vectors[0], mass * vectors[1:]]))


def link(text, name):
    return re.search(rf'<link name="{name}">.*?</link>', text)[0]


def test_links_without_extent_stay_as_they_are(tmp_path, description):
    exported = export_run(the_run(tmp_path, description), "urdf", tmp_path / "out.urdf")
    text = (tmp_path / "out.urdf").read_text()
    for name in ("sensor", "tool", "tip", "nothing"):
        assert link(text, name) == link(URDF, name)
    found = [finding for finding in exported.findings if finding.code == "links-as-described"]
    assert [finding.channel for finding in found] == ["sensor", "tool"]
    assert all(finding.severity == "info" for finding in found)
    assert all(check.ok for check in exported.checks)


def test_the_file_has_the_torque_that_was_identified(tmp_path, description):
    run = the_run(tmp_path, description)
    export_run(run, "urdf", tmp_path / "out.urdf")
    again = load_robot(tmp_path / "out.urdf")
    wanted = run.estimate.fit.standard.values[run.model.inertial_columns].reshape(3, 10)
    assert again.inertial_vector == pytest.approx(wanted, abs=1e-12)


def test_links_too_heavy_for_what_carries_them_are_no_obstacle(tmp_path, description):
    light = np.array([0.05, 0, 0, 0.005, 0.001, 0, 0.001, 0, 0, 0.0005])
    run = run_of(tmp_path / "run", description, inertial=np.array([light, light, light]))
    exported = export_run(run, "urdf", tmp_path / "out.urdf")
    assert "unphysical" not in {f.code for f in exported.findings}
    assert all(check.ok for check in exported.checks)


@pytest.mark.parametrize("to", ["mjcf", "sdf"])
def test_other_formats_take_the_links_as_they_move(tmp_path, description, to):
    exported = export_run(the_run(tmp_path, description), to, tmp_path / f"out.{to}")
    assert all(check.ok for check in exported.checks)


MJCF = """<mujoco model="dummies"><worldbody>
<body name="one" pos="0 0 0.3"><joint name="a" axis="0 1 0" range="-90 90"/>
<inertial pos="0.02 0 0.1" mass="3" diaginertia="0.05 0.06 0.04"/>
<body name="sensor" pos="0.05 0 0.2"><inertial pos="0 0 0" mass="0.1" diaginertia="0 0 0"/></body>
<body name="two" pos="0 0 0.3"><joint name="b" axis="0 1 0" range="-90 90"/>
<inertial pos="0.02 0 0.1" mass="2" diaginertia="0.05 0.06 0.04"/>
<body name="frame" pos="0 0 0.1"><body name="tool" pos="0 0 0.05">
<inertial pos="0 0 0" mass="0.1" diaginertia="0 0 0"/></body></body></body></body></worldbody></mujoco>"""


def test_the_same_in_mjcf(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(MJCF)
    run = run_of(tmp_path / "run", path, inertial=1.1 * load_robot(path).inertial_vector)
    exported = export_run(run, "mjcf", tmp_path / "out.xml")
    text = (tmp_path / "out.xml").read_text()
    assert text.count('<inertial pos="0 0 0" mass="0.1" diaginertia="0 0 0"/>') == 2
    assert [f.channel for f in exported.findings if f.code == "links-as-described"] == ["sensor", "tool"]


def test_the_remedy_for_what_cannot_be_is_no_circle(tmp_path, description):
    """Standard parameters were estimated already, so that to estimate them again is no remedy."""
    run = the_run(tmp_path, description)
    theta = run.estimate.fit.standard.values.copy()
    theta[run.model.inertial_columns[20:]] = 0.0
    bad = run_with(tmp_path / "bad", description, run.model, theta)
    with pytest.raises(OutputError, match="Not physically consistent") as caught:
        export_run(bad, "urdf", tmp_path / "bad.urdf")
    assert "physical" not in caught.value.remedy and not Path(tmp_path / "bad.urdf").exists()
