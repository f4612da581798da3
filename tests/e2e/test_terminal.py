"""The command line as a terminal, a pipe and a shell's completion see it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from armid.dataclass_files import save
from armid.robot import load_robot
from labs import write_arm

STEPS = ("start pose", "search", "limits", "bodies", "files", "preview")
"""Beginnings of the lines that `armid excite` prints in a pipe."""


def program(*arguments: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run `armid` as a program of its own, with both streams in a pipe."""
    script = "from armid.cli.main import main; main()"
    clean = {key: value for key, value in os.environ.items() if "COLOR" not in key and not key.startswith("TTY_")}
    command = [sys.executable, "-c", script, *arguments]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, env=clean | environment, check=False)


def test_alone_it_tells_the_next_step(tmp_path: Path):
    write_arm(tmp_path)
    done = program(cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "") and "armid excite small.urdf" in done.stdout


def test_a_mistyped_command_is_guessed(tmp_path: Path):
    done = program("identfy", cwd=tmp_path)
    assert done.returncode == 2 and "Did you mean 'identify'?" in done.stderr


def test_a_shell_completes_commands(tmp_path: Path):
    asked = {"_ARMID_COMPLETE": "complete_bash", "COMP_WORDS": "armid re", "COMP_CWORD": "1"}
    done = program(cwd=tmp_path, **asked)
    assert done.stdout.split() == ["recalibrate", "report"]


def test_a_shell_completes_arms(tmp_path: Path):
    write_arm(tmp_path)
    (tmp_path / "run1.csv").write_text("t,q1,tau1\n")
    for words, found in (
        ("base ", {"iiwa14-r820", "iiwa7-r800", "panda", "small.urdf", "ur10e", "ur5e"}),
        ("excite ur", {"ur10e", "ur5e"}),
        ("identify s", {"small.urdf"}),
        ("doctor pa", {"panda"}),
        ("preview i", {"iiwa14-r820", "iiwa7-r800"}),
        ("base run", set[str]()),  # then the shell goes on with files
    ):
        asked = {"_ARMID_COMPLETE": "complete_bash", "COMP_WORDS": f"armid {words}", "COMP_CWORD": "2"}
        assert set(program(cwd=tmp_path, **asked).stdout.split()) == found, words


def completed(words: str, cwd: Path) -> list[str]:
    """Return what a shell would offer for the last of the words."""
    line = f"armid {words}"
    asked = {"_ARMID_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1)}
    return program(cwd=cwd, **asked).stdout.split()


def test_a_shell_completes_values_of_options(tmp_path: Path):
    write_arm(tmp_path)
    (tmp_path / "study.toml").write_text('[robot]\ndescription = "small.urdf"\n')
    all_joints = ["joint_1", "joint_2", "joint_3"]
    for words, found in (
        ("identify small.urdf run.csv --method ph", ["physical"]),
        ("identify small.urdf run.csv --terms vis", ["viscous"]),
        ("identify small.urdf run.csv --terms rigid-body,vis", ["rigid-body,viscous"]),
        ("export runs/small --to m", ["mjcf", "matlab"]),
        ("excite small.urdf --criterion s", ["scaled-condition"]),
        ("excite small.urdf --limit joint_2.v", ["joint_2.velocity="]),
        ("base small.urdf --lock ", all_joints),
        ("doctor study.toml --lock joint_3", ["joint_3"]),
        ("base small.urdf --only joint_1,", ["joint_1,joint_2", "joint_1,joint_3"]),
        ("base small.urdf --tip link_", ["link_1", "link_2", "link_3"]),
        ("base ur5e --lock w", ["wrist_1_joint", "wrist_2_joint", "wrist_3_joint"]),
        ("base nowhere.urdf --lock ", []),
        ("base --lock ", []),  # no arm is named yet
        ("base 'small.urdf --lock joint_1", []),  # a quote is open: no file has this name
    ):
        offered = completed(words, tmp_path)
        assert offered == found, words


def test_a_shell_completes_the_links_of_a_run(tmp_path: Path):
    (tmp_path / "run").mkdir()
    save(load_robot("ur5e"), tmp_path / "run" / "robot.npz")
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "robot.npz").write_bytes(b"no archive")
    assert completed("payload run log.csv --link link_3", tmp_path) == ["link_3"]
    assert len(completed("payload run log.csv --link ", tmp_path)) == 6
    assert completed("payload broken log.csv --link ", tmp_path) == []


def test_names_come_from_any_description_and_only_those_that_move(tmp_path: Path):
    (tmp_path / "arm.xml").write_text(
        '<mujoco><!-- <joint name="gone"/> --><worldbody><body name="upper"><joint name="lift" axis="0 0 1"/>'
        '<freejoint name="float"/><site name="tool"/></body></worldbody></mujoco>'
    )
    (tmp_path / "arm.urdf").write_text(
        '<robot name="a"><link name="base"/><link name="hand"/><joint type="fixed" name="weld"/>'
        "<joint name='turn' type='revolute'/><transmission><joint name='turn'/></transmission></robot>"
    )
    (tmp_path / "broken.urdf").write_bytes(b"\xff\xfe<joint")
    assert completed("base arm.xml --lock ", tmp_path) == ["lift"]
    assert completed("base arm.urdf --lock ", tmp_path) == ["turn"]
    assert completed("base broken.urdf --lock ", tmp_path) == []


def test_completing_loads_nothing_heavy(tmp_path: Path):
    write_arm(tmp_path)
    script = (
        "import os, sys\nfrom armid.cli.value_completion import joints\n"
        "os.environ['COMP_WORDS'] = 'armid base small.urdf'\n"
        "assert joints('joint_1') == ['joint_1']\n"
        "print(*sorted({'numpy', 'scipy', 'rich', 'pinocchio'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_colours_and_bars_vanish_in_a_pipe(tmp_path: Path):
    write_arm(tmp_path)
    options = ("--duration", "4", "--harmonics", "3", "--budget", "0.5", "--workers", "0")
    done = program("excite", "small.urdf", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "\x1b" not in done.stdout + done.stderr and "\r" not in done.stderr and "━" not in done.stderr
    steps = [line.split(":")[0] for line in done.stderr.splitlines() if line.split(":")[0] in STEPS]
    assert steps == ["start pose", "search", "limits", "bodies", "files", "preview"]
    assert "search: the best motion within 0.5 s (--budget)\n" in done.stderr


@pytest.mark.parametrize("experiment", ["poses", "sweeps"])
def test_long_steps_are_told_in_a_pipe(experiment: str, tmp_path: Path):
    write_arm(tmp_path)
    done = program("excite", "small.urdf", "--experiment", experiment, "--poses", "3", "--no-report", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [line.split(":")[0] for line in done.stderr.splitlines()][:2] == [experiment, "files"]
    done = program("excite", "small.urdf", "--experiment", experiment, "--json", "--out", "b", cwd=tmp_path)
    assert "files:" not in done.stderr
