"""No input makes armid run a program, write elsewhere, or read a file that the user did not name."""

from __future__ import annotations

import os
from contextvars import copy_context
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from injections import ATTEMPTS, SECRET, write_outside
from opened_files import RUN, recorded_events

from armid.cli.main import main
from armid.codegen.catalogue import LANGUAGES
from armid.codegen.generation import generate
from armid.errors import RobotError
from armid.input_boundary import allow
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Viscous
from armid.robot import load_robot
from labs import URDF
from trees import robot_of

NEEDED = {
    "HDF5": "h5py",
    "MATLAB 7.3": "h5py",
    "bag": "rosbags",
    "xacro": "xacrodoc",
    "mesh": "jinja2",
    "MJCF": "jinja2",
}
"""Packages that attempts need, by the beginning of their names."""


@pytest.fixture
def outside(tmp_path: Path) -> Path:
    write_outside(tmp_path / "outside")
    return tmp_path / "outside"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Working folder, so deep that the folder outside is not beside it."""
    made = tmp_path / "own" / "work"
    made.mkdir(parents=True)
    monkeypatch.chdir(made)
    return made


@pytest.mark.parametrize("name", ATTEMPTS)
def test_no_attempt_succeeds(name: str, folder: Path, outside: Path, capfd: pytest.CaptureFixture[str]):
    for kind, package in NEEDED.items():
        if name.startswith(kind):
            pytest.importorskip(package)
    command = ATTEMPTS[name](folder, outside)
    before = {path: path.stat().st_mtime_ns for path in outside.rglob("*")}
    with recorded_events() as events, pytest.raises(SystemExit) as ended:
        main(list(command))
    out, err = capfd.readouterr()
    assert ended.value.code in (0, 1, 2, None), err
    assert {path: path.stat().st_mtime_ns for path in outside.rglob("*")} == before
    assert not list(folder.parents[1].rglob("*pwned*.csv")) or name.startswith("name:")
    assert not [path for path in folder.parents[1].rglob("pwned") if path.is_file()]
    assert not [what for event, what in events if event in RUN]
    assert not [what for event, what in events if event == "open" and os.path.abspath(what).startswith(str(outside))]
    written = "".join(path.read_text(errors="replace") for path in folder.rglob("*") if path.is_file())
    assert SECRET not in out + err + written


def test_what_is_refused_is_there_and_can_be_allowed(folder: Path, outside: Path, capsys: pytest.CaptureFixture[str]):
    """Else the attempts above would also fail where nothing is refused."""
    for name in ("MJCF: include, absolute", "xacro: include, upwards"):
        command = ATTEMPTS[name](folder, outside)
        with pytest.raises(RobotError, match="outside of its own folders"):
            load_robot(command[1])
        capsys.readouterr()
        with recorded_events() as events, pytest.raises(SystemExit) as ended:
            main(["--allow", "outside=1", *command])
        assert ended.value.code in (0, 2, None), capsys.readouterr().err
        assert [what for event, what in events if event == "open" and str(outside) in os.path.abspath(what)]


@pytest.mark.parametrize("reference", ["OUT/secret.stl", "file://OUT/secret.stl", "../../outside/secret.stl"])
def test_meshes_outside_are_missing_until_they_are_allowed(reference: str, folder: Path, outside: Path):
    shape = f'<visual><geometry><mesh filename="{reference.replace("OUT", str(outside))}"/></geometry></visual>'
    (folder / "arm.urdf").write_text(URDF.replace('<link name="base"/>', f'<link name="base">{shape}</link>'))
    robot = load_robot("arm.urdf")
    assert not robot.visuals and "visual-missing" in {finding.code for finding in robot.findings}

    def allowed() -> str:
        allow({"outside": 1})
        return load_robot("arm.urdf").visuals[0].path

    assert os.path.samefile(copy_context().run(allowed), outside / "secret.stl")


def test_files_of_the_package_are_read_through_links(folder: Path, tmp_path: Path):
    """Tools of ROS install links to the files of a package; and a description names meshes beside its own folder."""
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "a.stl").write_text("solid a\nendsolid a\n")
    (folder / "a" / "meshes").mkdir(parents=True)
    (folder / "a" / "urdf" / "deep").mkdir(parents=True)
    (folder / "a" / "package.xml").write_text("<package><name>a</name></package>")
    (folder / "a" / "meshes" / "a.stl").symlink_to(tmp_path / "elsewhere" / "a.stl")
    for reference in ("../../meshes/a.stl", "package://a/meshes/a.stl"):
        shape = f'<visual><geometry><mesh filename="{reference}"/></geometry></visual>'
        path = folder / "a" / "urdf" / "deep" / "arm.urdf"
        path.write_text(URDF.replace('<link name="base"/>', f'<link name="base">{shape}</link>'))
        assert len(load_robot(path).visuals) == 1


NAMES = (
    '*/ system("touch pwned"); /*',
    '""" + __import__("os").system("touch pwned") + """',
    "\nsystem('touch pwned')\n%",
    "$(run(`touch pwned`))",
    "]]><exec>touch pwned</exec>",
    "${CMAKE_SOURCE_DIR};execute_process(COMMAND touch pwned)",
    "x: !!python/object/apply:os.system ['touch pwned']",
    '\\\nsystem("touch pwned"); ??/\n',
    "../../../pwned",
    "\u202etouch pwned\u2066",
)
"""Names of arms and joints that would be code, if they stood unchanged in a file."""


HARMLESS = set("./abcdefghijklmnopqrstuvwxyz")
"""Characters that cannot end a comment or a string of any language."""


@pytest.mark.parametrize("language", LANGUAGES)
def test_names_become_neither_code_nor_paths(language: str):
    robot = robot_of(load_robot("ur5e").tree)
    for name in NAMES:
        joints = (replace(robot.joints[0], name=f"{name}1"), *robot.joints[1:])
        model = DynamicsModel(replace(robot, name=name, joints=joints), (Viscous(),))
        files = generate(model, find_base_parameters(model), np.ones(6), language, heading=(name,))
        assert files
        for file, text in files.items():
            assert not Path(file).is_absolute() and ".." not in Path(file).parts
            assert name not in text or set(name) <= HARMLESS
            assert 'touch pwned")' not in text and "\u202e" not in text
