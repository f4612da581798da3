"""Imports between modules of the project: no circle, and few enough that a module can be read by itself."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from statistics import median

import pytest

SOURCE = Path(__file__).parents[2] / "src"

USUAL, MOST = 5, 20


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__")


def imports_of(text: str, modules: frozenset[str]) -> set[str]:
    """Modules that a text imports anywhere: at the top, in a function, or for the types alone."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names} & modules
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports are not counted"
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= names & modules
            if names - modules and node.module in modules:
                found.add(node.module)
    return found


FILES = {module_name(path): path for path in sorted(SOURCE.rglob("*.py"))}
IMPORTS = {
    name: imports_of(path.read_text(encoding="utf-8"), frozenset(FILES)) - {name} for name, path in FILES.items()
}


def circle(imports: Mapping[str, set[str]]) -> list[str]:
    """One circle of modules, or none."""
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_circle():
    assert circle(IMPORTS) == []


def test_most_modules_import_few():
    assert median(len(found) for found in IMPORTS.values()) <= USUAL


def test_none_imports_many():
    assert {name: len(found) for name, found in IMPORTS.items() if len(found) > MOST} == {}


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("import armid.a, numpy", {"armid.a"}),
        ("from armid import a, thing", {"armid.a", "armid"}),
        ("from armid.a import x, y", {"armid.a"}),
        ("def f():\n    from armid.b import x", {"armid.b"}),
        ("if TYPE_CHECKING:\n    from armid.b import X", {"armid.b"}),
        ("import os\nfrom numpy import a", set()),
    ],
)
def test_every_kind_of_import_counts(text: str, found: set[str]):
    assert imports_of(text, frozenset({"armid", "armid.a", "armid.b"})) == found


def test_a_circle_is_found():
    assert set(circle({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}})) == {"a", "b", "c"}
    assert circle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []
