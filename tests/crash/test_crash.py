"""Commands that are killed, stopped or run out of space, and commands in odd surroundings."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are forked, and found in /proc")

ROOT = Path(__file__).parents[2]
KILL = ROOT / "scripts" / "kill"
SURROUNDINGS = Path(__file__).parent / "surroundings.py"
PAGE = ROOT / "docs" / "surroundings.md"


def faults_of(*arguments: str) -> list[str]:
    """Failed checks of disturbed commands; in a program of its own, because these commands are forked."""
    done = subprocess.run(
        [sys.executable, str(KILL), "--json", *arguments], capture_output=True, text=True, check=False
    )
    told = json.loads(done.stdout)
    assert told["moments"] > 0, done.stderr
    return told["failures"]


def test_a_disturbed_command_leaves_the_earlier_or_the_new_result():
    scenes = ("excite", "export")
    counts = ("--moments", "4", "--full", "3", "--stopped", "2", "--quotas", "0")
    assert faults_of(*counts, *(word for name in scenes for word in ("--scene", name))) == []


@pytest.mark.long
def test_every_command_at_many_moments():
    assert faults_of("--moments", "300", "--full", "400", "--stopped", "60") == []


@cache
def outcomes(*arguments: str) -> dict[str, str]:
    """Reason why each case fails, or an empty text; all cases in one program, which forks most of them."""
    command = [sys.executable, str(SURROUNDINGS), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def names(*, slow: bool) -> list[str]:
    """Names of the cases on the page, which are those of the table, since another test compares them."""
    from surroundings import cases

    return [f"{case.group}: {case.name}" for case in cases() if slow or not case.slow]


@pytest.mark.parametrize("name", names(slow=False))
def test_odd_surroundings(name: str):
    assert outcomes("--quick")[name] == ""


@pytest.mark.long
def test_all_odd_surroundings():
    assert {name: why for name, why in outcomes().items() if why} == {}
    assert outcomes().keys() == {*names(slow=True)} and len(outcomes()) >= 60


def test_the_page_lists_the_cases():
    from surroundings import cases, table

    assert PAGE.read_text(encoding="utf-8").endswith(table(cases()))
