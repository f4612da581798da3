"""ROS packages are found where they are given, above the description, and where ROS looks for them."""

from __future__ import annotations

import shlex
import struct
from pathlib import Path

import numpy as np
import pytest

from armid.cli.main import main
from armid.errors import RobotError
from armid.robot import Robot, load_robot

URDF = """<robot name="arm"><link name="base"/><link name="a"><collision><geometry>
<mesh filename="package://arm_description/meshes/a.stl"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""

XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:include filename="$(find arm_description)/parts.xacro"/>
<xacro:part/></robot>"""

PARTS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="part">
<link name="base"/><link name="a"/><joint name="j" type="continuous"><parent link="base"/><child link="a"/></joint>
</xacro:macro></robot>"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package far from any description."""
    folder = tmp_path / "elsewhere" / "src" / "arm_description"
    (folder / "meshes").mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>arm_description</name></package>")
    (folder / "parts.xacro").write_text(PARTS)
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    sides = [corners[[a, b, c]] for a, b, c in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))]
    facets = [struct.pack("<12fH", 0.0, 0.0, 0.0, *side.ravel(), 0) for side in sides]
    (folder / "meshes" / "a.stl").write_bytes(bytes(80) + struct.pack("<I", len(facets)) + b"".join(facets))
    return folder


@pytest.fixture
def alone(tmp_path: Path) -> Path:
    path = tmp_path / "taken" / "out" / "arm.urdf"
    path.parent.mkdir(parents=True)
    path.write_text(URDF)
    return path


def codes(robot: Robot) -> set[str]:
    return {finding.code for finding in robot.findings}


def test_a_package_that_is_given(alone: Path, package: Path):
    assert "mesh-missing" in codes(load_robot(alone))
    robot = load_robot(alone, packages={"arm_description": str(package)})
    assert "mesh-missing" not in codes(robot) and Path(robot.shapes[0].path) == package / "meshes" / "a.stl"
    assert "mesh-missing" in codes(load_robot(alone))  # for that one description
    with pytest.raises(RobotError, match="of the package arm_description does not exist"):
        load_robot(alone, packages={"arm_description": "nowhere"})


@pytest.mark.parametrize("below", ["", "src", "src/arm_description"])
def test_packages_of_ros_1(below: str, alone: Path, package: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{package.parents[1] / below}")
    assert "mesh-missing" not in codes(load_robot(alone))


def test_packages_of_ros_2(alone: Path, package: Path, monkeypatch: pytest.MonkeyPatch):
    share = package.parents[1] / "share"
    share.mkdir()
    package.rename(share / "arm_description")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{share.parent}")
    assert "mesh-missing" not in codes(load_robot(alone))


def test_xacro_finds_packages_where_meshes_are_found(
    tmp_path: Path, package: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    pytest.importorskip("xacrodoc")
    path = tmp_path / "taken" / "arm.xacro"
    path.parent.mkdir()
    path.write_text(XACRO.replace("arm_description", "unheard_of"))
    with pytest.raises(RobotError, match=r"(?s)package unheard_of is not found.*--package unheard_of=DIR"):
        load_robot(path)
    with pytest.raises(SystemExit) as end:
        main(["base", str(path), "--package", f"unheard_of={package}"])
    assert not end.value.code, capsys.readouterr().err
    path.write_text(XACRO)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(package.parent))
    assert load_robot(path).joint_names == ("j",)


@pytest.mark.parametrize("meshes", ["meshes", "meshes/shapes", "stl"])
def test_the_option_that_is_named_finds_meshes_near_the_description(tmp_path: Path, package: Path, meshes: str):
    """The folder of the description stands beside that of the meshes, under another name than in the package."""
    path = tmp_path / "copied here" / "urdf" / "arm.urdf"
    path.parent.mkdir(parents=True)
    path.write_text(URDF.replace("arm_description/meshes", "arm_description/robots/arm/meshes/shapes"))
    there = path.parents[1] / meshes / "a.stl"
    there.parent.mkdir(parents=True)
    there.write_bytes((package / "meshes" / "a.stl").read_bytes())
    (missing,) = (finding for finding in load_robot(path).findings if finding.code == "mesh-missing")
    words = shlex.split(missing.remedy.partition("--package ")[2])
    assert words and "--package" in missing.evidence
    name, _, folder = words[0].rstrip(";").partition("=")
    robot = load_robot(path, packages={name: folder.rstrip(";")})
    assert "mesh-missing" not in codes(robot) and Path(robot.shapes[0].path).samefile(there)


def test_no_option_is_named_where_no_mesh_is_near(alone: Path):
    (missing,) = (finding for finding in load_robot(alone).findings if finding.code == "mesh-missing")
    assert "--package NAME=DIR" in missing.remedy and "--package" not in missing.evidence


def test_what_is_no_package_is_refused(alone: Path, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as end:
        main(["base", str(alone), "--package", "arm_description"])
    assert end.value.code == 2 and "write --package NAME=DIR" in capsys.readouterr().err


def test_a_package_of_one_xacro_file_is_not_known_to_the_next(
    tmp_path: Path, package: Path, monkeypatch: pytest.MonkeyPatch
):
    """Neither by the memory of the library that expands the files, nor by that of the command line."""
    pytest.importorskip("xacrodoc")
    path = tmp_path / "taken" / "arm.xacro"
    path.parent.mkdir()
    path.write_text(XACRO)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(package.parent))
    assert load_robot(path).joint_names == ("j",)
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    with pytest.raises(RobotError, match="arm_description is not found"):
        load_robot(path)
    with pytest.raises(SystemExit) as end:
        main(["base", str(path), "--package", f"arm_description={package}"])
    assert not end.value.code
    with pytest.raises(RobotError, match="arm_description is not found"):
        load_robot(path)
