"""Names are the field's: no metaphors, one class for each name, and a glossary that the code keeps."""

from __future__ import annotations

import ast
import importlib
import re
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src" / "armid"
GLOSSARY = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")

AVOIDED = frozenset(
    "again alone anywhere below belief believe beside beyond climb cover doubt doubts forgotten hear "
    "inform jointly ladder look material noticed observe ours pull remains room rung said settle shelf "
    "shown silent surprise taken tell told weigh wish worth".split()
)
"""Words that say nothing to a reader who knows the field but not this code; each had a term of the field."""


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(SOURCE).with_suffix("").parts)


FILES = {module_name(path): ast.parse(path.read_text(encoding="utf-8")) for path in sorted(SOURCE.rglob("*.py"))}


def words(name: str) -> set[str]:
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)}


@pytest.mark.parametrize("module", FILES)
def test_names_hold_no_metaphor(module: str):
    top = [node.name for node in FILES[module].body if isinstance(node, ast.ClassDef | ast.FunctionDef)]
    public = [name for name in top if not name.startswith("_")]
    assert {name for name in (*module.split("."), *public) if words(name) & AVOIDED} == set()


def test_each_class_name_stands_once():
    places: dict[str, list[str]] = defaultdict(list)
    for module, tree in FILES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(module)
    assert {name: modules for name, modules in places.items() if len(modules) > 1} == {}


@pytest.mark.parametrize("symbol", sorted(set(re.findall(r"`(armid(?:\.\w+)+)`", GLOSSARY))))
def test_symbols_of_the_glossary_exist(symbol: str):
    parts = symbol.split(".")
    for count in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for name in parts[count:]:
            found = getattr(found, name)
        return
    pytest.fail(symbol)
