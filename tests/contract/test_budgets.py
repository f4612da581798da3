"""Budgets of size: a smell alarm. What is past one needs a reason here, and keeps to the number it has."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TypeGuard

import pytest

import armid

ROOT = Path(__file__).parents[2]
SOURCES = sorted((ROOT / "src").rglob("*.py"))
NATIVE = sorted((ROOT / "native").glob("*.?pp"))

FILE, NATIVE_FILE, FUNCTION, ATTRIBUTES, NAMES, MODULES = 400, 500, 60, 10, 25, 15

MORE_ATTRIBUTES = {
    "Estimate": 11,  # what a run stores of an estimate, and what a prediction needs to know of its training
    "Fit": 19,  # what an estimate is judged by, each number of a kind of its own
    "ProcessingOptions": 13,  # each field is a key of `[processing]` in a study
    "DesignConstraints": 13,  # each field is a limit that a design may have
    "LogFormat": 22,  # each field is a key of `[[recording]]` in a study
    "PhysicallyConsistent": 12,  # each field is an option of the method in a study
    "Recording": 18,  # what a log may hold: six quantities, how far they can be trusted, what its reader noticed
    "Robot": 11,  # what a description says of an arm
}
"""Classes past the budget, with their number of attributes."""


def classes() -> Iterator[ast.ClassDef]:
    for path in SOURCES:
        yield from (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ClassDef))


def attributes(node: ast.ClassDef) -> set[str]:
    """Names of the fields of a class, and of the attributes that its methods set."""
    annotated = [item for item in node.body if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)]
    fields = {ast.unparse(item.target) for item in annotated if "ClassVar" not in ast.unparse(item.annotation)}
    methods = [item for item in node.body if is_function(item) and item.args.args]
    return fields.union(*(attributes_set(method, method.args.args[0].arg) for method in methods))


def attributes_set(method: ast.AST, instance: str) -> Iterator[str]:
    """Names of the attributes of an instance that a method sets, by a statement of any kind or `__setattr__`."""
    for node in ast.walk(method):
        match node:
            case ast.Attribute(value=ast.Name(id=name), attr=attribute, ctx=ast.Store()) if name == instance:
                yield attribute
            case ast.Call(
                func=ast.Attribute(attr="__setattr__"), args=[ast.Name(id=name), ast.Constant(str(text)), _]
            ):
                if name == instance:
                    yield text


def is_function(node: ast.AST) -> TypeGuard[ast.FunctionDef | ast.AsyncFunctionDef]:
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


def test_attributes():
    assert {c.name: number for c in classes() if (number := len(attributes(c))) > ATTRIBUTES} == MORE_ATTRIBUTES


def test_attributes_of_every_kind_count():
    text = """
class Example:
    annotated: int
    shared: ClassVar[int] = 0

    def __init__(this, other):
        this.plain, (this.nested, *this.rest) = other.attribute = 0, (0, 0)
        this.values[0] = this.plain
        with other as this.handle:
            object.__setattr__(this, "frozen", 0)

    def later(this):
        this.added: int = 0
        for this.item in ():
            this.summed += 1
"""
    (example,) = ast.parse(text).body
    assert isinstance(example, ast.ClassDef)
    found = {"annotated", "plain", "nested", "rest", "handle", "frozen", "added", "item", "summed"}
    assert attributes(example) == found


def test_public_names():
    assert len(getattr(armid, "__all__", ())) <= NAMES


def test_something_was_looked_at():
    assert len(SOURCES) > 50 and len(NATIVE) > 5 and sum(1 for _ in classes()) > 20


def test_packages_have_few_modules():
    modules = Counter(path.parent.relative_to(ROOT / "src") for path in SOURCES if path.stem != "__init__")
    assert {str(package): count for package, count in modules.items() if count > MODULES} == {}
