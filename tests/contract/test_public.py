"""The public surface: the frozen list of names, docstrings that say what is there, an import that stays light."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import armid

SOURCE = Path(__file__).parents[2] / "src"
FROZEN = (Path(__file__).parent / "public_names.txt").read_text().split()
"""Names of `armid.__all__`. A change here is a change of the interface and belongs in CHANGELOG.md."""

HEAVY = {
    "pinocchio",
    "mujoco",
    "pyarrow",
    "rosbags",
    "h5py",
    "xacro",
    "xacrodoc",
    "typer",
    "rich",
    "plotly",
    "jinja2",
}
"""Packages that load only where they are used; each costs a tenth of a second or more."""

FILES = sorted(SOURCE.rglob("*.py"))
MODULES = [".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__") for path in FILES]
TREES = {module: ast.parse(path.read_text()) for module, path in zip(MODULES, FILES, strict=True)}

Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def is_public(name: str) -> bool:
    return not name.startswith("_")


def definitions(body: list[ast.stmt], prefix: str = "") -> Iterator[tuple[str, Definition]]:
    """Public functions and classes, methods included, with dotted names."""
    for node in body:
        if isinstance(node, Definition) and is_public(node.name):
            yield prefix + node.name, node
            if isinstance(node, ast.ClassDef):
                yield from definitions(node.body, f"{prefix}{node.name}.")


def section(docstring: str, title: str) -> list[str]:
    """Names explained in a section of a docstring."""
    found = re.search(rf"^{title}:\n((?:[ ]{{4}}.*\n?|\n)*)", docstring, re.MULTILINE)
    return re.findall(r"^ {4}(\w+):", found[1], re.MULTILINE) if found else []


def parameters(node: ast.FunctionDef | ast.AsyncFunctionDef) -> list[str]:
    spec = node.args
    names = [a.arg for a in (*spec.posonlyargs, *spec.args, spec.vararg, *spec.kwonlyargs, spec.kwarg) if a]
    return [name for name in names if name not in ("self", "cls")]


def fields(node: ast.ClassDef) -> list[str]:
    """Public fields of a dataclass."""
    items = [item for item in node.body if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)]
    names = [item.target.id for item in items if not ast.unparse(item.annotation).startswith("ClassVar")]
    return [name for name in names if is_public(name)]


def is_dataclass(node: ast.ClassDef) -> bool:
    return any("dataclass" in ast.unparse(d) for d in node.decorator_list)


def test_names_are_frozen():
    assert sorted(getattr(armid, "__all__", ())) == sorted(FROZEN)


@pytest.mark.parametrize("name", FROZEN)
def test_public_name(name: str):
    assert getattr(armid, name).__doc__


@pytest.mark.parametrize("module", MODULES)
def test_every_listed_name_is_there(module: str):
    loaded = importlib.import_module(module)
    listed = getattr(loaded, "__all__", [])
    assert [name for name in listed if not hasattr(loaded, name)] == []
    assert list(listed) == sorted(set(listed), key=listed.index), "a name is listed twice"


@pytest.mark.parametrize("module", MODULES)
def test_docstrings(module: str):
    tree = TREES[module]
    assert ast.get_docstring(tree), "the module says nothing of itself"
    silent = [name for name, node in definitions(tree.body) if not ast.get_docstring(node)]
    assert silent == []


def wrong_names(node: Definition) -> dict[str, list[str]]:
    """Return what a docstring explains and what there is, where the two differ."""
    docstring = ast.get_docstring(node) or ""
    if not isinstance(node, ast.ClassDef):
        there, explained = parameters(node), section(docstring, "Args")
        fits = explained in ([], there)
    elif is_dataclass(node):
        there, explained = fields(node), section(docstring, "Attributes")
        fits = explained == there if explained else all(f"`{name}`" in docstring for name in there)
    else:
        return {}
    return {} if fits else {"explained": explained, "there": there}


@pytest.mark.parametrize("module", MODULES)
def test_docstrings_name_what_is_there(module: str):
    """Arguments and fields that a docstring explains are those of the code, all of them and in their order."""
    wrong = {name: wrong_names(node) for name, node in definitions(TREES[module].body)}
    assert {name: difference for name, difference in wrong.items() if difference} == {}


def test_the_package_alone_loads_nothing():
    script = (
        "import armid, sys; print(*sorted(m for m in sys.modules if m.split('.')[0] in ('numpy', 'scipy', 'armid')))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["armid"]


@pytest.mark.parametrize("arguments", ["", "'--help'", "'identify', '--help'"])
def test_help_is_light(arguments: str):
    """The first questions, which come again and again, wait for no arithmetic."""
    script = f"""
import sys
from armid.cli.main import main
try:
    main([{arguments}])
except SystemExit:
    pass
loaded = {{name.split(".")[0] for name in sys.modules}}
print(*sorted(({HEAVY - {"typer", "rich"}!r} | {{"numpy", "scipy", "clarabel"}}) & loaded), file=sys.stderr)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "armid" in done.stdout and done.stderr.split() == []


def test_the_package_runs_as_a_module():
    done = subprocess.run([sys.executable, "-m", "armid", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("armid ")


def test_importing_is_light():
    """No module but those of the command line loads what only some users need."""
    modules = [module for module in MODULES if not module.startswith("armid.cli")]
    script = f"import {', '.join(modules)}, sys; print(*sorted({HEAVY!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


SLOW = {"scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.stats", "pydantic"}
"""Packages that take longer to import than a small recording takes to examine."""


def test_identification_and_doctor_import_nothing_slow():
    modules = (
        "cli.commands.identify",
        "cli.commands.doctor",
        "study.compare_methods",
        "doctor.catalogue",
        "report.page",
    )
    script = f"""
import sys
from armid.doctor.catalogue import CHECKS
import {", ".join(f"armid.{module}" for module in modules)}
print(len(list(CHECKS.values())), *sorted({SLOW!r} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    count, *slow = done.stdout.split()
    assert int(count) > 0 and slow == []
