"""Budgets of size: a smell alarm. What is past one needs a reason here, and keeps to the number it has."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import armid

ROOT = Path(__file__).parents[2]
SOURCES = sorted((ROOT / "src").rglob("*.py"))
NATIVE = sorted((ROOT / "native").glob("*.?pp"))

FILE, NATIVE_FILE, FUNCTION, FIELDS, NAMES = 400, 500, 60, 10, 25

MORE_FIELDS = {
    "Fit": 18,  # what an estimate is judged by, each number of a kind of its own
    "ProcessingOptions": 13,  # each field is a key of `[processing]` in a study
    "DesignConstraints": 13,  # each field is a limit that a design may have
    "LogFormat": 18,  # each field is a key of `[[recording]]` in a study
    "Recording": 16,  # what a log may hold: five quantities, how far they can be trusted, what its reader noticed
    "Robot": 11,  # what a description says of an arm
}
"""Dataclasses past the budget, with their number of fields."""


def classes() -> Iterator[ast.ClassDef]:
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef) and any("dataclass" in ast.unparse(d) for d in node.decorator_list):
                yield node


def fields(node: ast.ClassDef) -> int:
    annotated = [ast.unparse(item.annotation) for item in node.body if isinstance(item, ast.AnnAssign)]
    return sum(not annotation.startswith("ClassVar") for annotation in annotated)


def is_function(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT / "src")))
def test_source_file(path: Path):
    text = path.read_text()
    assert text.count("\n") <= FILE
    lengths = {n.name: n.end_lineno - n.lineno + 1 for n in ast.walk(ast.parse(text)) if is_function(n)}
    assert {name: length for name, length in lengths.items() if length > FUNCTION} == {}


@pytest.mark.parametrize("path", NATIVE, ids=lambda path: path.name)
def test_native_file(path: Path):
    assert path.read_text().count("\n") <= NATIVE_FILE


def test_fields():
    assert {node.name: fields(node) for node in classes() if fields(node) > FIELDS} == MORE_FIELDS


def test_public_names():
    assert len(getattr(armid, "__all__", ())) <= NAMES


def test_something_was_looked_at():
    assert len(SOURCES) > 50 and len(NATIVE) > 5 and sum(1 for _ in classes()) > 20
