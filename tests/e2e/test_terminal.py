"""The command line as a terminal, a pipe and a shell's completion see it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from labs import write_arm


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


def test_colours_and_bars_vanish_in_a_pipe(tmp_path: Path):
    write_arm(tmp_path)
    options = ("--duration", "4", "--harmonics", "3", "--budget", "0.5", "--workers", "0")
    done = program("excite", "small.urdf", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "\x1b" not in done.stdout + done.stderr and "\r" not in done.stderr and "━" not in done.stderr
