"""Claims of the pages about what is there."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from armid.excitation.formats import FORMATS
from armid.measurement.readers import csv
from armid.robot.readers import urdf

ROOT = Path(__file__).parents[2]
PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")))
}

PATH = re.compile(r"`((?:src|native|tests|docs|scripts|benchmarks|examples|\.ci)/[\w./-]*)`")
MODULE = re.compile(r"`(armid(?:\.\w+)+)`")
LINK = re.compile(r"\]\(([^):#]+)(?:#([\w-]+))?\)")
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)

page = pytest.mark.parametrize("page", PAGES)


@page
def test_paths_exist(page: str):
    assert [path for path in PATH.findall(PAGES[page]) if not (ROOT / path).exists()] == []


@page
def test_links_exist(page: str):
    folder = (ROOT / page).parent
    assert [link for link, _ in LINK.findall(PAGES[page]) if not (folder / link).exists()] == []


@page
def test_headings_exist(page: str):
    """Links into pages meet a heading there."""
    folder = (ROOT / page).parent
    missing = []
    for link, place in LINK.findall(PAGES[page]):
        if place:
            text = (folder / link).read_text(encoding="utf-8")
            anchors = {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in HEADING.findall(text)}
            missing += [] if place in anchors else [f"{link}#{place}"]
    assert missing == []


def test_every_page_is_on_the_site():
    """Sphinx warns of a page that no list of contents has; this says so within the ordinary tests."""
    listed = set()
    for name, text in PAGES.items():
        for block in re.findall(r"```\{toctree\}\n(.*?)```", text, re.DOTALL):
            entries = [line for line in block.splitlines() if line and not line.startswith(":")]
            listed |= {str((ROOT / name).parent.relative_to(ROOT) / entry) + ".md" for entry in entries}
    assert {name for name in PAGES if name.startswith("docs/")} == listed | {"docs/index.md"}


@page
def test_names_exist(page: str):
    """Each dotted name is a module, or something in one."""
    missing = []
    for name in MODULE.findall(PAGES[page]):
        home, _, last = name.rpartition(".")
        try:
            importlib.import_module(name)
        except ModuleNotFoundError:
            if not hasattr(importlib.import_module(home), last):
                missing.append(name)
    assert missing == []


@pytest.mark.parametrize(
    ("section", "name", "kind"),
    [
        ("A reader of recordings", "read", csv),
        ("A reader of robot descriptions", "recognises", urdf),
        ("A reader of robot descriptions", "outline", urdf),
        ("A format of a controller", "write", FORMATS["csv"]),
    ],
)
def test_signatures_of_the_page_are_those_of_the_code(section: str, name: str, kind: ModuleType):
    """The block that shows a contract, executed, and beside it one that keeps to the contract."""
    known: dict[str, Any] = {"Path": Path, "Mapping": Mapping}
    known |= dict.fromkeys(("LogFormat", "Robot", "Recording", "JointOutline", "SampledMotion"), object)
    text = PAGES["docs/extending.md"].split(f"\n## {section}\n")[1].split("\n## ")[0]
    (shown,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    exec(shown, known)
    told, real = (inspect.signature(each).parameters for each in (known[name], getattr(kind, name)))
    assert list(told) == list(real)
    assert [each.default for each in told.values()] == [each.default for each in real.values()]


def test_the_example_of_a_recursive_estimate(capsys: pytest.CaptureFixture[str]):
    (block,) = re.findall(r"```python\n(.*?)```", PAGES["docs/recursive.md"], re.DOTALL)
    exec(block, {})
    assert capsys.readouterr().out == "57 (7,)\n"


def test_ci_runs_the_second_command_of_the_readme():
    commands = [block.strip() for block in re.findall(r"```\n(python3 .*?)```", PAGES["README.md"], re.DOTALL)]
    assert len(commands) == 2 and all("\n" not in command for command in commands)
    assert (ROOT / ".ci" / "run").read_text().splitlines()[-1] == commands[1]
