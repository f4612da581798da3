"""Files for ROS packages, expanded by xacro in macros of the form of the packages, and loaded by Pinocchio."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from armid.errors import OutputError
from armid.export.ros.files import franka_description, ur_description
from armid.export.ros.write import export_for_ros
from armid.export.write import export_run
from armid.model.motion import Motion
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.robot.readers.xacro import expand
from armid.runs.run import Run
from armid.runs.validation_and_prediction import predict
from exports import LOCKED, URDF, run_of
from ros_packages import described, franka_arm, franka_package, frictionless, ur_arm, ur_package

pin = pytest.importorskip("pinocchio", reason="the package pin is not installed")
pytestmark = pytest.mark.witness

pytest.importorskip("xacrodoc")

TOLERANCE = 1e-9
"""Relative to the largest torque: numbers have seventeen digits, and the recursions differ in rounding only."""

WIDTH = 0.02
TERMS = (RigidBody(), Viscous(), Coulomb(width=WIDTH))


def motion_of(n: int) -> Motion:
    rng = np.random.default_rng(n)
    q, dq, ddq = (size * rng.uniform(-1.0, 1.0, (40, n)) for size in (2.0, 1.5, 4.0))
    return Motion(np.arange(40) * 0.01, q, dq, ddq)


def torque_in_pinocchio(urdf: str, run: Run, motion: Motion, prefix: str = "") -> np.ndarray[Any, Any]:
    """Rigid-body torque, and friction with the magnitudes of the file and the law of the model."""
    model = pin.buildModelFromXML(urdf)
    model.gravity.linear = np.array(run.robot.gravity)
    data = model.createData()
    joints = [model.joints[model.getJointId(prefix + name)] for name in run.robot.joint_names]
    at = [joint.idx_v for joint in joints]
    tau = np.empty_like(motion.q)
    for k in range(motion.samples):
        position, rates = pin.neutral(model), np.zeros((2, model.nv))
        for joint, angle in zip(joints, motion.q[k], strict=True):
            where = slice(joint.idx_q, joint.idx_q + joint.nq)
            position[where] = [np.cos(angle), np.sin(angle)] if joint.nq == 2 else angle
        rates[:, at] = motion.dq[k], motion.ddq[k]
        tau[k] = pin.rnea(model, data, position, *rates)[at]
    return tau + model.damping[at] * motion.dq + model.friction[at] * np.tanh(motion.dq / WIDTH)


def agrees(urdf: str, run: Run, prefix: str = "") -> None:
    motion = motion_of(run.robot.n)
    expected = predict(run, motion)
    found = torque_in_pinocchio(urdf, run, motion, prefix)
    np.testing.assert_allclose(found, expected, rtol=0, atol=TOLERANCE * np.abs(expected).max())


def run_from(text: str, folder: Path, **options: Any) -> Run:
    (folder / "arm.urdf").write_text(text)
    return run_of(folder / "run", folder / "arm.urdf", terms=TERMS, **options)


@pytest.mark.parametrize("prefix", ["", "left_"])
def test_ur_description(tmp_path: Path, prefix: str):
    run = run_from(ur_arm(described(), frictionless, prefix, ">"), tmp_path)
    exported = export_for_ros(run, "ur-description", tmp_path / "config")
    physical, dynamics = (tmp_path / "config" / f"{name}.yaml" for name in ("physical_parameters", "joint_dynamics"))
    assert exported.files == (physical, dynamics) and all(check.ok for check in exported.checks)
    agrees(expand(ur_package(str(physical), str(dynamics)), str(tmp_path / "ur.xacro")), _named(run, prefix))
    content = yaml.safe_load(physical.read_text())
    assert content["offsets"] == {"shoulder_offset": 0.138, "elbow_offset": 0.007}
    base = content["inertia_parameters"]["links"]["base"]
    assert base == pytest.approx({"radius": 0.06, "length": 0.05}, rel=1e-5)  # the package has 0.0833333 for 1/12
    numbers = [x for tensor in content["inertia_parameters"]["tensor"].values() for x in tensor.values()]
    assert len(numbers) == 36 and all(isinstance(x, float) for x in numbers)


def _named(run: Run, prefix: str) -> Run:
    """The run with joints that are named without a prefix, as the stand-in of the package has them."""
    from dataclasses import replace

    robot = run.robot
    joints = tuple(replace(joint, name=joint.name.removeprefix(prefix)) for joint in robot.joints)
    return replace(run, robot=replace(robot, joints=joints))


def test_franka_description(tmp_path: Path):
    """The hand keeps the inertia of its own file."""
    run = run_from(franka_arm(described(), frictionless), tmp_path)
    exported = export_for_ros(run, "franka-description")
    inertials, dynamics = exported.files
    assert inertials == tmp_path / "run" / "franka-description" / "inertials.yaml"
    agrees(expand(franka_package(str(inertials), str(dynamics)), str(tmp_path / "fr3.xacro")), run)
    side = json.loads(exported.side.read_text())
    assert side["kind"] == "armid-model 1" and side["file"]["name"] == "inertials.yaml"


@pytest.mark.parametrize("prefix", ["", "left_"])
def test_a_xacro_macro(tmp_path: Path, prefix: str):
    """Included by another file, as a file for MoveIt or ros2_control includes it."""
    run = run_from(ur_arm(described(), frictionless, head=">"), tmp_path)
    exported = export_for_ros(run, "xacro", tmp_path / "out")
    assert exported.path == tmp_path / "out" / "ur5e.urdf.xacro"
    cell = f"""<robot name="cell" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:include filename="{exported.path}"/><xacro:ur5e prefix="{prefix}"/>
<link name="world"/><joint name="mount" type="fixed"><parent link="world"/><child link="{prefix}base_link"/></joint>
<ros2_control name="arm" type="system"><joint name="{prefix}elbow_joint"/></ros2_control></robot>"""
    agrees(expand(cell, str(tmp_path / "cell.xacro")), run, prefix)
    assert "<box size" in exported.path.read_text()  # shapes stay


def test_a_xacro_macro_of_any_arm(tmp_path: Path):
    (tmp_path / "odd.urdf").write_text(URDF)
    run = run_of(tmp_path / "run", tmp_path / "odd.urdf", locked=LOCKED)
    text = export_for_ros(run, "xacro").path.read_text()
    used = expand(text.replace("</robot>", '<xacro:odd prefix="p_"/></robot>'), str(tmp_path / "x.xacro"))
    assert 'reference="p_three"' in used and 'mimic joint="p_c"' in used and "measured in 2009" in text
    run = run_of(tmp_path / "built_in", "iiwa14-r820", terms=TERMS)
    path = export_for_ros(run, "xacro").path
    used = path.read_text().replace("</robot>", f'<xacro:{path.name.split(".")[0]} prefix=""/></robot>')
    agrees(expand(used, str(path)), run)


def test_a_xacro_macro_is_used_twice_in_one_file(tmp_path: Path):
    """Two arms in one cell: names of materials, transmissions and controllers must not be repeated."""
    more = (
        '<material name="Black"><color rgba="0 0 0 1"/></material>'
        '<transmission name="drive"><joint name="elbow_joint"/><actuator name="motor"/></transmission>'
        '<ros2_control name="control" type="system"/></robot>'
    )
    text = ur_arm(described(), frictionless, head=">").replace("</robot>", more)
    text = text.replace("</geometry></visual>", '</geometry><material name="Black"/></visual>')
    assert text.count('name="Black"') > 1
    exported = export_for_ros(run_from(text, tmp_path), "xacro", tmp_path / "out")
    mounts = "".join(
        f'<xacro:ur5e prefix="{side}"/><joint name="{side}mount" type="fixed"><parent link="world"/>'
        f'<child link="{side}base_link"/></joint>'
        for side in ("l_", "r_")
    )
    cell = f"""<robot name="cell" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="world"/>
<xacro:include filename="{exported.path}"/>{mounts}</robot>"""
    used = expand(cell, str(tmp_path / "cell.xacro"))
    assert pin.buildModelFromXML(used).nq == 12
    for tag in ("material", "transmission", "ros2_control"):
        names = [each.get("name") for each in ElementTree.fromstring(used).findall(tag)]
        assert len(names) == len(set(names)) == 2


def test_arms_with_the_names_of_a_package_and_other_frames(tmp_path: Path):
    """Descriptions of UR arms for ROS 1 have the same names of links; the numbers would be in the wrong frames."""
    urdf = ur_arm(described(), frictionless, head=">")
    turned = urdf.replace('rpy="1.570796327 0 0"', 'rpy="0 1.570796327 0"', 1)
    assert turned != urdf
    with pytest.raises(OutputError, match=r"other frames.*shoulder_lift_joint"):
        ur_description.write(turned.encode(), "an arm")
    about_y = urdf.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 1 0"/>')
    with pytest.raises(OutputError, match="shoulder_pan_joint, shoulder_lift_joint"):
        ur_description.write(about_y.encode(), "an arm")
    with pytest.raises(OutputError, match="needs the mass of the base"):
        ur_description.write(urdf.replace("base_link_inertia", "base_link_body").encode(), "an arm")
    other = franka_arm(described(), frictionless).replace('rpy="-1.570796326794897 0 0"', 'rpy="0 0 0"')
    with pytest.raises(OutputError, match=r"other frames.*fr3_joint2"):
        franka_description.write(other.encode(), "an arm")


def test_arms_that_are_not_of_the_package(tmp_path: Path):
    run = run_from(ur_arm(described(), frictionless, head=">"), tmp_path)
    with pytest.raises(OutputError, match="no arm with the links of the package franka_description"):
        export_for_ros(run, "franka-description")
    with pytest.raises(OutputError, match="URDF or xacro of this package"):
        export_for_ros(run_of(tmp_path / "built_in", "iiwa14-r820", terms=TERMS), "ur-description")
    with pytest.raises(OutputError, match="did you mean 'ur-description'"):
        export_run(run, "ur-descriptoin")


def test_links_without_inertia_are_named():
    """The macros of the packages need the inertia of every link, so an entry must not be left out."""
    inertial = described()
    urdf = ur_arm(lambda link: "" if link == "wrist_3" else inertial(link), frictionless, head=">")
    with pytest.raises(OutputError, match="has none of wrist_3_link"):
        ur_description.write(urdf.encode(), "an arm")


def test_a_heavier_tool_has_the_mass_and_the_files_of_the_package_do_not(tmp_path: Path):
    """Then the package would not have the identified torque, so nothing is written."""
    tool = '<inertial><mass value="9"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
    text = ur_arm(described(), frictionless, head=">").replace(
        '<link name="tool0"/>', f'<link name="tool0">{tool}</link>'
    )
    run = run_from(text, tmp_path)
    with pytest.raises(OutputError, match="differs from the identified model"):
        export_for_ros(run, "ur-description", tmp_path / "config")
    assert not (tmp_path / "config").exists()


def test_other_files_are_kept(tmp_path: Path):
    run = run_from(ur_arm(described(), frictionless, head=">"), tmp_path)
    config = tmp_path / "config"
    config.mkdir()
    (config / "physical_parameters.yaml").write_text("offsets: {}\n")
    with pytest.raises(OutputError, match="would be overwritten"):
        export_for_ros(run, "ur-description", config)
    (config / "physical_parameters.yaml").unlink()
    export_for_ros(run, "ur-description", config)
    export_for_ros(run, "ur-description", config)
